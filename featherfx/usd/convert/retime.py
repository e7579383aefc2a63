"""Retimed caches: slower, faster, along keys, or closed to a loop.

Points between two samples follow the cubic through both that has the velocities of both. A new
sample is a sum of old ones, sum_i w_i x(t_i), where weights and old times change with the new time
s. Its velocity is the derivative of that sum, sum_i w_i x'(t_i) t_i' + w_i' x(t_i). Its
acceleration is sum_i w_i (x'' t_i'^2 + x' t_i'') + 2 w_i' x' t_i' + w_i'' x.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf
from scipy.interpolate import PchipInterpolator

from featherfx.algebra.types import Array, Floats
from featherfx.algebra.vectors import unit
from featherfx.errors import InputError, Problem, as_figure, require_type
from featherfx.phases import Progress, counted, tells_progress
from featherfx.usd.arrays import vec3f
from featherfx.usd.convert.merge import begin_export, copy_layer, flatten_stage
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    DETAIL_ATTRIBUTE,
    ORIENT_PRIMVAR,
)

# frames of a new cache
_MAX_FRAMES = 1_000_000
# of a feather's length, how far apart its root may be where a loop closes
_ROOT_TOLERANCE = 1e-3
_DIRECTIONS = ("normals", BARB_DIRECTION, ORIENT_PRIMVAR)


@dataclass(frozen=True)
class BlendedTime:
    """Contribution of one old time to a new sample.

    code: old time code. rate, bend: its first and second derivative by the new one. weight,
    weight_rate, weight_bend: of the sum, and its derivatives by the new time code.
    """

    code: float
    rate: float = 1.0
    bend: float = 0.0
    weight: float = 1.0
    weight_rate: float = 0.0
    weight_bend: float = 0.0


@dataclass(frozen=True)
class TimeMap:
    """Map from new frames to the old times that they blend.

    first, last: new frames. parts: old times by new frame.
    """

    first: int
    last: int
    parts: Callable[[float], tuple[BlendedTime, ...]]


def map_keys(keys: Sequence[tuple[float, float]], range_: tuple[float, float]) -> TimeMap:
    """Return time that passes smoothly through keys of a new and an old frame, without overshoot.

    range_: first and last frame of the cache. Raises InputError for fewer than two keys, new frames
    that do not increase, and old ones outside.
    """
    if any(not isinstance(key, Sequence) or len(key) != 2 for key in keys):
        raise _argument_error("keys", f"are {keys}. Give pairs (new frame, old frame)")
    new, old = ([key[k] for key in keys] for k in (0, 1))
    if len(keys) < 2:
        raise _argument_error("keys", "needs at least two of them, NEW:OLD each")
    for before, after in pairwise(new):
        if after <= before:
            raise _argument_error(
                "keys", f"have new frame {after:g} after {before:g}, it has to be later"
            )
    for each in old:
        if not range_[0] <= each <= range_[1]:
            raise _argument_error(
                "keys", f"name frame {each:g}, the cache has {range_[0]:g} to {range_[1]:g}"
            )
    if new[-1] - new[0] > _MAX_FRAMES:
        raise _argument_error("keys", f"span {new[-1] - new[0]:g} frames, at most {_MAX_FRAMES}")
    course = PchipInterpolator(new, old)
    rate, bend = course.derivative(), course.derivative(2)

    def parts(frame: float) -> tuple[BlendedTime, ...]:
        code = min(max(float(course(frame)), range_[0]), range_[1])
        return (BlendedTime(code, float(rate(frame)), float(bend(frame))),)

    return TimeMap(int(np.ceil(new[0])), int(np.floor(new[-1])), parts)


def map_speed(speed: float, range_: tuple[float, float]) -> TimeMap:
    """Return the whole cache at a speed, in its frames per new frame, from its first frame on.

    Raises InputError unless speed is above 0 and leaves at least one whole frame.
    """
    first, last = range_
    if not 0.0 < speed < np.inf:
        raise _argument_error("speed", f"is {speed:g}. Give a value above 0")
    frames = (last - first) / speed
    if not 1.0 <= frames <= _MAX_FRAMES:
        allowed = f"allowed {(last - first) / _MAX_FRAMES:g} to {last - first:g}"
        raise _argument_error(
            "speed", f"is {speed:g}, {allowed} for a cache of {last - first + 1:g} frames"
        )
    return map_keys([(first, first), (first + frames, last)], range_)


def map_loop(frames: int, range_: tuple[float, float]) -> TimeMap:
    """Return the last frames of a cache, blended so that they end as they begin.

    The frames before them are faded in, over as many frames as there are, so that position,
    velocity and acceleration are continuous. Raises InputError where nothing comes before them.
    """
    first, last = range_
    start = last - frames
    fade = min(start - first, frames)
    if not (frames >= 1 and fade >= 1):
        message = (
            f"a loop of {frames} frames is blended with those before it, so it needs a cache of"
            f" at least {max(frames, 1) + 2}. This one has {last - first + 1:g}"
        )
        raise _argument_error("loop", message)

    def parts(frame: float) -> tuple[BlendedTime, ...]:
        old = start + (frame - first)
        u = (old - last) / fade + 1.0
        if u <= 0.0:
            return (BlendedTime(old),)
        # rises from 0 to 1 with two derivatives that vanish at both ends
        weight = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        rate = 30.0 * u**2 * (1.0 - u) ** 2 / fade
        bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / fade**2
        earlier = BlendedTime(old - frames, 1.0, 0.0, weight, rate, bend)
        return (BlendedTime(old, 1.0, 0.0, 1.0 - weight, -rate, -bend), earlier)

    return TimeMap(int(first), int(first) + frames, parts)


@tells_progress
def retime(
    path: str | Path,
    output: str | Path,
    *,
    speed: float | None = None,
    keys: Sequence[tuple[float, float]] | None = None,
    loop: int | None = None,
    overwrite: bool = False,
    progress: Progress = False,
) -> Path:
    """Write a cache in another time as one plain USD file, a sample at each whole frame.

    One of: speed, frames of the cache that pass in one of the new (0.5 is slow motion); keys, pairs
    of a new and an old frame, through which time passes smoothly, backwards as well; loop, number
    of frames at the cache's end that become a loop, of which the last is the first. Velocities,
    accelerations and extents are those of the new motion; what is constant stays. The samples of
    both are in memory. progress: as of featherfx.phases.tells_progress. Raises InputError where the
    cache cannot be read, the output not be written, time not be mapped so, or roots not be where a
    loop needs them.
    """
    if sum(each is not None for each in (speed, keys, loop)) != 1:
        raise InputError(Problem("retime", "", "takes one of speed, keys and loop"))
    require_type("path", path, str | Path, "the path of a cache, such as cache.path")
    require_type("speed", speed, Real | None, "a number, such as 0.5 for slow motion")
    require_type("loop", loop, Integral | None, "a whole number of frames")
    stage, written = begin_export(path, output, overwrite)
    range_ = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not (stage.HasAuthoredTimeCodeRange() and range_[0] < range_[1]):
        raise InputError(Problem(str(path), "", "has no frames to retime. Give a baked cache"))
    if speed is not None:
        times = map_speed(speed, range_)
    elif keys is not None:
        times = map_keys(keys, range_)
    else:
        times = map_loop(int(loop or 0), range_)
    old = flatten_stage(stage)
    prims = [_RetimedPrim(old, each) for each in _sampled_prims(old)]
    if loop is not None:
        _check_roots(prims, loop, range_, str(path))
    layer, rate = copy_layer(old), stage.GetTimeCodesPerSecond()
    parts = counted("writing", prims, len(prims))
    bounds = [corners for prim in parts for corners in prim.write(layer, times, rate)]
    hint = layer.GetAttributeAtPath(stage.GetDefaultPrim().GetPath().AppendProperty("extentsHint"))
    if hint:
        rest = np.asarray(hint.default)
        every = np.array([*bounds, *([rest] if rest.shape == (2, 3) else [])])
        hint.default = vec3f([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])
    layer.startTimeCode, layer.endTimeCode = times.first, times.last
    # no bake may resume from it
    layer.customLayerData = {"featherfx": {"retimed": Path(path).name}}
    return written(layer)


class _Track:
    """Samples of one attribute, read when they are needed."""

    def __init__(self, layer: Any, path: Any) -> None:
        self._layer, self.path = layer, path
        self.codes = layer.ListTimeSamplesForPath(path)
        first = self.raw(self.codes[0])
        self.kind, self.number = type(first), np.asarray(first).dtype
        self.shape = np.shape(first)
        self._near: dict[float, Any] = {}

    def raw(self, code: float) -> Any:
        """Return the USD value at one of the codes."""
        return self._layer.QueryTimeSample(self.path, code)

    def written(self, value: Any) -> Any:
        """Return a value in the type of the samples."""
        if isinstance(value, self.kind):
            return value
        array = np.ascontiguousarray(value, dtype=self.number)
        return (
            self.kind.FromNumpy(array)
            if hasattr(self.kind, "FromNumpy")
            else self.kind(*array.tolist())
        )

    def _at(self, index: int) -> Any:
        code = self.codes[index]
        if code not in self._near:
            if len(self._near) > 4:
                self._near.clear()
            found = np.asarray(self.raw(code), dtype=np.float64)
            self.refuse_shape(code, found.shape)
            self._near[code] = found
        return self._near[code]

    def refuse_shape(self, code: float, found: tuple[int, ...]) -> None:
        """Raise InputError where a sample is not of this track's shape."""
        if found != self.shape:
            told = f"has {_count(found)} values at time code {code:g}, not {_count(self.shape)}"
            raise InputError(Problem(str(self.path), "", f"{told}. Bake it again"))

    def around(self, code: float) -> tuple[int, int, float]:
        """Return the samples before and after a code, and the fraction of the way between."""
        after = int(np.clip(np.searchsorted(self.codes, code), 1, max(1, len(self.codes) - 1)))
        if len(self.codes) == 1:
            return 0, 0, 0.0
        start, end = self.codes[after - 1], self.codes[after]
        return after - 1, after, float(np.clip((code - start) / (end - start), 0.0, 1.0))

    def linear(self, code: float) -> Any:
        """Return the value at any code, linear between samples."""
        one, other, u = self.around(code)
        return (1.0 - u) * self._at(one) + u * self._at(other)

    def turning(self, code: float) -> Any:
        """Return quaternions as `linear` does; two of opposite sign are one rotation."""
        one, other, u = self.around(code)
        first, second = self._at(one), self._at(other)
        sign = np.where((first * second).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
        return (1.0 - u) * first + u * sign * second

    def cubic(self, code: float, slopes: _Track | None, rate: float) -> tuple[Any, Any, Any]:
        """Return value, first and second derivative by the time code, on a cubic between samples.

        slopes: units per second; None: of a parabola through neighbouring samples. rate: time codes
        per second.
        """
        one, other, u = self.around(code)
        start, end = self._at(one), self._at(other)
        if one == other:
            return start, np.zeros_like(start), np.zeros_like(start)
        span = self.codes[other] - self.codes[one]
        first, last = (
            span * (self._slope(k) if slopes is None else slopes._at(k) / rate)
            for k in (one, other)
        )
        c, d = 3.0 * (end - start) - 2.0 * first - last, 2.0 * (start - end) + first + last
        value = start + u * (first + u * (c + u * d))
        velocity = (first + u * (2.0 * c + 3.0 * u * d)) / span
        return value, velocity, (2.0 * c + 6.0 * u * d) / span**2

    def _slope(self, k: int) -> Any:
        low, high = max(k - 1, 0), min(k + 1, len(self.codes) - 1)
        slopes = [
            (self._at(i + 1) - self._at(i)) / (self.codes[i + 1] - self.codes[i])
            for i in range(low, high)
        ]
        if len(slopes) == 1:
            return slopes[0]
        spans = [self.codes[i + 1] - self.codes[i] for i in (low, low + 1)]
        return (spans[1] * slopes[0] + spans[0] * slopes[1]) / sum(spans)


class _RetimedPrim:
    """A prim with samples, and its new ones."""

    def __init__(self, layer: Any, path: Any) -> None:
        spec = layer.GetPrimAtPath(path)
        self.path, self._spec = path, spec
        sampled = (p for p in spec.properties if layer.ListTimeSamplesForPath(p.path))
        self.tracks = {p.name: _Track(layer, p.path) for p in sampled}
        for name in ("velocities", ACCELERATIONS) if "points" in self.tracks else ():
            if name in self.tracks:
                rates = self.tracks[name]
                self.tracks["points"].refuse_shape(rates.codes[0], rates.shape)
        widths = spec.properties.get("widths")
        self._padding = max(widths.default or (0.0,)) if widths is not None else 0.0

    def is_shaft(self) -> bool:
        """Return whether the curves are the rachises of feathers."""
        return (
            "curveVertexCounts" in self._spec.properties and "primvars:up" in self._spec.properties
        )

    def roots(self, code: float) -> tuple[Array, Array]:
        """Return (M, 3) first points of all curves, and (M,) their lengths."""
        points = self.tracks["points"].linear(code)
        counts = np.asarray(self._spec.properties["curveVertexCounts"].default)
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        steps = np.linalg.norm(np.diff(points, axis=0, append=points[-1:]), axis=1)
        steps[starts + counts - 1] = 0.0
        return points[starts], np.add.reduceat(steps, starts)

    def write(self, layer: Any, times: TimeMap, rate: float) -> Iterator[Floats]:
        """Replace the samples in a layer that has the prim, and yield the corners of each frame."""
        for track in self.tracks.values():
            for code in track.codes:
                layer.EraseTimeSample(track.path, code)
        for frame in range(times.first, times.last + 1):
            parts = times.parts(frame)
            values = self._derived(parts, rate)
            for name, track in self.tracks.items():
                if name not in values and name != "extent":
                    values[name] = self._summed(name, track, parts)
            for name, value in values.items():
                track = self.tracks[name]
                layer.SetTimeSample(track.path, frame, track.written(value))
            if "extent" in self.tracks and "points" in values:
                points = np.asarray(values["points"], dtype=np.float32)
                pad = np.float32(0.5) * np.float32(self._padding)
                corners = np.array([points.min(axis=0) - pad, points.max(axis=0) + pad])
                layer.SetTimeSample(self.tracks["extent"].path, frame, vec3f(corners))
                yield corners

    def _derived(self, parts: Sequence[BlendedTime], rate: float) -> dict[str, Any]:
        """Return points, barb nodes, velocities and accelerations of a new sample."""
        values: dict[str, Any] = {}
        slopes = self.tracks.get("velocities")
        for name in ("points", *BARB_NODE_PRIMVARS):
            if name not in self.tracks:
                continue
            own = slopes if name == "points" else None
            all_of = [self.tracks[name].cubic(each.code, own, rate) for each in parts]
            paired = list(zip(parts, all_of, strict=True))
            values[name] = sum(p.weight * x for p, (x, _, _) in paired)
            if name == "points" and "velocities" in self.tracks:
                values["velocities"] = rate * sum(
                    p.weight * p.rate * v + p.weight_rate * x for p, (x, v, _) in paired
                )
            if name == "points" and ACCELERATIONS in self.tracks:
                values[ACCELERATIONS] = rate**2 * sum(
                    p.weight * (self.tracks[ACCELERATIONS].linear(p.code) / rate**2 * p.rate**2)
                    + p.weight * v * p.bend
                    + 2.0 * p.weight_rate * v * p.rate
                    + p.weight_bend * x
                    for p, (x, v, _) in paired
                )
        return values

    def _summed(self, name: str, track: _Track, parts: Sequence[BlendedTime]) -> Any:
        """Return a value without rates: directions stay unit vectors.

        A value that is no number is that of the sample before.
        """
        if name == DETAIL_ATTRIBUTE:
            return np.rint(sum(part.weight * track.linear(part.code) for part in parts))
        if not np.issubdtype(track.number, np.floating):
            return track.raw(track.codes[track.around(parts[0].code)[0]])
        read = track.turning if name == ORIENT_PRIMVAR else track.linear
        values = [read(each.code) for each in parts]
        if name == ORIENT_PRIMVAR and len(values) == 2:
            sign = np.sign((values[0] * values[1]).sum(axis=-1, keepdims=True))
            values[1] = np.where(sign < 0.0, -1.0, 1.0) * values[1]
        total = sum(part.weight * each for part, each in zip(parts, values, strict=True))
        return unit(total) if name in _DIRECTIONS else total


def _sampled_prims(layer: Any) -> list[Any]:
    found: dict[Any, None] = {}

    def look(path: Any) -> None:
        if path.IsPropertyPath() and layer.ListTimeSamplesForPath(path):
            found[path.GetPrimPath()] = None

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return list(found)


def _check_roots(
    prims: Sequence[_RetimedPrim], frames: int, range_: tuple[float, float], source: str
) -> None:
    """Raise InputError where roots do not repeat after the frames of a loop."""
    start, end = max(range_[0], range_[1] - 2 * frames), range_[1] - frames
    for prim in prims:
        if not prim.is_shaft() or "points" not in prim.tracks:
            continue
        for code in (start, 0.5 * (start + end), end):
            here, lengths = prim.roots(code)
            there, _ = prim.roots(code + frames)
            apart = np.linalg.norm(here - there, axis=1) / lengths
            worst = float(apart.max())
            if worst > _ROOT_TOLERANCE:
                message = (
                    f"a root in {prim.path} is {as_figure(100.0 * worst)} % of its feather's length"
                    f" away at frame {code + frames:g} from where it is at {code:g}, more"
                    f" than {100.0 * _ROOT_TOLERANCE:g} %. Give the period of the motion"
                )
                raise InputError(Problem(source, "loop", message))


def _count(shape: tuple[int, ...]) -> int:
    return shape[0] if shape else 1


def _argument_error(key: str, message: str) -> InputError:
    return InputError(Problem("retime", key, message))
