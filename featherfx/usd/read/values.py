"""Stages of others as files and values: located, opened from disk, and what their prims hold.

Files are found by folder or asset resolver, and their metadata is checked. A value (attribute,
primvar, transform) that USD cannot read, or that is of another type than expected, is one
InputError with the file, the path of the prim or attribute, the value and the expected type.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Sdf, Tf, Usd, UsdGeom

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.groom.keys.problems import Place
from featherfx.limits import irregular
from featherfx.usd.types import refuse_unfit_usd
from featherfx.usd.write.options import UP_AXES

DEFAULT_TIME, EARLIEST_TIME = Usd.TimeCode.Default(), Usd.TimeCode.EarliestTime()

# what USD's Python binding raises at values that it cannot read or hand over
USD_ERRORS = (Tf.ErrorException, UnicodeDecodeError, RuntimeError, OverflowError)

_TEXTS = (Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.Token)
# characters of what USD says of an error
_MAX_TOLD = 2000


@dataclass(frozen=True)
class ArrayKind:
    """Type of an array: numpy kinds of its numbers, shape of an element, name in messages."""

    numbers: str
    element: tuple[int, ...]
    name: str


VECTOR_ARRAY = ArrayKind("fiu", (3,), "an array of 3 numbers each")
PAIR_ARRAY = ArrayKind("fiu", (2,), "an array of 2 numbers each")
QUATERNION_ARRAY = ArrayKind("f", (4,), "an array of quaternions")
NUMBER_ARRAY = ArrayKind("fiu", (), "an array of numbers")
INTEGER_ARRAY = ArrayKind("iu", (), "an array of integers")
MATRIX_ARRAY = ArrayKind("f", (4, 4), "an array of 4 x 4 matrices")


def fault(thing: Any, message: str) -> InputError:
    """Return the error of an attribute, relationship or prim."""
    return InputError(
        Problem(str(thing.GetStage().GetRootLayer().identifier), _describe_path(thing), message)
    )


def _describe_path(thing: Any) -> str:
    """Return the path of an attribute, relationship or prim, whatever its bytes."""
    try:
        return str(thing.GetPath())
    except USD_ERRORS:
        return "a path that is no text"


def describe_error(error: BaseException) -> str:
    """Return the message of a USD error, in one line."""
    if isinstance(error, UnicodeDecodeError):
        return "holds bytes that are no UTF-8 text"
    if not isinstance(error, Tf.ErrorException):
        return " ".join(str(error).split())
    try:
        # the first is the cause; the last may say only that a layer failed to open
        told = str(error.args[0].commentary) if error.args else "it does not say why"
    except UnicodeDecodeError:
        return "holds bytes that are no UTF-8 text"
    # of a damaged file it may quote gigabytes
    text = " ".join(told[:_MAX_TOLD].split())
    is_newer = "version mismatch" in text or "'spline'" in text
    return f"{text}. Update usd-core, or save it without splines" if is_newer else text


@contextmanager
def usd_errors(thing: Any) -> Iterator[None]:
    """Turn an error of USD into an InputError that names an attribute, relationship or prim."""
    try:
        yield
    except USD_ERRORS as error:
        raise fault(thing, f"USD cannot read it: {describe_error(error)}") from error


@contextmanager
def errors_at(place: Place) -> Iterator[None]:
    """Turn an error of USD into an InputError that names a place."""
    try:
        yield
    except (Tf.ErrorException, UnicodeDecodeError) as error:
        place.refuse(f"USD cannot read it: {describe_error(error)}")


@contextmanager
def collect_errors(place: Place) -> Iterator[None]:
    """Add the problems of an InputError, or of USD, to those of a place and continue."""
    with place.problems.collecting(), errors_at(place):
        yield


def read_value(attribute: Any, code: Any = DEFAULT_TIME) -> Any:
    """Return any value at a time; None where there is no attribute or no value."""
    if not attribute:
        return None
    try:
        value = attribute.Get(code)
    except USD_ERRORS as error:
        message = f"USD cannot read it {describe_time(code)}: {describe_error(error)}"
        raise fault(attribute, message) from error
    if value is None and attribute.GetTypeName().scalarType in _TEXTS:
        # older USD prints that a text is no UTF-8, and gives no value
        info = attribute.GetResolveInfo(code)
        if info.GetSource() != Usd.ResolveInfoSourceNone and not info.ValueIsBlocked():
            raise fault(attribute, f"holds bytes {describe_time(code)} that are no UTF-8 text")
    if isinstance(value, Sdf.UnregisteredValue):
        raise fault(attribute, f"is of a type that USD does not know, {attribute.GetTypeName()}")
    return value


def read_array(attribute: Any, code: Any, kind: ArrayKind) -> NDArray[Any] | None:
    """Return (N, ...) an array; None without a value. Shares memory where USD allows it."""
    value = read_value(attribute, code)
    return None if value is None else to_numpy(value, kind, attribute, describe_time(code))


def read_sized_array(attribute: Any, code: Any, kind: ArrayKind) -> NDArray[Any]:
    """Return an array as read_array does, empty without a value."""
    found = read_array(attribute, code, kind)
    return np.empty((0, *kind.element)) if found is None else found


def read_flattened(primvar: Any, code: Any) -> Any:
    """Return any value of a primvar at a time, its indices resolved; None without a value."""
    if not primvar or not primvar.HasValue():
        return None
    attribute = primvar.GetAttr()
    value = read_value(attribute, code)
    if value is None or not primvar.IsIndexed():
        return value
    indices = read_array(primvar.GetIndicesAttr(), code, INTEGER_ARRAY)
    with usd_errors(attribute):
        found = primvar.ComputeFlattened(code)
    if found is None and indices is not None:
        raise fault(attribute, "its indices do not fit its values")
    return found


def to_numpy(value: Any, kind: ArrayKind, attribute: Any, where: str = "") -> NDArray[Any]:
    """Return a value as numpy; raises InputError for another type of array."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError, *USD_ERRORS):
        found = np.asarray(None)
    if found.size == 0 and found.ndim == 1 and found.dtype.kind in "fiu":
        found = found.reshape(0, *kind.element)  # empty arrays of vectors are one-dimensional
    if found.ndim != 1 + len(kind.element) or (
        found.shape[1:] != kind.element or found.dtype.kind not in kind.numbers
    ):
        told = f"is {describe_value(value)} {where}".rstrip()
        raise fault(attribute, f"{told}, expects {kind.name}")
    return found


def list_elements(value: Any) -> Any:
    """Return the elements of an array, or one value as the only element."""
    return value if type(value).__name__.endswith("Array") else [value]


def describe_range(count: int) -> str:
    """Return what is wrong with an index that names none of some elements, and the range."""
    if not count:
        return "names one of none. Leave it empty"
    return f"is out of range. Give 0 to {count - 1}"


def describe_value(value: Any) -> str:
    """Return a value in words: type and size of an array, or a short value itself."""
    if isinstance(value, float):
        return f"{value:g}"
    name = type(value).__name__
    if name.endswith("Array") and hasattr(value, "__len__"):
        return f"{name} of {len(value)}"
    try:
        text = repr(value)
    except USD_ERRORS:
        return name
    return text if len(text) <= 40 else f"{text[:37]}..."


def read_number(attribute: Any, code: Any, low: float, high: float) -> float | None:
    """Return a number from low to high; None without a value."""
    value = read_value(attribute, code)
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not low <= value <= high:
        given = f"{describe_value(value)} {describe_time(code)}"
        message = f"is {given}, expects a number from {low:g} to {high:g}"
        raise fault(attribute, message)
    return float(value)


def read_text(attribute: Any, code: Any = DEFAULT_TIME) -> str:
    """Return a text, the first of several; empty without a value."""
    value = read_value(attribute, code)
    if value is None:
        return ""
    texts = [value] if isinstance(value, str) else value
    if not hasattr(texts, "__len__") or not all(isinstance(each, str) for each in texts):
        raise fault(attribute, f"is {describe_value(value)}, expects a text")
    return str(texts[0]) if len(texts) else ""


def read_texts(attribute: Any, code: Any = DEFAULT_TIME) -> list[str]:
    """Return several texts; none without a value."""
    value = read_value(attribute, code)
    found = [] if value is None else value
    if isinstance(found, str) or not hasattr(found, "__len__"):
        raise fault(attribute, f"is {describe_value(value)}, expects several texts")
    with usd_errors(attribute):
        texts = list(found)
    if not all(isinstance(each, str) for each in texts):
        raise fault(attribute, f"is {describe_value(value)}, expects several texts")
    return texts


def read_times(attribute: Any) -> list[float]:
    """Return time codes of the samples of an attribute, in order; none without it.

    A spline has its knots, and where it goes on beyond them the ends of the stage's range, which a
    value has, too, that USD finds elsewhere.
    """
    if not attribute:
        return []
    with usd_errors(attribute):
        times = list(attribute.GetTimeSamples())
        if not times and attribute.ValueMightBeTimeVarying():
            stage = attribute.GetStage()
            ends = [stage.GetStartTimeCode(), stage.GetEndTimeCode()]
            has_spline = hasattr(attribute, "HasSpline") and attribute.HasSpline()
            times = _read_spline_times(attribute.GetSpline(), ends) if has_spline else ends
    if times and not np.isfinite(times).all():
        raise fault(attribute, f"has samples at time codes that are no numbers: {times}")
    return times


def _read_spline_times(spline: Any, ends: list[float]) -> list[float]:
    from pxr import Ts

    has_loops = getattr(spline, "HasInnerLoops", bool)()
    knots = list(spline.GetKnotsWithInnerLoopsBaked() if has_loops else spline.GetKnots())
    modes = (each.mode for each in (spline.GetPreExtrapolation(), spline.GetPostExtrapolation()))
    goes_on = any(mode not in (Ts.ExtrapHeld, Ts.ExtrapValueBlock) for mode in modes)
    return sorted({*knots, *ends}) if goes_on else knots


def read_targets(relationship: Any) -> list[Any]:
    """Return the paths that a relationship names."""
    with usd_errors(relationship):
        return list(relationship.GetForwardedTargets())


def read_matrix(prim: Any, code: Any) -> Array:
    """Return (4, 4) from local space of a prim to the stage's, row vectors.

    By default, where an operation has only samples, all are at the first of these.
    """
    if code.IsDefault() or code.IsEarliestTime():
        transforms = list(list_transforms(prim))
        if code.IsEarliestTime() or any(read_value(each) is None for each in transforms):
            first = [times[0] for each in transforms if (times := read_times(each))]
            code = Usd.TimeCode(min(first)) if first else DEFAULT_TIME
    with usd_errors(prim):
        found = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code)
    return np.array(found)


def list_transforms(prim: Any) -> Iterator[Any]:
    """Yield the attributes of the transforms of a prim and of all above it."""
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            operations = compute(prim, UsdGeom.Xformable(prim).GetOrderedXformOps)
            yield from (each.GetAttr() for each in operations)
        prim = prim.GetParent()


def read_inverse(prim: Any, code: Any) -> Array:
    """Return (4, 4) from space of the stage to a prim's local one, row vectors."""
    try:
        return np.asarray(np.linalg.inv(read_matrix(prim, code)))
    except np.linalg.LinAlgError as error:
        raise fault(prim, "has transforms without an inverse, such as a scale of 0") from error


def compute(thing: Any, compute: Callable[..., Any], *arguments: Any) -> Any:
    """Return a value that USD computes of an attribute, relationship or prim."""
    with usd_errors(thing):
        return compute(*arguments)


def describe_time(code: Any) -> str:
    """Return a time code in words."""
    if code.IsEarliestTime():
        return "at first"
    return "by default" if code.IsDefault() else f"at time code {code.GetValue():g}"


def locate_file(folder: Path, name: str) -> Path:
    """Return the path of a file that is named relative to a folder.

    An existing file is returned as seen from the folder, also with backslashes. Else the asset
    resolver of this process is asked, which knows search paths (PXR_AR_DEFAULT_SEARCH_PATH) and, in
    a studio, addresses such as asset:bird. Without an answer the path is as seen from the folder.
    """
    own = folder / name
    if own.exists():
        return own
    if "\\" in name and (other := folder / name.replace("\\", "/")).exists():
        return other  # as Windows writes it
    refuse_unfit_usd()
    resolver = Ar.GetResolver()
    beside = str(folder.absolute() / "shot.usda")  # need not be there
    context = resolver.CreateDefaultContextForAsset(beside)
    with Ar.ResolverContextBinder(context):
        asked = resolver.CreateIdentifier(name, Ar.ResolvedPath(beside))
        found = resolver.Resolve(asked).GetPathString()
    return Path(found) if found else own


def locate_package(path: Path) -> tuple[Path, str]:
    """Return the file on disk, and what is named in it: a.usdz and b.usda of a.usdz[b.usda]."""
    package, inner = Ar.SplitPackageRelativePathOuter(str(path))
    return Path(package), inner


# (low, high) of what a stage says of itself; far beyond any stage in use, far within float32
_METADATA_RANGES = {
    "metersPerUnit": (1e-9, 1e9),
    "timeCodesPerSecond": (1e-3, 1e9),
    "framesPerSecond": (1e-3, 1e9),
    "startTimeCode": (-1e9, 1e9),
    "endTimeCode": (-1e9, 1e9),
}


def open_stage(path: str | Path) -> Any:
    """Open a USD file with all payloads.

    Raises InputError if that fails, if layers form a cycle, and for invalid units, axis, rates and
    time range.
    """
    path = locate_file(Path(), str(path))
    file, inner = locate_package(path)
    if not file.is_file():
        fault = irregular(file)
        told = f"{fault}. Name a USD file" if fault else "there is no such file. Check the path"
        raise InputError(Problem(str(path), "", told))
    if not os.access(file, os.R_OK):
        raise InputError(Problem(str(path), "", "may not be read. Check its permissions"))
    if Sdf.FileFormat.FindByExtension(inner or str(path)) is None:
        told, more = "no USD file", ""
        if path.suffix == ".toml":
            told = "a TOML file: a groom, shot or preset"
            more = ". `featherfx groom` and `featherfx bake` write one"
        raise InputError(Problem(str(path), "", f"is {told}, expects .usd, .usda or .usdc{more}"))
    refuse_unfit_usd()
    if inner and is_zipfile(file):
        with ZipFile(file) as package:
            names = package.namelist()
        if Ar.SplitPackageRelativePathOuter(inner)[0] not in names:
            known = ", ".join(names) or "nothing"
            raise InputError(Problem(str(path), "", f"{file.name} has no {inner}. Give {known}"))
    opened = str(path)
    try:
        stage = Usd.Stage.Open(opened)
        # USD keeps layers that are open elsewhere in this process; the file may be newer. Layers
        # with edits that are not saved belong to the host, and are read as they stand there.
        for layer in stage.GetUsedLayers():
            if not layer.dirty:
                opened = layer.realPath or opened
                layer.Reload()
        opened = str(path)
        problems = [*_cycles(stage, opened), *_wrong_metadata(stage, opened)]
    except USD_ERRORS as error:
        problem = Problem(opened, "", f"USD cannot open it: {describe_error(error)}")
        raise InputError(problem) from error
    require(*problems)
    return stage


def _cycles(stage: Any, path: str) -> Iterator[Problem]:
    """Yield a problem for a layer that is a sublayer of itself; USD omits it without an error."""

    def walk(layer: Any, above: tuple[str, ...]) -> list[str]:
        names = (*above, layer.realPath)
        if layer.realPath in above:
            return list(names[names.index(layer.realPath) :])
        below = (
            Sdf.Layer.Find(Sdf.ComputeAssetPathRelativeToLayer(layer, name))
            for name in layer.subLayerPaths
            if name
        )
        return next((found for each in below if each and (found := walk(each, names))), [])

    cycle = walk(stage.GetRootLayer(), ())
    if cycle:
        yield Problem(path, "subLayers", f"form a cycle: {' -> '.join(cycle)}")


def _wrong_metadata(stage: Any, path: str) -> Iterator[Problem]:
    units = {"metersPerUnit": UsdGeom.GetStageMetersPerUnit(stage)}
    codes = {
        name: stage.GetMetadata(name)
        for name in ("startTimeCode", "endTimeCode")
        if stage.HasAuthoredMetadata(name)
    }
    for name, value in (units | codes).items():
        yield from _out_of_range(path, name, value)
    axis = str(UsdGeom.GetStageUpAxis(stage))
    if axis not in UP_AXES:
        yield Problem(path, "upAxis", f"is '{axis}', expects {' or '.join(UP_AXES)}")
    # of every layer: USD scales the time of sublayers and references by the ratio of their rates
    for layer in stage.GetUsedLayers():
        file = path if layer == stage.GetRootLayer() else layer.realPath
        if layer.HasTimeCodesPerSecond():
            yield from _out_of_range(file, "timeCodesPerSecond", layer.timeCodesPerSecond)
        elif layer.HasFramesPerSecond():
            yield from _out_of_range(file, "framesPerSecond", layer.framesPerSecond)


def _out_of_range(file: str, name: str, value: Any) -> Iterator[Problem]:
    low, high = _METADATA_RANGES[name]
    if not isinstance(value, int | float) or not low <= value <= high:
        told = f"{value:g}" if isinstance(value, int | float) else describe_value(value)
        yield Problem(file, name, f"is {told}. Give {low:g} to {high:g}")


def read_note(stage: Any, name: str, default: Any) -> Any:
    """Return what featherfx noted in a cache by name; the default where its type is another."""
    told = stage.GetRootLayer().customLayerData.get("featherfx")
    found = told.get(name) if isinstance(told, dict) else None
    return found if isinstance(found, type(default)) else default


def read_scenery(stage: Any) -> Iterator[dict[str, Any]]:
    """Yield the scenery of a shot in its cache, without malformed entries."""
    entries = read_note(stage, "scenery", {})
    texts, numbers = ("role", "file", "prim"), ("start", "first", "time_codes_per_frame")
    kinds = {name: str if name in texts else float for name in texts + numbers}
    for entry in entries.values():
        if isinstance(entry, dict) and all(
            isinstance(entry.get(key), kind) for key, kind in kinds.items()
        ):
            yield entry if isinstance(entry.get("rest", 0.0), float) else {**entry, "rest": None}
