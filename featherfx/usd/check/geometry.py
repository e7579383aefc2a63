"""Checks of one mesh or curve prim."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from pxr import Usd, UsdGeom

from featherfx.errors import InputError
from featherfx.usd.read.cached_feather import read_members
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    USD_ERRORS,
    VECTOR_ARRAY,
    describe_range,
    list_elements,
    read_array,
    read_note,
    read_sized_array,
    read_text,
    read_times,
    read_value,
    usd_errors,
)
from featherfx.usd.types import (
    DIAGNOSTICS,
    HOOK_PRIMVARS,
    HOOKED_PRIMVAR,
    RANGES_PREFIX,
    RATES,
    WET_PRIMVARS,
)

Faults = Iterator[tuple[str, str]]

# of one attribute that are in memory together
_WINDOW_BYTES = 64_000_000

# Relative to the size of the object: rounding of float32 in the many ways that it is summed.
_EXTENT_TOLERANCE = 1e-5
# Cosine between a face and the mean of its vertex normals, below which the face is flipped.
_FLIPPED = -0.2
_CONSTANT_ATTRIBUTES = (
    "faceVertexCounts", "faceVertexIndices", "curveVertexCounts", "subdivisionScheme",
    "orientation", "doubleSided", "primvars:st", "primvars:Pref", "primvars:rest",
    "primvars:featherId", "primvars:featherKind", "primvars:region", "primvars:side",
)  # fmt: skip
_DIAGNOSED = [
    *HOOK_PRIMVARS,
    *WET_PRIMVARS,
    *(name for names in DIAGNOSTICS.values() for name in names),
]
_NOTHING = np.asarray(None)
_OF_PRIMVARS = "{{}} values. Interpolation {} asks for {{}}"
_PER_FACE = ("primvars:barbDirection", *_DIAGNOSED)
_SAMPLED_WITH_POINTS = (*RATES, "normals", "extent", *_PER_FACE)
_KINDS = {
    **dict.fromkeys(("points", *RATES, "normals", "extent"), VECTOR_ARRAY),
    **dict.fromkeys(("faceVertexCounts", "faceVertexIndices", "curveVertexCounts"), INTEGER_ARRAY),
    **dict.fromkeys(("widths", *_DIAGNOSED), NUMBER_ARRAY),
    "primvars:barbDirection": VECTOR_ARRAY,
}


@lru_cache(maxsize=1 << 16)
def _time_code(code: float) -> Any:
    """Return one USD time code for all prims; USD is slow to make them."""
    return Usd.TimeCode(code)


class SampleSeries(NamedTuple):
    """Values of an attribute at some of its time samples, in order; None: no value.

    stacked: (T, ...) all; None where there are none, or of different shapes.
    """

    codes: list[Any]
    values: list[Any]
    stacked: Any

    @classmethod
    def of(cls, codes: list[Any], values: list[Any]) -> SampleSeries:
        shapes = {None if each is None else each.shape for each in values}
        if len(shapes) != 1 or not shapes - {None, ()}:
            return cls(codes, values, None)
        joined = np.concatenate(values)
        return cls(codes, values, joined.reshape(len(values), *values[0].shape))


def geometry_problems(prim: Any) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return (attribute, message) of contradictions on a mesh or curve, and of broken promises.

    A value that cannot be read is the last of the former: checks that depend on it are skipped.
    """
    faults: list[tuple[str, str]] = []
    habits: list[tuple[str, str]] = []
    try:
        with usd_errors(prim):
            check = GeometryCheck(prim)
            for found in check.faults():
                faults.append(found)
            for found in check.habits():
                habits.append(found)
    except InputError as error:
        start = len(str(prim.GetPath())) + 1
        faults += [(each.key[start:] or "primvars", each.message) for each in error.problems]
    return faults, habits


class GeometryCheck:
    """Checks of one UsdGeom.Mesh or UsdGeom.BasisCurves; any other point set in part."""

    def __init__(self, prim: Any) -> None:
        self._prim = prim
        self._attributes: dict[str, Any] = {}
        self._codes_of: dict[str, list[float]] = {}
        self._windows: dict[str, tuple[int, SampleSeries]] = {}
        self._defaults: dict[str, Any] = {}
        self._half_width: float | None = None
        self._mesh = UsdGeom.Mesh(prim) if prim.IsA(UsdGeom.Mesh) else None
        self._curves = UsdGeom.Curves(prim) if prim.IsA(UsdGeom.Curves) else None
        self._codes = self._times("points")
        self._indices = self._value("faceVertexIndices", None)
        name = "faceVertexCounts" if self._mesh else "curveVertexCounts"
        self._counts = self._value(name, None)
        self._points = len(self._value("points", None))
        # samples that are looked at together
        self._at_once = max(1, _WINDOW_BYTES // (12 * max(self._points, len(self._counts), 1)))

    def faults(self) -> Faults:
        """Yield contradictions: sizes, indices, values that are not finite, windings."""
        topology = list(self._topology())
        yield from topology
        yield from self._counted("points", self._points, "{} points, not {}")
        for name in ("points", *_SAMPLED_WITH_POINTS):
            yield from self._over_time(name, _not_finite, _may_not_be_finite)
        for name in RATES:
            yield from self._over_time(name, self._not_per_point, self._may_not_be_per_point)
        yield from self._normals_and_widths()
        yield from self._primvars()
        if self._mesh and not topology:
            yield from self._subsets()
            yield from self._flipped()
        yield from self._shared()

    def habits(self) -> Faults:
        """Yield broken promises of caches: extents, and sample times."""
        yield from self._sample_times()
        yield from self._static_samples()
        yield from self._over_time("extent", self._wrong_extent, self._may_not_fit)
        for primvar in UsdGeom.PrimvarsAPI(self._prim).GetPrimvars():
            name = str(primvar.GetAttr().GetName())
            # the schema of skeletons wants plain values for some of its own
            if not primvar.GetTypeName().isArray and not name.startswith("primvars:skel:"):
                yield name, "is not an array. Some readers drop it"

    def _attribute(self, name: str) -> Any:
        if name not in self._attributes:
            self._attributes[name] = self._prim.GetAttribute(name)
        return self._attributes[name]

    def _times(self, name: str) -> list[float]:
        if name not in self._codes_of:
            self._codes_of[name] = read_times(self._attribute(name))
        return self._codes_of[name]

    def _moves_rigidly(self) -> bool:
        return any(
            op.MightBeTimeVarying() for op in UsdGeom.Xformable(self._prim).GetOrderedXformOps()
        )

    def _default(self, name: str) -> Any:
        """Return the default value of an attribute, read once."""
        if name not in self._defaults:
            self._defaults[name] = self._read(name, DEFAULT_TIME)
        return self._defaults[name]

    def _window(self, name: str, first: int) -> SampleSeries:
        """Return samples of an attribute from a number on, as many as are tested together."""
        known = self._windows.get(name)
        if known is None or known[0] != first:
            self._windows.pop(name, None)
            chosen = self._times(name)[first : first + self._at_once]
            codes = [_time_code(code) for code in chosen]
            known = self._windows[name] = first, SampleSeries.of(codes, self._samples(name, codes))
        return known[1]

    def _all_windows(self, name: str) -> Iterator[SampleSeries]:
        for first in range(0, len(self._times(name)), self._at_once):
            yield self._window(name, first)

    def _samples(self, name: str, codes: Sequence[Any]) -> list[Any]:
        """Return values as _read does, at all times; a query resolves the layers once."""
        kind = _KINDS.get(name)
        if kind is None or not codes:
            return [self._read(name, code) for code in codes]
        query, found = Usd.AttributeQuery(self._attribute(name)), []
        for code in codes:
            try:
                value = np.asarray(query.Get(code))
            except (TypeError, ValueError, *USD_ERRORS):
                value = _NOTHING
            sound = value.dtype.kind in kind.numbers and value.shape[1:] == kind.element
            found.append(value if sound and value.ndim else self._read(name, code))
        return found

    def _read(self, name: str, code: Any) -> Any:
        """Return an attribute as numpy, of the type that its name implies; None without a value."""
        if name in _KINDS:
            return read_array(self._attribute(name), code, _KINDS[name])
        value = read_value(self._attribute(name), code)
        return None if value is None else np.asarray(list_elements(value))

    def _value(self, name: str, code: Any) -> Any:
        found = self._read(name, EARLIEST_TIME if code is None else code)
        return np.empty(0) if found is None else found

    def _over_time(
        self, name: str, test: Callable[[Any, Any], str], may_fail: Callable[[Any, Any], Any] | None
    ) -> Faults:
        """Run a test of (value, code) at every time of an attribute; report the first failure.

        may_fail: from all samples (T, ...) and their codes, the samples that need the test.
        """
        attribute = self._attribute(name)
        if not attribute or not attribute.HasAuthoredValue():
            return
        message, first, count = "", None, 0
        for value, code in self._suspects(name, may_fail):
            found = test(value, code) if value is not None else ""
            if found:
                count += 1
                if first is None:
                    message, first = found, code
        if first is not None:
            when = "as default" if first.IsDefault() else f"at time {first.GetValue():g}"
            more = f" (and at {count - 1} more)" if count > 1 else ""
            yield name, f"{when}: {message}{more}"

    def _suspects(
        self, name: str, may_fail: Callable[[Any, Any], Any] | None
    ) -> Iterator[tuple[Any, Any]]:
        """Yield values with their time codes: the default, and the samples that need a test."""
        yield self._default(name), DEFAULT_TIME
        for series in self._all_windows(name):
            chosen: Sequence[int] = range(len(series.codes))
            if may_fail is not None and series.stacked is not None:
                chosen = np.flatnonzero(may_fail(series.stacked, series.codes)).tolist()
            for number in chosen:
                yield series.values[number], series.codes[number]

    def _topology(self) -> Faults:
        if self._mesh:
            if self._counts.sum() != len(self._indices):
                yield (
                    "faceVertexCounts",
                    f"sum is {int(self._counts.sum())}, but there are {len(self._indices)} indices",
                )
            wrong = self._indices[(self._indices < 0) | (self._indices >= self._points)]
            if len(wrong):
                yield "faceVertexIndices", f"{int(wrong[0])} {describe_range(self._points)}"
            if len(self._counts) and self._counts.min() < 3:
                yield "faceVertexCounts", "a face has fewer than 3 points"
        elif self._curves and self._counts.sum() != self._points:
            yield (
                "curveVertexCounts",
                f"sum is {int(self._counts.sum())}, but there are {self._points} points",
            )

    def _sample_times(self) -> Faults:
        stage = self._prim.GetStage()
        handles = read_note(stage, "handles", 0)
        first, last = stage.GetStartTimeCode() - handles, stage.GetEndTimeCode() + handles
        outside = [code for code in self._codes if not first <= code <= last]
        if outside:
            yield (
                "points",
                f"sample at time {outside[0]:g} is outside the stage's {first:g} to {last:g}",
            )
        for name in _SAMPLED_WITH_POINTS:
            attribute = self._attribute(name)
            if not attribute or not attribute.HasAuthoredValue():
                if name == "extent":
                    yield name, "missing"
            elif name == HOOKED_PRIMVAR and not self._times(name):
                pass  # hooks that all hold, in part at rest, never change
            elif name in _PER_FACE and not self._codes and self._moves_rigidly():
                pass  # what is told of each face goes on where points stand still in their space
            elif self._times(name) != self._codes:
                yield (
                    name,
                    f"{len(self._times(name))} samples, not at the times of the"
                    f" {len(self._codes)} samples of points",
                )

    def _static_samples(self) -> Faults:
        for name in _CONSTANT_ATTRIBUTES:
            if self._times(name):
                yield name, f"time samples (first at {self._times(name)[0]:g}), but never changes"
        if self._codes:
            rest = self._default("points")
            rest = np.empty(0) if rest is None else rest
            samples = (value for each in self._all_windows("points") for value in each.values)
            if all(np.array_equal(sample, rest) for sample in samples):
                yield "points", f"{len(self._codes)} samples, all equal to the default value"

    def _counted(self, name: str, expected: int, told: str) -> Faults:
        """Report the first time at which an attribute has another number of values."""

        def test(value: Any, code: Any) -> str:
            return "" if len(value) == expected else told.format(len(value), expected)

        def may_fail(samples: Any, codes: Any) -> Any:
            return np.full(len(samples), samples.shape[1] != expected)

        yield from self._over_time(name, test, may_fail)

    def _not_per_point(self, value: Any, code: Any) -> str:
        points = len(self._value("points", code))
        return "" if len(value) == points else f"{len(value)} values for {points} points"

    def _may_not_be_per_point(self, samples: Any, codes: Any) -> Any:
        points = self._points_at(codes)
        fits = points is not None and points.shape[1] == samples.shape[1]
        return np.full(len(samples), not fits)

    def _points_at(self, codes: Any) -> Any:
        """Return (T, P, 3) at these codes if the points are sampled there; else None."""
        first = bisect_left(self._times("points"), codes[0].GetValue())
        if first % self._at_once:
            return None
        points = self._window("points", first)
        return points.stacked if points.codes == codes else None

    def _may_not_fit(self, samples: Any, codes: Any) -> Any:
        points = self._points_at(codes)
        if points is None or points.shape[1] == 0 or samples.shape[1:] != (2, 3):
            return np.ones(len(samples), dtype=np.bool_)
        actual = np.stack([points.min(axis=1), points.max(axis=1)], axis=1)
        actual += np.array([-self._padding(), self._padding()])[:, None]
        size = np.abs(actual).max(axis=(1, 2)), np.ptp(actual, axis=1).max(axis=1)
        error = np.abs(actual - samples).max(axis=(1, 2))
        # sums differ in their last digits, and what is not finite is worth the test, too
        return ~(error <= 0.5 * _EXTENT_TOLERANCE * np.maximum(*size))

    def _padding(self) -> float:
        """Return half of the greatest width of curves."""
        if self._curves is None:
            return 0.0
        if self._half_width is None:
            self._half_width = 0.5 * float(self._value("widths", None).max(initial=0.0))
        return self._half_width

    def _wrong_extent(self, value: Any, code: Any) -> str:
        points = self._value("points", code)
        if len(points) == 0 or not (np.isfinite(points).all() and np.isfinite(value).all()):
            return ""
        padding = self._padding()
        actual = np.stack([points.min(axis=0) - padding, points.max(axis=0) + padding])
        if value.shape != actual.shape:
            return f"{len(value)} corners, not 2"
        scale = max(float(np.abs(actual).max()), float(np.ptp(actual, axis=0).max()))
        error = float(np.abs(actual - value).max())
        return "" if error <= _EXTENT_TOLERANCE * scale else f"off by {error:.3g} stage units"

    def _expected(self, interpolation: str) -> int:
        per_point = self._points
        faces = len(self._counts) if self._mesh or self._curves else 1
        corners = len(self._indices) if self._mesh else per_point
        table = {"constant": 1, "uniform": faces, "faceVarying": corners}
        return table.get(interpolation, per_point)

    def _normals_and_widths(self) -> Faults:
        geometry = UsdGeom.PointBased(self._prim)
        kinds = {"normals": geometry.GetNormalsInterpolation()}
        if self._curves:
            kinds["widths"] = self._curves.GetWidthsInterpolation()
        for name, interpolation in kinds.items():
            told = _OF_PRIMVARS.format(interpolation)
            yield from self._counted(name, self._expected(interpolation), told)

    def _primvars(self) -> Faults:
        for primvar in UsdGeom.PrimvarsAPI(self._prim).GetPrimvars():
            interpolation, name = primvar.GetInterpolation(), str(primvar.GetAttr().GetName())
            expected = self._expected(interpolation) * primvar.GetElementSize()
            if not primvar.GetTypeName().isArray:
                continue
            if primvar.IsIndexed():
                yield from self._indexed(primvar, name, interpolation, expected)
            else:
                yield from self._counted(name, expected, _OF_PRIMVARS.format(interpolation))

    def _indexed(self, primvar: Any, name: str, interpolation: str, expected: int) -> Faults:
        told = _OF_PRIMVARS.format(interpolation)
        yield from self._counted(f"{name}:indices", expected, told)
        indices = read_sized_array(primvar.GetIndicesAttr(), DEFAULT_TIME, INTEGER_ARRAY)
        value = read_value(primvar.GetAttr())
        values = () if value is None else list_elements(value)
        if len(indices) and not 0 <= indices.min() <= indices.max() < len(values):
            yield f"{name}:indices", describe_range(len(values))

    def _subsets(self) -> Faults:
        families: dict[str, list[Any]] = {}
        for subset in UsdGeom.Subset.GetAllGeomSubsets(self._mesh):
            indices = read_sized_array(subset.GetIndicesAttr(), DEFAULT_TIME, INTEGER_ARRAY).astype(
                int
            )
            name = subset.GetPrim().GetName()
            if len(indices) and not 0 <= indices.min() <= indices.max() < len(self._counts):
                yield f"{name}.indices", describe_range(len(self._counts))
                continue
            families.setdefault(read_text(subset.GetFamilyNameAttr()), []).append(indices)
        for family, members in families.items():
            kind = UsdGeom.Subset.GetFamilyType(self._mesh, family) if family else ""
            use = np.bincount(np.concatenate(members), minlength=len(self._counts))
            if kind != UsdGeom.Tokens.unrestricted and use.max(initial=0) > 1:
                yield f"subsetFamily:{family}", f"{int((use > 1).sum())} faces in several subsets"
            if kind == UsdGeom.Tokens.partition and use.min(initial=1) < 1:
                yield f"subsetFamily:{family}", f"{int((use < 1).sum())} faces in no subset"

    def _shared(self) -> Faults:
        """Check the tables of a prim that feathers share."""
        members = read_members(self._prim)
        totals = {"points": self._points, "faces": len(self._counts)}
        for name, total in totals.items() if members else ():
            told = sum(getattr(members[-1], name))
            if told != total:
                element = "curves" if self._curves and name == "faces" else name
                yield f"{RANGES_PREFIX}:{element}", f"ends at {told}, but there are {total}"

    def _flipped(self) -> Faults:
        """Report windings against the normals in the rest pose; in motion a thin tube may fold."""
        rest = Usd.TimeCode.Default()
        code = rest if len(self._value("normals", rest)) else None
        points, normals = self._value("points", code), self._value("normals", code)
        fits = len(normals) == len(points) == self._points > 0
        if not fits or (self._counts != 3).any():
            return
        if read_text(self._attribute("orientation")) == UsdGeom.Tokens.leftHanded:
            normals = -normals
        corners = self._indices.reshape(-1, 3)
        a, b, c = (points[corners[:, k]].astype(float) for k in range(3))
        outward, mean = np.cross(b - a, c - a), normals[corners].mean(axis=1)
        size = np.linalg.norm(outward, axis=1) * np.linalg.norm(mean, axis=1)
        flipped = np.flatnonzero((outward * mean).sum(axis=1) < _FLIPPED * size)
        if len(flipped):
            message = f"{len(flipped)} faces face away from their normals, the first is"
            yield "faceVertexIndices", f"at rest: {message} {flipped[0]}"


def _not_finite(value: Any, code: Any) -> str:
    wrong = np.flatnonzero(
        ~np.isfinite(value.reshape(len(value), int(value[:1].size) or 1)).all(axis=1)
    )
    return f"not finite in {len(wrong)} elements, the first is {wrong[0]}" if len(wrong) else ""


def _may_not_be_finite(samples: Any, codes: Any) -> Any:
    return np.full(len(samples), not np.isfinite(samples).all())
