"""Roots that ride on animated skins: bound once at rest, evaluated at any time."""

from __future__ import annotations

import warnings
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, InputWarning, Problem
from featherfx.groom.keys.values import Place
from featherfx.groom.skin.skin import Binding, bind, follow, is_flat
from featherfx.groom.types import Groom
from featherfx.shot.motion.joints import roots_at_rest
from featherfx.shot.motion.roots import RootFrames
from featherfx.shot.read.sources import Surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_KEPT = 16  # poses; the groups of feathers of one frame ask for the same few times
_MOST_NAMED = 10


@dataclass(frozen=True)
class SkinRoot:
    """Where one root sits, for the output: prim path, face, points (3,) and their weights (3,)."""

    path: str
    face: int
    points: Indices
    barycentric: Array


@dataclass(frozen=True)
class _Part:
    """The roots of one surface. members: (R,) feathers. binding: their places on the skin."""

    surface: Surface
    members: Indices
    binding: Binding
    triangles: Indices


@dataclass(frozen=True)
class BoundSkin:
    """The F roots of a groom on one or more surfaces.

    ids: of the feathers. rotations: (F, 3, 3) at rest. start: time code at 0 s. parts: surfaces
    with their roots; every root is on one. roots: of each feather.
    """

    ids: tuple[str, ...]
    rotations: Array
    start: float
    parts: tuple[_Part, ...]
    roots: tuple[SkinRoot, ...]
    _poses: OrderedDict[float, RootFrames] = field(default_factory=OrderedDict, repr=False)

    def frames(self, time: float) -> RootFrames:
        """Root frames at a time in s.

        Raises InputError where a triangle that carries a root has collapsed.
        """
        if time not in self._poses:
            self._poses[time] = self._evaluated(time)
            if len(self._poses) > _KEPT:
                self._poses.popitem(last=False)
        return RootFrames(*(values.copy() for values in self._poses[time]))

    def _evaluated(self, time: float) -> RootFrames:
        positions, rotations = np.zeros((len(self.ids), 3)), self.rotations.copy()
        for part in self.parts:
            surface, members = part.surface, part.members
            code = self.start + time * surface.time_codes_per_second
            corners = surface.corners(code, part.triangles)
            self._check(part, corners, code)
            moved, carriers = follow(part.binding, corners, surface.is_mirrored(code))
            positions[members] = moved
            rotations[members] = carriers @ self.rotations[members]
        return RootFrames(positions, rotations)

    def _check(self, part: _Part, corners: Array, code: float) -> None:
        own = np.arange(3 * len(corners)).reshape(-1, 3)
        bad = np.flatnonzero(
            is_flat(corners.reshape(-1, 3), own) | ~np.isfinite(corners).all(axis=(1, 2))
        )
        if len(bad) == 0:
            return
        face = part.surface.face[part.binding.triangle[bad[0]]]
        feather = self.ids[part.members[bad[0]]]
        more = f" (and {len(bad) - 1} more roots)" if len(bad) > 1 else ""
        fault = "has no area" if np.isfinite(corners[bad[0]]).all() else "is not finite"
        message = f"face {face} {fault} at time code {code:g}; '{feather}' sits on it{more}"
        raise InputError(Problem(part.surface.path, "points", message))


def bind_groom(
    groom: Groom, surfaces: Sequence[Surface], start: float, tolerance: float, place: Place
) -> BoundSkin:
    """Bind the roots of a groom to their surfaces: the one a feather names, else the first.

    tolerance: m; roots that are farther give an InputWarning with their ids and distances.
    """
    index = {surface.path: number for number, surface in enumerate(surfaces)}
    chosen = np.array([index.get(feather.skin, 0) for feather in groom.feathers], dtype=np.int64)
    by_uv = np.array([feather.skin_uv is not None for feather in groom.feathers], dtype=np.bool_)
    at_rest = roots_at_rest(groom)
    parts = []
    for number, surface in enumerate(surfaces):
        for at_uv in (False, True):
            members = np.flatnonzero((chosen == number) & (by_uv == at_uv))
            if len(members):
                uv = np.array([groom.feathers[k].skin_uv for k in members]) if at_uv else None
                parts.append(_part(surface, members, at_rest.positions[members], uv))
                _warn(groom, parts[-1], tolerance, place)
    roots = dict(pair for part in parts for pair in _roots(part))
    return BoundSkin(
        ids=tuple(feather.id for feather in groom.feathers),
        rotations=at_rest.rotations,
        start=start,
        parts=tuple(parts),
        roots=tuple(roots[k] for k in range(len(groom.feathers))),
    )


def _part(surface: Surface, members: Indices, positions: Array, uv: Array | None) -> _Part:
    """Bind roots, by their places in texture space where uv (R, 2) is given."""
    search = None
    if uv is not None and surface.st is not None:
        flat = np.zeros((len(surface.st), 3, 3))
        flat[:, :, :2] = surface.st
        search = np.column_stack([uv, np.zeros(len(uv))]), flat
    binding = bind(positions, surface.rest, surface.triangles, search)
    return _Part(surface, members, binding, surface.triangles[binding.triangle])


def _roots(part: _Part) -> Iterator[tuple[int, SkinRoot]]:
    """By numbers of the feathers."""
    path, binding = part.surface.path, part.binding
    faces = part.surface.face[binding.triangle]
    each = zip(part.members, faces, part.triangles, binding.barycentric, strict=True)
    for member, face, points, weights in each:
        yield int(member), SkinRoot(path, int(face), points, weights)


def _warn(groom: Groom, part: _Part, tolerance: float, place: Place) -> None:
    far = np.flatnonzero(part.binding.distance > tolerance)
    if len(far) == 0:
        return
    far = far[np.argsort(-part.binding.distance[far], kind="stable")]
    named = ", ".join(
        f"'{groom.feathers[part.members[k]].id}' {part.binding.distance[k]:.3g} m"
        for k in far[:_MOST_NAMED]
    )
    more = f" and {len(far) - _MOST_NAMED} more" if len(far) > _MOST_NAMED else ""
    warnings.warn(
        f"{place.source}: {place.key}: roots farther than {tolerance:g} m from "
        f"{part.surface.path}: {named}{more}",
        InputWarning,
        stacklevel=2,
    )
