"""A gate for promised errors: random shots from one fixed distribution, beside a reference.

Every feather of every shot is a case. The reference has twice the rows, columns and coefficients of
what the bake simulates, and a tenth of its tolerance; where it is not kept, that is checked on
three times the rows, columns and coefficients. Reference x and check y of a feather that flutters
go different ways in the end, as any two motions do whose distance grows,

    |x(t) - y(t)| ~ d exp(l t)

so poses are compared at the frames before they are farther apart than promised. Of those from there
on, and of others up to one of _LONG, mean pose and swing are unique: the largest RMS distance of a
node from its mean. A case is

    kept        no node is farther from the reference than promised in any frame with one answer,
                nor in the mean of the others, and their swings differ by no more
    undefined   reference and check rest in two poses, or do not agree on mean and swing
    broken      all others

told: the bake named the feather as undefined, or its kind as one that cannot keep the error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather, RowPoints
from featherfx.groom.keys.preset import Quality
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.types import FeatherKind
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.loop.window_runs import (
    add_contact_error,
    carry_all,
    existing_nodes,
    max_distance,
    mean_distance,
)
from featherfx.shot.options import MAX_COEFFICIENTS, FeatherOptions
from featherfx.shot.read.read import read_shot
from featherfx.shot.read.reference import list_presets
from featherfx.shot.types import Shot, part_of

# of the distribution: errors (percent), fastest wind (m/s); feathers and frames of a free shot
_ERRORS, _MAX_WIND, _FEATHERS, _FRAMES = (3.0, 1.5, 0.5), 20.0, 3, 13
# of a shot with contact: distance of its feathers, of their length; their number, and frames
_CLOSE, _TOUCHING, _TOUCHING_FRAMES = 0.06, 2, 5
# finer by, and the check; tolerances tighter by
_FINER, _CHECK, _TIGHTER = 2, 3, 10.0
# frames of which means are taken, until they are as near as promised; with contact the first alone,
# as a frame takes some 15 times as long
_LONG = 25, 49, 97


class FineRun(NamedTuple):
    """Feathers by number as they were simulated, and their points at every frame.

    options: of every feather.
    """

    feathers: dict[int, Feather]
    points: dict[int, list[RowPoints]]
    report: dict[str, Any]
    options: Sequence[FeatherOptions]


@dataclass(frozen=True)
class PromiseCase:
    """promised, reached: percent of the length; checked: of the reference by its own check.
    unique_frames: frames before reference and check part."""

    seed: int
    feather: str
    contact: bool
    promised: float
    reached: float
    checked: float
    outcome: str
    unique_frames: int
    told: bool


def run(shot: Shot) -> FineRun:
    """Simulate a shot on one thread."""
    simulation = simulate(shot)
    feathers: dict[int, Feather] = {}
    points: dict[int, list[RowPoints]] = {}
    for _ in simulation:
        for f, (feather, now) in sorted(simulation.simulated().items()):
            feathers[f] = feather
            points.setdefault(f, []).append(RowPoints(now.nodes.copy(), now.directors.copy()))
    return FineRun(feathers, points, simulation.report, simulation.options)


def errors(one: FineRun, reference: FineRun) -> list[float]:
    """Per feather the largest distance of any point that one run simulates, at any frame, from
    where the reference has it, over the feather's length."""
    return [
        max_distance(own, reference.feathers[f], one.points[f], reference.points[f])
        / float(own.station[-1])
        for f, own in one.feathers.items()
    ]


def fixed_quality(
    grid: tuple[int, int, int], tolerance: float, rest: Quality, length: float = 1.0
) -> Quality:
    """Return a quality that simulates all feathers alike.

    grid: rows, columns, coefficients. tolerance: over the length, of each; where they push each
    other, of all by the length given (m).
    """
    rows, columns, coefficients = grid
    return Quality(
        name="fixed",
        rows=min(rows, 400),
        columns=min(columns, 100),
        coefficients=min(coefficients, MAX_COEFFICIENTS),
        tolerance=tolerance * length,
        relative_tolerance=max(tolerance, 1e-6),
        max_substeps=rest.max_substeps,
        spectral_radius=rest.spectral_radius,
    )


def measure_promise(seed: int, kinds: Sequence[str]) -> list[PromiseCase]:
    """Measure whether a random shot keeps its promise, feather by feather."""
    shot = random_shot(seed, kinds)
    found, promised = run(shot), shot.quality.promised
    assert promised is not None
    report = add_contact_error(shot, found.report)
    named = {each for names in report["undefined"].values() for each in names}
    over = report.get("over_promised", {})
    every = np.arange(len(shot.groom.feathers))
    cases = []
    for some in [every] if shot.contact is not None else np.split(every, len(every)):
        for f, judged in zip(some.tolist(), _judge(shot, found, some), strict=True):
            placement = shot.groom.feathers[f]
            cases.append(
                PromiseCase(
                    seed=seed,
                    feather=f"{placement.id} ({placement.kind.name})",
                    contact=shot.contact is not None,
                    promised=100.0 * promised,
                    told=placement.id in named or placement.kind.name in over,
                    **judged,
                )
            )
    return cases


def _judge(shot: Shot, found: FineRun, some: Indices) -> list[dict[str, Any]]:
    """Judge some feathers of a shot that are simulated together: the figures of their cases."""
    promised = shot.quality.promised
    assert promised is not None
    own = found._replace(
        feathers={k: found.feathers[f] for k, f in enumerate(some)},
        points={k: found.points[f] for k, f in enumerate(some)},
    )
    fine = run(_finer(shot, found, _FINER, some))
    reached = _ways(own, fine)
    checked, means = np.zeros_like(reached), np.zeros((len(some), 2))
    if (reached > promised).any():
        checked = _ways(fine, run(_finer(shot, found, _CHECK, some)), own)
        parted = [unique_frames(each, promised) for each in checked]
        means = _means(shot, found, some, own, np.array(parted))
    return [judge(*each, promised) for each in zip(reached, checked, means, strict=True)]


def unique_frames(checked: Array, promised: float) -> int:
    """Count the frames before a reference and its check (T,) are farther apart than promised."""
    return int(np.argmax([*(checked > promised), True]))


def judge(reached: Array, checked: Array, means: Array, promised: float) -> dict[str, Any]:
    """Judge a feather by its distances from the reference, and the reference's from its check (T,),
    and (2,) by those of the means of frames without one answer; all over the length."""
    count = unique_frames(checked, promised)
    own, left = (float(each[:count].max(initial=0.0)) for each in (reached, checked))
    if count < len(reached):
        own, left = max(own, float(means[0])), max(left, float(means[1]))
    outcome = "kept" if own <= promised else "broken"
    return {
        "outcome": "undefined" if left > promised else outcome,
        "unique_frames": count,
        "reached": 100.0 * own,
        "checked": 100.0 * left,
    }


def _means(shot: Shot, found: FineRun, some: Indices, own: FineRun, parted: Indices) -> Array:
    """(F, 2) by how much the bake's means and swings differ from the reference's, and these from
    its check's, over the length, from the frames on at which those part: 0 where they do not."""
    means, promised = np.zeros((len(some), 2)), shot.quality.promised
    parts = parted <= shot.last_frame - shot.first_frame
    assert promised is not None
    most = 1 if shot.contact is not None else len(_LONG)
    for frames in _LONG[:most] if parts.any() else ():
        longer = replace(shot, last_frame=shot.first_frame + frames - 1)
        runs = [run(_finer(longer, found, each, some)) for each in (1, _FINER, _CHECK)]
        for k in np.flatnonzero(parts).tolist():
            grid, first = own.feathers[k], parted[k]
            poses = [(each.feathers[k], each.points[k][first:]) for each in runs]
            apart = [mean_distance(grid, *each) for each in pairwise(poses)]
            means[k] = np.array(apart) / grid.station[-1]
        if (means <= promised).all():
            break
    return means


def _ways(one: FineRun, other: FineRun, onto: FineRun | None = None) -> Array:
    """(F, T) largest distance of two runs at every frame, over the length, at the nodes of a third,
    None: of the first."""
    grids = (one if onto is None else onto).feathers
    return np.array(
        [
            np.linalg.norm(_nodes(one, k, grid) - _nodes(other, k, grid), axis=-1).max(axis=1)
            / grid.station[-1]
            for k, grid in grids.items()
        ]
    )


def _nodes(found: FineRun, k: int, grid: Feather) -> Array:
    """(T, K, 3) m, where a run has the nodes of a grid of its feather k at every frame."""
    there = existing_nodes(grid)
    carried = carry_all(found.feathers[k], grid, found.points[k])
    return np.array([each.nodes[there] for each in carried])


def _finer(shot: Shot, found: FineRun, finer: int, some: Indices) -> Shot:
    """The shot with some of its feathers, finer than the bake simulated any of them; 1: as fine."""
    options = [found.options[f] for f in some]
    lengths = [shot.groom.feathers[f].kind.length for f in some]
    rows = finer * (max(each.rows for each in options) - 1) + 1
    columns = finer * max(each.columns for each in options)
    rows = min(_finest_rows(shot.groom.feathers[f].kind, rows, columns) for f in some)
    grid = rows, columns, finer * max(each.coefficients for each in options)
    tolerance = min(each.tolerance / size for each, size in zip(options, lengths, strict=True))
    length = min(lengths) if shot.contact is not None else max(lengths)
    tighter = 1.0 if finer == 1 else _TIGHTER
    quality = fixed_quality(grid, tolerance / tighter, shot.quality, length)
    return replace(part_of(shot, some), quality=quality)


def _finest_rows(kind: FeatherKind, rows: int, columns: int) -> int:
    """Return so many rows, or the most on which the vane of a kind does not fold over itself."""
    while True:
        try:
            build_feather(kind, min(rows, 400), min(columns, 100))
        except InputError:
            rows -= max(rows // 20, 1)
        else:
            return rows


def measure_promises(count: int, seed: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Measure so many random shots from a seed on: kept, broken, undefined, told, and cases."""
    kinds = sorted(each.path.stem for each in list_presets() if each.family == "feather")
    cases: list[PromiseCase] = []
    for number in range(count):
        cases += measure_promise(seed + number, kinds)
        progress(number + 1, count)
    counts = {
        outcome: sum(each.outcome == outcome for each in cases)
        for outcome in ("kept", "broken", "undefined")
    }
    told = sum(each.told for each in cases if each.outcome == "undefined")
    return {**counts, "told": told, "cases": [asdict(each) for each in cases]}


def random_shot(seed: int, kinds: Sequence[str]) -> Shot:
    """Draw a shot: kinds in turn, winds with gusts, shakes and flaps, a third with contact."""
    random = np.random.default_rng(seed)
    contact = seed % 3 == 2
    names = [kinds[(seed * _FEATHERS + k) % len(kinds)] for k in range(_FEATHERS)]
    if contact:
        names = [kinds[seed // 3 % len(kinds)]] * _TOUCHING
    length = max(load_preset(f"feather/{name}")[1]["length"].value for name in names)
    groom = 'name = "random"\n'
    way, up = random.normal(size=(2, 3))
    over = np.cross(np.cross(way, up), way)
    for k, name in enumerate(names):
        place = (1.0 + 3.0 * length) * np.array([0.0, 0.0, k])
        if contact:
            place = _CLOSE * length * k * over / np.linalg.norm(over)
        else:
            way, up = random.normal(size=(2, 3))
        groom += (
            f'[[feather]]\nid = "f{k}"\nkind = "{name}"\nposition = {_list(place)}\n'
            f"direction = {_list(way)}\nup = {_list(up)}\nscale = {random.uniform(0.7, 1.4):.3f}\n"
        )
    speed = _MAX_WIND * random.uniform() ** 2
    wind = (
        f"[wind]\nspeed = {speed:.3f}\ngust = {random.uniform(0.0, 0.5):.3f}\n"
        f"direction = {_list(random.normal(size=3))}\nseed = {seed}\n"
    )
    motion = [
        "motion = 'hold'\n",
        f"motion = {{ kind = 'shake', amplitude = {random.uniform(0.0, 0.05):.4f}, frequency ="
        f" {random.uniform(0.5, 4.0):.3f}, direction = {_list(random.normal(size=3))} }}\n",
        f"motion = {{ kind = 'swing', axis = {_list(random.normal(size=3))}, angle ="
        f" {random.uniform(5.0, 40.0):.2f}, frequency = {random.uniform(0.5, 3.0):.3f} }}\n",
    ][seed // 3 % 3]
    error = _ERRORS[seed // 9 % 3]
    shot = (
        f'name = "random"\ngroom = "groom.toml"\n{motion}'
        f"frames = [1, {_TOUCHING_FRAMES if contact else _FRAMES}]\n"
        f"quality = {{ error = {error} }}\n{wind}" + ("[contact]\n" if contact else "")
    )
    with TemporaryDirectory() as folder:
        Path(folder, "groom.toml").write_text(groom, encoding="utf-8")
        Path(folder, "shot.toml").write_text(shot, encoding="utf-8")
        return read_shot(Path(folder, "shot.toml"))


def _list(values: Any) -> str:
    return "[" + ", ".join(f"{float(each):.5f}" for each in values) + "]"
