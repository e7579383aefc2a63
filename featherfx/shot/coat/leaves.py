"""A coat in motion: feathers drawn on their leaves over the skin of each frame.

The solver sees feathers on roots that the skin carries rigidly. With y their nodes, seen from these
roots, and y0 those at rest, a feather deviates from its leaf

    within the vane     by the angles and lengths of its plane form, which it keeps,
    across it           by z = (y - y0) . n0,  n0 the normal of its rows at rest.

What all feathers deviate across their vanes is one field of lift over the coat (coat/coat.py), so
that leaves stay in order:

    h = T (d + g(s)) + a w(s) + b,   a = mean of (z - z_root) / w,  b = mean of z_root,

means over the skin, of a by the weights w(s)^2. Rates are differences of what is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, face_products, unit
from featherfx.coat.carrier import Carrier, pose_carrier
from featherfx.coat.coat import Coat, draw
from featherfx.coat.fields import SkinMeans, SkinPlaces
from featherfx.coat.forms import make_plane_forms
from featherfx.feather.leaves import plane_forms
from featherfx.feather.shapes import build_plane_feathers
from featherfx.feather.types import Feather, RowPoints, both, stacked
from featherfx.groom.skin.skin import closest, crushed, may_be_crushed
from featherfx.groom.types import Placement
from featherfx.shot.roots import RootFrames
from featherfx.shot.sources import TimedSurface

# of the median length of the feathers, reach of the means of their lifts
_LIFT_REACH = 0.5
# of the time between two samples, by which the times are apart from which rates are found
_STEP_RATIO = 0.02
_FEATHERS_AT_ONCE = 2000  # that are drawn, to bound the memory
_NO_HEIGHT = 1e-9  # m, of the coat's points over the skin of the shot


class CarriedPoints:
    """Points of a coat's skin (V, 3) m, carried by the surfaces of a shot."""

    def __init__(self, points: Array, surfaces: Sequence[TimedSurface]) -> None:
        self._surfaces = surfaces
        rest = [each.surface.rest for each in surfaces]
        first = np.cumsum([0, *map(len, rest[:-1])])
        triangles = np.concatenate(
            [each.surface.triangles + start for each, start in zip(surfaces, first, strict=True)]
        )
        corners = np.concatenate(rest)[triangles]
        triangle, self._weights = closest(points, corners)
        self._corners = triangles[triangle]
        own = corners[triangle]
        away = points - np.einsum("vk,vkc->vc", self._weights, own)
        height = dots(away, unit(face_products(own)))
        self._height = np.where(np.abs(height) > _NO_HEIGHT, height, 0.0)

    def at(self, time: float) -> Array:
        """The points at a time, s."""
        skin = np.concatenate([each.points(time) for each in self._surfaces])[self._corners]
        found = np.einsum("vk,vkc->vc", self._weights, skin)
        if self._height.any():
            found += self._height[:, None] * unit(face_products(skin))
        return np.asarray(found)


@dataclass(frozen=True)
class PosedFeathers:
    """Feathers on their roots at one time: points (K) in the world, and roots (K)."""

    points: RowPoints
    roots: RootFrames


class MovingCoat:
    """Some feathers of a coat on a skin that moves. placements, drawn: of the K feathers."""

    def __init__(
        self,
        coat: Coat,
        skin: CarriedPoints,
        placements: Sequence[Placement],
        drawn: Sequence[Feather],
    ) -> None:
        self._coat, self._skin = coat, skin
        self._numbers: Indices = np.array([each.leaf.number for each in placements])
        plane = build_plane_feathers(placements, drawn[0].rows, drawn[0].columns)
        forms = plane_forms(placements, plane)
        rest = stacked([feather.rest for feather in drawn])
        self._rachis, self._dorsal = rest.nodes[:, :, 0], rest.directors[:, :, 1]
        self._bare, lain = forms.bare, make_plane_forms(rest.nodes, rest.directors, forms.bare)
        # what a leaf leaves of the angles in projection
        self._angles = [
            getattr(forms, name) - getattr(lain, name) for name in ("ahead", "behind", "angles")
        ]
        on_leaf = draw(coat, coat.rest, forms, self._numbers)
        self._feet = on_leaf.feet
        place = np.maximum(on_leaf.places[:, :, 0], 0.0)
        self._place = np.where(place > 0.0, place, 1.0)
        self._tips = self._means(on_leaf.feet[:, :, 0].ravel(), place.ravel() ** 4)
        self._bases = self._means(coat.follicles.triangle[self._numbers], 1.0)

    def _means(self, triangle: Indices, weights: Array | float) -> SkinMeans:
        coat = self._coat
        reach = _LIFT_REACH * float(np.median(coat.follicles.length))
        middle = SkinPlaces(triangle, np.full((len(triangle), 3), 1.0 / 3.0))
        return SkinMeans(coat.rest.elements, coat.mesh.faces, reach, middle, weights)

    def follow(
        self, given: Sequence[RowPoints], roots: Sequence[RootFrames], span: tuple[float, float]
    ) -> list[RowPoints]:
        """Feathers on their leaves at the end of a span of time (s), and their two rates.

        given: points on roots that the skin carries rigidly, and their two rates; roots: those, and
        their two rates. Where faces below a leaf collapse, its feather passes to the given points.
        """
        step = _STEP_RATIO * (span[1] - span[0])
        times = [-q * step for q in range(3)]
        posed = [
            PosedFeathers(
                RowPoints(*(_extrapolated(rates, time) for rates in zip(*given, strict=True))),
                RootFrames(*(_extrapolated(rates, time) for rates in zip(*roots, strict=True))),
            )
            for time in times
        ]
        skins = [self._skin.at(span[1] + time) for time in times]
        carriers = [pose_carrier(self._coat.mesh, each) for each in skins]
        lifts = [self._lift(each) for each in posed]
        found = [both(np.empty_like, given[0]) for _ in range(3)]
        for start in range(0, len(self._numbers), _FEATHERS_AT_ONCE):
            some = slice(start, start + _FEATHERS_AT_ONCE)
            drawn = [
                self._draw(carrier, each, lift, some)
                for carrier, each, lift in zip(carriers, posed, lifts, strict=True)
            ]
            for part, values in enumerate(zip(*drawn, strict=True)):
                for rate, value in zip(found, _differences(values, step), strict=True):
                    rate[part][some] = value
        share = self._share(skins[0])
        if share is None:
            return found

        def mixed(now: Array, then: Array) -> Array:
            part = share.reshape(-1, *[1] * (now.ndim - 1))
            return np.asarray(part * now + (1.0 - part) * then)

        return [both(mixed, now, then) for now, then in zip(found, given, strict=True)]

    def _lift(self, posed: PosedFeathers) -> Array:
        """(V, 2) m, a and b of the coat."""
        position, rotation = posed.roots
        local = (posed.points.nodes[:, :, 0] - position[:, None]) @ rotation
        across = np.einsum("fnk,fnk->fn", local - self._rachis, self._dorsal)
        tips = self._tips(((across - across[:, :1]) / self._place**2).ravel())
        return np.stack([tips, self._bases(across[:, 0])], axis=1)

    def _draw(self, carrier: Carrier, posed: PosedFeathers, lift: Array, some: slice) -> RowPoints:
        """Some feathers on their leaves in one pose."""
        own = posed.points.at(some)
        forms = make_plane_forms(own.nodes, own.directors, self._bare[some])
        ahead, behind, angles = (
            now + then[some]
            for now, then in zip(
                (forms.ahead, forms.behind, forms.angles), self._angles, strict=True
            )
        )
        forward = np.cross(*own.directors[:, 0].swapaxes(0, 1))
        x, y = (dots(forward, posed.roots.rotations[some, :, k]) for k in range(2))
        forms = forms._replace(ahead=ahead, behind=behind, angles=angles, turn=np.arctan2(y, x))
        drawn = draw(self._coat, carrier, forms, self._numbers[some], lift)
        return RowPoints(drawn.nodes, drawn.directors)

    def _share(self, points: Array) -> Array | None:
        """(K,) of feathers that their leaves draw on a skin with points (V, 3) m; None: all."""
        mesh = self._coat.mesh
        corners = points[mesh.faces]
        if not may_be_crushed(corners):
            return None
        sound = crushed(corners, mesh.points[mesh.faces])
        return np.asarray(sound[self._feet].min(axis=(1, 2)))


def _extrapolated(rates: Sequence[Array], time: float) -> Array:
    """Values at a time (s) from now on, from those now and their two rates."""
    now, rate, second = rates
    if time == 0.0:
        return now
    return np.asarray(now + time * rate + 0.5 * time * time * second)


def _differences(values: Sequence[Array], step: float) -> tuple[Array, Array, Array]:
    """Values and their two rates at the latest of three times, step (s) apart, latest first."""
    x, y, z = values
    return x, (3.0 * x - 4.0 * y + z) / (2.0 * step), (x - 2.0 * y + z) / (step * step)
