"""Roots that ride on animated skins: bound once at rest, evaluated at any time."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, InputWarning, Problem
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import Binding, bound_before, closest, follow, is_flat, may_be_flat
from featherfx.groom.types import Groom
from featherfx.shot.clock import StageClock
from featherfx.shot.roots import RootFrames
from featherfx.shot.sources import MovingSurface

_MAX_NAMED = 10


@dataclass(frozen=True)
class SkinRoot:
    """Place of one root, for the output: prim path, face, points (3,) and their weights (3,)."""

    path: str
    face: int
    points: Indices
    barycentric: Array


@dataclass(frozen=True)
class _Part:
    """The roots of one surface. members: (R,) feathers. binding: their places on the skin.

    triangles: (U, 3) points of those that the binding uses.
    """

    surface: MovingSurface
    members: Indices
    binding: Binding
    triangles: Indices


@dataclass(frozen=True)
class BoundSkin:
    """The F roots of a groom on one or more surfaces.

    ids: of the feathers. rotations: (F, 3, 3) at rest. parts: surfaces with their roots; every root
    is on one. roots: of each feather.
    """

    ids: tuple[str, ...]
    rotations: Array
    clock: StageClock
    parts: tuple[_Part, ...]
    roots: tuple[SkinRoot, ...]

    def frames(self, time: float) -> RootFrames:
        """Root frames at a time in s.

        Raises InputError where a triangle that carries a root has collapsed.
        """
        positions, rotations = np.zeros((len(self.ids), 3)), self.rotations.copy()
        for part in self.parts:
            surface, members = part.surface, part.members
            code = self.clock.code(time)
            corners = surface.corners(code, part.triangles)
            self._check(part, corners, code)
            moved, carriers = follow(part.binding, corners, surface.is_mirrored(code))
            positions[members] = moved
            rotations[members] = carriers @ self.rotations[members]
        return RootFrames(positions, rotations)

    def led(self, change: Callable[[MovingSurface], MovingSurface], clock: StageClock) -> BoundSkin:
        """The same roots on changed surfaces, under another clock."""
        surfaces = {id(part.surface): part.surface for part in self.parts}
        changed = {key: change(each) for key, each in surfaces.items()}
        parts = tuple(replace(part, surface=changed[id(part.surface)]) for part in self.parts)
        return replace(self, parts=parts, clock=clock)

    def _check(self, part: _Part, used: Array, code: float) -> None:
        if not may_be_flat(used):
            return
        corners = used[part.binding.own]
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
        message = (
            f"face {face} {fault} at time code {code:g}. '{feather}' sits on it{more}. "
            "Keep its area"
        )
        raise InputError(Problem(part.surface.path, "points", message))


@dataclass(frozen=True)
class SkinSurfaces:
    """Surfaces that the roots of a groom ride on, before they are bound.

    surfaces: a feather's is the one that it names, else the first. tolerance: m; roots that are
    farther give a warning, which names source and key. radius: m, of the skin that turns a root;
    None: the distance of roots, at most the feather's width.
    """

    surfaces: tuple[MovingSurface, ...]
    clock: StageClock
    tolerance: float
    source: str
    key: str
    radius: float | None = None

    def bind(self, groom: Groom) -> BoundSkin:
        """Bind the roots of a groom; an InputWarning tells those that are far, with distances."""
        index = {surface.path: number for number, surface in enumerate(self.surfaces)}
        chosen = np.array(
            [index.get(feather.skin, 0) for feather in groom.feathers], dtype=np.int64
        )
        parts = []
        roots: list[SkinRoot | None] = [None] * len(groom.feathers)
        for number, surface in enumerate(self.surfaces):
            members = np.flatnonzero(chosen == number)
            placed = np.array([groom.feathers[k].skin_uv is not None for k in members], dtype=bool)
            radii = _radii(groom, surface, members, self.radius)
            for which in (~placed, placed):
                some = members[which]
                if len(some) == 0:
                    continue
                part = _part(groom, surface, some, radii[which])
                parts.append(part)
                self._warn(groom, part)
                located = surface.locate(part.binding.triangle, part.binding.barycentric)
                for k, (face, points, weights) in enumerate(zip(*located, strict=True)):
                    roots[some[k]] = SkinRoot(surface.path, int(face), points, weights)
        return BoundSkin(
            ids=tuple(feather.id for feather in groom.feathers),
            rotations=np.array([f.rotation for f in groom.feathers]).reshape(-1, 3, 3),
            clock=self.clock,
            parts=tuple(parts),
            roots=tuple(root for root in roots if root is not None),
        )

    def _warn(self, groom: Groom, part: _Part) -> None:
        bones = {each.name for each in groom.joints if each.bone is not None}
        bones = bones if part.surface.bones is not None else set()  # which hold them instead
        held = np.array([groom.feathers[k].joint in bones for k in part.members])
        distance = np.where(held, 0.0, part.binding.distance)
        far = np.flatnonzero(distance > self.tolerance)
        if len(far) == 0:
            return
        far = far[np.argsort(-distance[far], kind="stable")]
        named = ", ".join(
            f"'{groom.feathers[part.members[k]].id}' {distance[k]:.3g} m" for k in far[:_MAX_NAMED]
        )
        more = f" and {len(far) - _MAX_NAMED} more" if len(far) > _MAX_NAMED else ""
        warnings.warn(
            f"{self.source}: {self.key}: roots farther than {self.tolerance:g} m from "
            f"{part.surface.path}: {named}{more}",
            InputWarning,
            stacklevel=2,
        )


def _radii(groom: Groom, surface: MovingSurface, members: Indices, given: float | None) -> Array:
    """(R,) m, of the skin that turns each root: as given, or the mean distance to the two nearest
    roots, at most the width of the feather; of a skeleton the length of its bone."""
    if given is not None:
        return np.full(len(members), given)
    if surface.bones is not None and len(members):
        places = np.array([groom.feathers[k].position for k in members], dtype=np.float64)
        bone, _ = closest(places, surface.rest[surface.triangles])
        return surface.bones[bone]
    widths = np.array([groom.feathers[k].kind.width for k in members])
    if len(members) < 3:
        return widths
    places = np.array([groom.feathers[k].position for k in members], dtype=np.float64)
    distances, _ = search_tree(places).query(places, k=3)
    return np.minimum(distances[:, 1:].mean(axis=1), widths)


def _part(groom: Groom, surface: MovingSurface, members: Indices, radii: Array) -> _Part:
    """Feathers of one surface, all of them or none placed by skin uv. radii: (R,) m."""
    positions = np.array([groom.feathers[k].position for k in members], dtype=np.float64)
    shafts = np.array([groom.feathers[k].rotation[:, 0] for k in members], dtype=np.float64)
    uv = [place for k in members if (place := groom.feathers[k].skin_uv) is not None]
    search = None
    if uv and surface.st is not None:
        flat = np.zeros((len(surface.st), 3, 3))
        flat[:, :, :2] = surface.st
        search = np.column_stack([np.array(uv), np.zeros(len(uv))]), flat
    binding = bound_before(positions, surface.rest, surface.triangles, search, radii, shafts)
    return _Part(surface, members, binding, surface.triangles[binding.used])
