"""Faces of USD meshes cut into triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from featherfx.usd import arrays
from featherfx.usd.scene import EARLIEST

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def fans(counts: Indices) -> tuple[Indices, Indices]:
    """(T, 3) places in the list of face corners, and (T,) faces, of fans of all faces."""
    cuts = np.maximum(counts - 2, 0)
    face = np.repeat(np.arange(len(counts)), cuts)
    starts = (np.cumsum(counts) - counts)[face]
    step = np.arange(len(face)) - (np.cumsum(cuts) - cuts)[face]
    return np.stack([starts, starts + step + 1, starts + step + 2], axis=1), face


def triangles_of(mesh: Any) -> tuple[Indices, Indices, Array | None]:
    """(T, 3) point indices, (T,) faces and (T, 3, 2) texture coordinates (None: none) of a mesh.

    Faces in holeIndices are left out; left-handed faces are turned round, so that the outside is
    counter-clockwise. The mesh's topology must be sound.
    """
    counts = arrays.to_numpy(mesh.GetFaceVertexCountsAttr().Get(EARLIEST)).astype(np.int64)
    indices = arrays.to_numpy(mesh.GetFaceVertexIndicesAttr().Get(EARLIEST)).astype(np.int64)
    places, face = fans(counts)
    holes = arrays.to_numpy(mesh.GetHoleIndicesAttr().Get(EARLIEST))
    if len(holes):
        kept = ~np.isin(face, holes)
        places, face = places[kept], face[kept]
    if str(mesh.GetOrientationAttr().Get(EARLIEST)) == UsdGeom.Tokens.leftHanded:
        places = places[:, [0, 2, 1]]
    return indices[places], face, _texture(mesh, indices, places)


def _texture(mesh: Any, indices: Indices, places: Indices) -> Array | None:
    primvar = UsdGeom.PrimvarsAPI(mesh.GetPrim()).FindPrimvarWithInheritance("st")
    value = primvar.ComputeFlattened(EARLIEST) if primvar and primvar.HasValue() else None
    if value is None:
        return None
    st = arrays.to_numpy(value)
    if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying and len(st) == len(indices):
        return np.asarray(st[places], dtype=np.float64)
    if len(st) > indices.max(initial=-1) and st.ndim == 2:
        return np.asarray(st[indices[places]], dtype=np.float64)
    return None
