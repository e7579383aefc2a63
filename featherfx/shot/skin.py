"""Roots that ride on animated skins: bound once at rest, evaluated at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem, some_of, warn_input
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import (
    Binding,
    borrow_turns,
    bound_before,
    closest,
    find_sound,
    follow,
)
from featherfx.groom.types import Groom
from featherfx.shot.frames import StageClock
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

    @cached_property
    def rest(self) -> Array:
        """(U, 3, 3) m, corners of these at rest."""
        return self.surface.rest[self.triangles]


@dataclass(frozen=True)
class BoundSkin:
    """The F roots of a groom on one or more surfaces.

    ids: of the feathers. rotations: (F, 3, 3) at rest. parts: surfaces with their roots; every root
    is on one. roots: of each feather. on_collapse: borrow turns, or error.
    """

    ids: tuple[str, ...]
    rotations: Array
    clock: StageClock
    parts: tuple[_Part, ...]
    roots: tuple[SkinRoot, ...]
    on_collapse: str = "borrow"
    _warned: set[str] = field(default_factory=set)

    def frames(self, time: float) -> RootFrames:
        """Root frames at a time in s.

        Where a triangle that carries a root has collapsed, those around turn it, with a warning.
        Raises InputError where there are none, or where that is asked for.
        """
        positions, rotations = np.zeros((len(self.ids), 3)), self.rotations.copy()
        for part in self.parts:
            surface, members = part.surface, part.members
            code = self.clock.code(time)
            corners = surface.corners(code, part.triangles)
            binding, sound = self._on_collapsed(part, corners, code)
            moved, carriers = follow(binding, corners, surface.is_mirrored(code))
            if sound is not None and not sound.all():
                moved, carriers = _with_nearest(part, corners, carriers, sound)
            positions[members] = moved
            rotations[members] = carriers @ self.rotations[members]
        return RootFrames(positions, rotations)

    def some(self, chosen: Indices) -> BoundSkin:
        """Return the roots of feathers (K,), by numbers in ascending order."""
        parts = []
        for part in self.parts:
            kept = np.isin(part.members, chosen)
            if kept.any():
                binding = part.binding.some(kept)
                members = np.searchsorted(chosen, part.members[kept])
                triangles = part.surface.triangles[binding.used]
                parts.append(_Part(part.surface, members, binding, triangles))
        return replace(
            self,
            ids=tuple(self.ids[k] for k in chosen),
            rotations=self.rotations[chosen],
            parts=tuple(parts),
            roots=tuple(self.roots[k] for k in chosen),
            _warned=set(),
        )

    def carriers(self, time: float) -> Array:
        """(F, 3) m, points of the skin that roots stand over at a time in s."""
        points, code = np.zeros((len(self.ids), 3)), self.clock.code(time)
        for part in self.parts:
            corners = part.surface.corners(code, part.triangles[part.binding.own])
            points[part.members] = np.einsum("rk,rkc->rc", part.binding.barycentric, corners)
        return points

    def led(self, change: Callable[[MovingSurface], MovingSurface], clock: StageClock) -> BoundSkin:
        """The same roots on changed surfaces, under another clock."""
        surfaces = {id(part.surface): part.surface for part in self.parts}
        changed = {key: change(each) for key, each in surfaces.items()}
        parts = tuple(replace(part, surface=changed[id(part.surface)]) for part in self.parts)
        return replace(self, parts=parts, clock=clock)

    def _on_collapsed(self, part: _Part, used: Array, code: float) -> tuple[Binding, Flags | None]:
        """The binding with roots on collapsed triangles left to those around, and (R,) which roots
        have a turn; None: nothing has collapsed. used: (U, 3, 3) m."""
        sound = find_sound(used, part.rest)
        if sound is None:
            return part.binding, None
        bad = np.flatnonzero(sound[part.binding.own] == 0.0)
        binding, has_turn = borrow_turns(part.binding, sound)
        if len(bad):
            face = part.surface.face[part.binding.triangle[bad[0]]]
            more = f" (and {len(bad) - 1} more roots)" if len(bad) > 1 else ""
            feather = self.ids[part.members[bad[0]]]
            told = f"face {face} has no area at time code {code:g}. '{feather}' sits on it{more}. "
            if self.on_collapse == "error" or not has_turn.any():
                raise InputError(Problem(part.surface.path, "points", told + "Keep its area"))
            if part.surface.path not in self._warned:
                self._warned.add(part.surface.path)
                told += 'It turns with the skin around it; on_collapse = "error" ends the bake'
                warn_input(f"{part.surface.path}: {told}")
        return binding, has_turn


@dataclass(frozen=True)
class SkinSurfaces:
    """Surfaces that the roots of a groom ride on, before they are bound.

    surfaces: a feather's is the one that it names, else the first. tolerance: m; roots that are
    farther give a warning, which names source and key. radius: m, of the skin that turns a root;
    None: the distance of roots, at most the feather's width. on_collapse: borrow turns, or error.
    """

    surfaces: tuple[MovingSurface, ...]
    clock: StageClock
    tolerance: float
    source: str
    key: str
    radius: float | None = None
    on_collapse: str = "borrow"

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
            on_collapse=self.on_collapse,
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
        named = [f"'{groom.feathers[part.members[k]].id}' {distance[k]:.3g} m" for k in far]
        warn_input(
            f"{self.source}: {self.key}: roots farther than {self.tolerance:g} m from "
            f"{part.surface.path}: {some_of(named, _MAX_NAMED)}"
        )


def _with_nearest(
    part: _Part, corners: Array, turns: Array, has_turn: Flags
) -> tuple[Array, Array]:
    """Positions (R, 3) m and turns (R, 3, 3) of roots, of which those without a turn take that of
    the nearest root at rest that has one."""
    binding = part.binding
    weights = np.einsum("fk,fkc->fc", binding.barycentric, corners[binding.own])
    rest = part.rest[binding.own].mean(axis=1)
    nearest = search_tree(rest[has_turn]).query(rest)[1]
    turns = np.where(has_turn[:, None, None], turns, turns[has_turn][nearest])
    return weights + np.einsum("fij,fj->fi", turns, binding.offset), turns


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
