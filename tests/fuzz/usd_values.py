"""Edits of the values, properties and prims of a USD layer, as its interface makes them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pxr import Gf, Sdf
from usdin_scenes import TYPES

Random = np.random.Generator


def edit_value(random: Random, layer: Sdf.Layer) -> str:
    """One attribute, relationship or prim of a layer changed; says which and how."""
    properties: list[Sdf.Path] = []
    prims: list[Sdf.Path] = []

    def note(path: Sdf.Path) -> None:
        if path.IsPropertyPath():
            properties.append(path)
        elif path.IsPrimPath():
            prims.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, note)
    if not properties or random.random() < 0.1:
        return _edit_prim(random, layer, prims)
    spec = layer.GetPropertyAtPath(properties[random.integers(len(properties))])
    if isinstance(spec, Sdf.RelationshipSpec):
        targets = (["/none"], [], ["/bird"], [str(spec.path)], [str(spec.path.GetPrimPath())])
        spec.targetPathList.explicitItems = targets[random.integers(len(targets))]
        return f"{spec.path} targets"
    edit = VALUE_EDITS[random.integers(len(VALUE_EDITS))]
    path = str(spec.path)
    edit(random, layer, spec)
    return f"{path} {edit.__name__[1:]}"


def _edit_prim(random: Random, layer: Sdf.Layer, prims: list[Sdf.Path]) -> str:
    path = prims[random.integers(len(prims))]
    prim = layer.GetPrimAtPath(path)
    types = ("Mesh", "BasisCurves", "PointInstancer", "Xform", "Camera", "Nothing", "Points")
    which = random.integers(4)
    if which == 0:
        prim.typeName = types[random.integers(len(types))]
    elif which == 1:
        prim.specifier = (Sdf.SpecifierOver, Sdf.SpecifierClass)[random.integers(2)]
    elif which == 2:
        prim.active = False
    else:
        prim.instanceable = True
    return f"{path} prim {which}"


def _change(layer: Sdf.Layer, spec: Sdf.AttributeSpec, random: Random, change: Callable) -> None:
    """The default, or one sample, as change(numpy array) makes it."""
    times = layer.ListTimeSamplesForPath(spec.path)
    time = times[random.integers(len(times))] if times else None
    value = spec.default if time is None else layer.QueryTimeSample(spec.path, time)
    if not hasattr(type(value), "FromNumpy"):
        return
    array = change(np.array(value))
    made = type(value).FromNumpy(np.ascontiguousarray(array))
    if time is None:
        spec.default = made
    else:
        layer.SetTimeSample(spec.path, time, made)


def _emptied(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    _change(layer, spec, random, lambda array: array[:0])


def _cleared(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    if random.random() < 0.5:
        layer.GetPrimAtPath(spec.path.GetPrimPath()).RemoveProperty(spec)
    else:
        spec.default = Sdf.ValueBlock()


def _shorter(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    _change(layer, spec, random, lambda array: array[: random.integers(len(array) + 1)])


def _longer(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    _change(layer, spec, random, lambda array: np.concatenate([array, array[:3]]))


def _spoilt(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    def change(array: np.ndarray) -> np.ndarray:
        if array.size and array.dtype.kind == "f":
            odd = (np.nan, np.inf, -np.inf, 1e30, 3e38, -1.0, 0.0)
            with np.errstate(over="ignore"):
                array.flat[random.integers(array.size)] = odd[random.integers(len(odd))]
        return array

    _change(layer, spec, random, change)


def _far_index(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    def change(array: np.ndarray) -> np.ndarray:
        if array.size and array.dtype.kind == "i":
            odd = (-1, 2**31 - 1, -(2**31), len(array), 10**6)
            array.flat[random.integers(array.size)] = odd[random.integers(len(odd))]
        return array

    _change(layer, spec, random, change)


def _retyped(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    prim, name = layer.GetPrimAtPath(spec.path.GetPrimPath()), spec.name
    values = (
        (TYPES.String, "x"), (TYPES.StringArray, ["x"]), (TYPES.IntArray, [1, -1]),
        (TYPES.Float, 2.0), (TYPES.Point3fArray, []),
        (TYPES.Double3Array, [(1, 2, 3)]), (TYPES.FloatArray, [1.0, 2.0]), (TYPES.Asset, "x"),
        (TYPES.Matrix4d, Gf.Matrix4d(1)), (TYPES.QuatfArray, [Gf.Quatf(1)]), (TYPES.Bool, True),
        (TYPES.Float2Array, [(1, 2)]), (TYPES.TokenArray, []), (TYPES.Int64, 5),
    )  # fmt: skip
    kind, value = values[random.integers(len(values))]
    prim.RemoveProperty(spec)
    Sdf.AttributeSpec(prim, name, kind).default = value


def _sampled(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    value = spec.default
    if value is None:
        return
    code = (1.5, -7.0, 1e12, float("inf"), 3.0, float("nan"))[random.integers(6)]
    layer.SetTimeSample(spec.path, code, value)


def _odd_info(random: Random, layer: Sdf.Layer, spec: Sdf.AttributeSpec) -> None:
    key, values = (
        ("interpolation", ("vertex", "uniform", "constant", "faceVarying", "varying", "odd")),
        ("elementSize", (0, -1, 2, 10**9)),
        ("unauthoredValuesIndex", (-2, 0, 10**9)),
    )[random.integers(3)]
    spec.SetInfo(key, values[random.integers(len(values))])


VALUE_EDITS = (
    _emptied, _cleared, _shorter, _longer, _spoilt, _spoilt, _far_index, _retyped, _sampled,
    _odd_info,
)  # fmt: skip
