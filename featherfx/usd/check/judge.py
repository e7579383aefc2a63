"""Measures of a written cache by its points, velocities, rest and topology alone.

Nothing here is shared with what simulates, lays out and writes. Each
thread measures one prim after the other, of which five samples are in memory.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise, takewhile
from pathlib import Path
from threading import Event
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit
from featherfx.files.process import count_cores
from featherfx.jit.compiled import KernelModule
from featherfx.jit.kernel_calls import Encoded
from featherfx.phases import phase
from featherfx.usd.check.tracks import (
    BARB,
    BINS_PER_OCTAVE,
    KERATIN_DENSITY,
    KERATIN_MODULUS,
    MAX_JUMP,
    MAX_LENGTH_ERROR,
    MAX_ROOT_JUMP_RATIO,
    MAX_SIMULATED_LENGTH_ERROR,
    MAX_STRESS,
    MAX_UNEXPLAINED_RATIO,
    MAX_UNRESOLVED_SPEED,
    MIN_EXPONENT,
    OCTAVES,
    RACHIS,
    USUAL_THICKNESS,
    Track,
    TrackedFeather,
    find_tracks,
    list_passed_bounds,
)
from featherfx.usd.read.values import open_stage, read_note, read_scenery, usd_errors

judge_kernels = KernelModule("featherfx.usd.check.judge_kernels")

_PARTS = {RACHIS: "rachis", BARB: "barb"}
_JUMP, _UNEXPLAINED, _STRAIN, _DEPTH, _KINDS = 2, 3, 4, 5, 6  # columns of Worst
_MAX_NAMED = 10
_LIMITS = np.array([MAX_JUMP, MAX_ROOT_JUMP_RATIO, MAX_UNEXPLAINED_RATIO])
_PROBED = 4  # of so many points, prime to those of a row, the velocities of one are compared
_UNEVEN = 1e-6  # of the time between two samples, by which others of one length may differ
_ROUNDING = float(np.finfo(np.float32).eps)
_STILL = 1e-4  # m/s, rms speed of points that differ by little but rounding from frame to frame


class Worst(NamedTuple):
    """Largest values so far, (F, 6) of each feather: stretch of its rachis, of a barb, jump, jump
    that velocities do not explain, strain of its rachis, and depth of its vanes in the skin, m.

    at: (F, 6) time codes.
    """

    value: Array
    at: Array


class SampleShape(NamedTuple):
    """Points of F feathers at one time, as judged.

    nodes: (N, 3). lengths: (K,) of strands. bent: (R, 5) curvatures where the R segments of
    rachises begin. heights: (R,) half widths of rings there, at rest, across the direction of their
    first point. axes: (F, 3, 3) of roots.
    """

    nodes: Array
    lengths: Array
    bent: Array
    heights: Array
    axes: Array


class ThreeSamples(NamedTuple):
    """Three samples of a track, step s apart.

    points: of (V, 3). roots: of (F, 3). axes: of (F, 3, 3), columns, of the roots. rates: (V, 3) of
    the first and the last; of length 0 where there are none. code: of the middle one.
    """

    points: tuple[Floats, Floats, Floats]
    roots: tuple[Array, Array, Array]
    axes: tuple[Array, Array, Array]
    rates: tuple[Floats, Floats]
    step: float
    code: float


class _Sample(NamedTuple):
    """Values of a track: points and velocities (V, 3), where there are any, roots (F, 3) and their
    axes (F, 3, 3). probed, probed_rates: of the points whose velocities count."""

    code: float
    points: Any
    rates: Any
    roots: Array
    axes: Array
    probed: Any
    probed_rates: Any


def judge_cache(
    path: str | Path, simulated: Collection[str] = (), max_skin_frames: int = 0
) -> dict[str, Any]:
    """Return the measures of a cache.

    simulated: ids of feathers whose material may stretch. max_skin_frames: in how many frames,
    evenly, depths in the skin are measured; 0: in all. Raises InputError where the file cannot be
    read.
    """
    stage, judge = open_stage(path), Judge()
    with usd_errors(stage.GetPseudoRoot()):
        tracks = list(find_tracks(stage))
    depths = None
    if any(each.get("role") == "skin" for each in read_scenery(stage)):
        from featherfx.usd.check.skins import SkinDepths  # no shot without a skin needs it

        depths = SkinDepths(stage, Path(path), tracks, max_skin_frames)
    moduli = _read_moduli(stage, [label for track in tracks for label in track.labels])
    total = len(tracks) + (depths.count if depths else 0)
    measure = partial(measure_track, per_second=stage.GetTimeCodesPerSecond())
    stopped = Event()
    every = takewhile(lambda _: not stopped.is_set(), depths.frames() if depths else ())
    with phase("judging", total) as done, ThreadPoolExecutor(max(count_cores(), 2)) as pool:
        frames = pool.submit(list, every)
        try:
            measured = zip(tracks, pool.map(measure, tracks), strict=True)
            for number, (track, found) in enumerate(measured, 1):
                judge.add(track, found)
                done(number)
            for number, frame in enumerate(frames.result(), len(tracks) + 1):
                judge.add_depths(*frame)
                done(number)
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)
    told = judge.report(simulated, _read_thickness(stage), moduli)
    told["skin_depth"]["frames"] = depths.count if depths else 0
    return told | {"bounds_passed": list(list_passed_bounds(told))}


def _read_thickness(stage: Any) -> float:
    """Return the thickness of vanes, m, that a cache tells of."""
    found = read_note(stage, "thickness", USUAL_THICKNESS)
    return found if found > 0.0 else USUAL_THICKNESS


def _read_moduli(stage: Any, labels: Iterable[TrackedFeather]) -> dict[str, float]:
    """Return the moduli of rachises, Pa, by id, as a cache tells them of feathers or kinds;
    KERATIN_MODULUS where it tells nothing or of softer ones."""
    ids, kinds = (read_note(stage, f"{name}_moduli", {}) for name in ("id", "kind"))
    told = {each.id: ids.get(each.id, kinds.get(each.kind)) for each in labels}
    return {
        id: max(each, KERATIN_MODULUS) if isinstance(each, float) else KERATIN_MODULUS
        for id, each in told.items()
    }


class TrackMeasures:
    """Measures of all samples of a track of F feathers.

    errors: counts of errors of velocities by size, as of count_errors. squares: sum of
    squares of the speeds of points, m^2/s^2, of so many (rates).
    """

    def __init__(self, feathers: int) -> None:
        self.worst = Worst(*np.zeros((2, feathers, _KINDS)))
        self.errors = np.zeros((3, OCTAVES * BINS_PER_OCTAVE), dtype=np.int64)
        self.squares, self.rates = 0.0, 0


def measure_track(track: Track, per_second: float) -> TrackMeasures:
    """Measure all samples of a track. per_second: time codes."""
    found, reader = TrackMeasures(len(track.labels)), track.reader
    rest = _new_shape(track)
    now = rest._replace(lengths=np.zeros_like(rest.lengths), bent=np.zeros_like(rest.bent))
    strands, worst, shape = Encoded(track.strands), Encoded(found.worst), Encoded(now)
    points, none = track.rest, TrackMeasures(len(track.labels)).worst
    judge_kernels.measure_sample(points, rest, rest, strands, 0.0, 0.0, none)
    rest.heights[:] = _find_heights(track, rest.nodes, rest.bent[:, 4])
    roots, sizes, held = track.strands.root, np.zeros(len(track.labels)), Encoded(rest)
    away = np.linalg.norm(points - rest.nodes[roots][track.owner], axis=1)
    np.maximum.at(sizes, track.owner, away)
    window: list[_Sample] = []
    for code in reader.codes or [None]:
        points = reader.read("points", code)
        rounding = _ROUNDING * float(max(points.max(initial=0.0), -points.min(initial=0.0)))
        judge_kernels.measure_sample(points, held, shape, strands, rounding, code or 0.0, worst)
        if code is not None:
            rates, axes = reader.read("velocities", code), now.axes.copy()
            some = [None if each is None else each[::_PROBED].copy() for each in (points, rates)]
            window = [*window[-4:], _Sample(code, points, rates, now.nodes[roots], axes, *some)]
            _compare(window, track, sizes, per_second, found)
    return found


def _new_shape(track: Track) -> SampleShape:
    nodes, strands = len(track.strands.node_first) - 1, len(track.strands.feather)
    segments = len(_rachis_starts(track))
    return SampleShape(
        nodes=np.zeros((nodes, 3)),
        lengths=np.zeros(strands),
        bent=np.zeros((segments, 5)),
        heights=np.zeros(segments),
        axes=np.zeros((len(track.labels), 3, 3)),
    )


def _rachis_starts(track: Track) -> Indices:
    """Return (R,) nodes where the segments of rachises begin, which come before those of barbs."""
    strands = track.strands
    return strands.start[: strands.first[np.count_nonzero(strands.kind == RACHIS)]]


def _compare(
    window: Sequence[_Sample], track: Track, sizes: Array, per_second: float, found: TrackMeasures
) -> None:
    """Compare samples that follow each other. window: the last five, the newest last."""
    codes = [each.code for each in window]
    steps = [(later - code) / per_second for code, later in pairwise(codes)]
    even = [abs(each - steps[-1]) <= _UNEVEN * steps[-1] for each in steps]
    if len(window) > 2 and all(even[-2:]):
        last, none = window[-3:], np.zeros((0, 3), np.float32)
        rates = [none if each.rates is None else each.rates for each in (last[0], last[2])]
        samples = ThreeSamples(
            (last[0].points, last[1].points, last[2].points),
            (last[0].roots, last[1].roots, last[2].roots),
            (last[0].axes, last[1].axes, last[2].axes),
            (rates[0], rates[1]),
            steps[-1],
            last[1].code,
        )
        judge_kernels.keep_jumps(samples, track.owner, sizes, _LIMITS, found.worst)
    if len(window) > 4 and all(even) and (middle := window[2].probed_rates) is not None:
        first, second, third, fourth, fifth = (each.probed for each in window)
        points = first, second, third, fourth, fifth
        found.squares += judge_kernels.count_errors(points, middle, steps[-1], found.errors)
        found.rates += len(middle)


class Judge:
    """Measures of tracks, one after the other."""

    def __init__(self) -> None:
        self._names: dict[str, int] = {}
        self._worst = Worst(np.zeros((0, _KINDS)), np.zeros((0, _KINDS)))
        self._errors = np.zeros((3, OCTAVES * BINS_PER_OCTAVE), dtype=np.int64)
        self._squares, self._rates = 0.0, 0

    def add(self, track: Track, found: TrackMeasures) -> None:
        """Add the measures of a track."""
        self._errors += found.errors
        self._squares += found.squares
        self._rates += found.rates
        self._keep([each.id for each in track.labels], found.worst)

    def add_depths(self, code: float, found: Sequence[tuple[Track, Array]]) -> None:
        """Keep the largest depths at a time code, as SkinDepths gives them."""
        for track, depths in found:
            worst = Worst(*np.zeros((2, len(track.labels), _KINDS)))
            worst.value[:, _DEPTH], worst.at[:] = depths, code
            self._keep([each.id for each in track.labels], worst)

    def _keep(self, ids: Sequence[str], worst: Worst) -> None:
        places = np.array([self._names.setdefault(id, len(self._names)) for id in ids], dtype=int)
        if (more := len(self._names) - len(self._worst.value)) > 0:
            self._worst = Worst(*(np.pad(each, ((0, more), (0, 0))) for each in self._worst))
        for kind in range(_KINDS):
            larger = worst.value[:, kind] > self._worst.value[places, kind]
            for whole, own in zip(self._worst, worst, strict=True):
                whole[places[larger], kind] = own[larger, kind]

    def report(
        self, simulated: Collection[str], thickness: float, moduli: Mapping[str, float]
    ) -> dict[str, Any]:
        """Return all measures. simulated: as of judge_cache. thickness: m, of vanes. moduli: Pa, of
        rachises by id."""
        value = self._worst.value
        stretches = value[:, [RACHIS, BARB]].max(axis=1, initial=0.0)
        known = frozenset(simulated)
        bounds = np.array(
            [MAX_SIMULATED_LENGTH_ERROR if id in known else MAX_LENGTH_ERROR for id in self._names]
        )
        over = np.flatnonzero(stretches > bounds)
        over = over[np.argsort(-stretches[over] / bounds[over], kind="stable")]
        mismatch, unexplained, open_ = (self._quantile(counts) for counts in self._errors)
        return {
            "lengths": {
                "rachis_worst": float(value[:, RACHIS].max(initial=0.0)),
                "barb_worst": float(value[:, BARB].max(initial=0.0)),
                "feathers_over": len(over),
                "worst": [
                    self._told(k, int(value[k, :_JUMP].argmax()))
                    | {"part": _PARTS[int(value[k, :_JUMP].argmax())], "bound": float(bounds[k])}
                    for k in over[:_MAX_NAMED].tolist()
                ],
            },
            "pops": {
                "count": int((value[:, _JUMP] > MAX_JUMP).sum()),
                "worst": self._largest(_JUMP),
                "unexplained": int((value[:, _UNEXPLAINED] > MAX_JUMP).sum()),
                "worst_unexplained": self._largest(_UNEXPLAINED),
            },
            "strain_worst": self._strain(moduli),
            "skin_depth": self._depth(thickness),
            "velocity_mismatch": mismatch,
            "velocity_unexplained": unexplained,
            "velocity_resolved": open_ is not None and open_ < MAX_UNRESOLVED_SPEED,
        }

    def _told(self, feather: int, kind: int) -> dict[str, Any]:
        value, at = (float(each[feather, kind]) for each in self._worst)
        return {"feather": [*self._names][feather], "frame": at, "of_length": value}

    def _largest(self, kind: int) -> dict[str, Any] | None:
        value = self._worst.value[:, kind]
        return self._told(int(value.argmax()), kind) if value.max(initial=0.0) > 0.0 else None

    def _strain(self, moduli: Mapping[str, float]) -> dict[str, Any] | None:
        """Return the strain of the rachis that comes nearest to what it bears, that bound, and the
        energy of keratin strained so, J/kg."""
        own = np.array([moduli[id] for id in self._names])
        stress = own * self._worst.value[:, _STRAIN]
        if not stress.any():
            return None
        worst, modulus = self._told(int(stress.argmax()), _STRAIN), float(own[stress.argmax()])
        strain = worst.pop("of_length")
        energy = 0.5 * modulus * strain**2 / KERATIN_DENSITY
        return worst | {"strain": strain, "bound": MAX_STRESS / modulus, "energy": energy}

    def _depth(self, thickness: float) -> dict[str, Any]:
        """Return the largest depth of a vane in the skin, m, and how many feathers are too deep."""
        depths, worst = self._worst.value[:, _DEPTH], self._largest(_DEPTH)
        found: dict[str, Any] = {
            "thickness": thickness,
            "feathers_over": int((depths > thickness).sum()),
        }
        if worst is not None:
            found["worst"] = worst | {"depth": worst.pop("of_length")}
        return found

    def _quantile(self, counts: Any) -> float | None:
        """Return what 99 of 100 errors do not exceed, over the rms speed of the points; None
        without any."""
        if not self._rates:
            return None
        place = int(np.searchsorted(np.cumsum(counts), 0.99 * counts.sum()))
        rms = max(np.sqrt(self._squares / self._rates), _STILL)
        return float(2.0 ** (MIN_EXPONENT + (place + 0.5) / BINS_PER_OCTAVE) / rms)


def _find_heights(track: Track, nodes: Array, widths: Array) -> Array:
    """Return (R,) half widths of rings at rest across the direction of their first point.

    widths: (R,) half widths along it.
    """
    strands, start = track.strands, _rachis_starts(track)
    first, counts = strands.node_first[start], np.diff(strands.node_first)[start]
    ends = np.cumsum(counts)
    place = np.repeat(first - ends + counts, counts) + np.arange(ends[-1] if len(ends) else 0)
    ring = np.repeat(np.arange(len(start)), counts)
    away = track.rest[strands.node_points[place]] - nodes[start][ring]
    along = np.sum(away * unit(track.rest[strands.node_points[first]] - nodes[start])[ring], axis=1)
    across = np.sqrt(np.maximum(np.sum(away**2, axis=1) - along**2, 0.0))
    heights = np.zeros(len(start))
    np.maximum.at(heights, ring, across)
    return np.where(widths > 0.0, heights, 0.0)
