"""What the writer of caches takes of a groom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from featherfx._version import __version__
from featherfx.baking.options import DrawnOptions
from featherfx.errors import all_of
from featherfx.feather.build import feather_of
from featherfx.feather.render import barb_curves, render_feather
from featherfx.feather.types import Feather, PointMap
from featherfx.groom.types import FeatherKind, Groom, Placement
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.placement import place
from featherfx.shot.types import Quality
from featherfx.usd.types import FeatherEntry


def entries_of(
    groom: Groom, feathers: Sequence[Feather], static: bool, skin: BoundSkin | None = None
) -> list[FeatherEntry]:
    """What the writer takes, for every feather of a groom."""
    return [
        FeatherEntry(
            id=placement.id,
            kind=placement.kind.name,
            region=placement.region,
            feather=feather,
            rest_points=place(feather.points, placement.position, placement.rotation),
            static=static,
            root=None if skin is None else skin.roots[index],
            vane_stiffness=_vane_stiffness(placement.kind),
        )
        for index, (placement, feather) in enumerate(zip(groom.feathers, feathers, strict=True))
    ]


def _vane_stiffness(kind: FeatherKind) -> tuple[float, float]:
    """N/m, thickness times modulus across the barbs and in shear."""
    vane = kind.vane_material
    return vane.thickness * vane.across, vane.thickness * vane.shear


def drawn_entries(
    groom: Groom,
    quality: Quality,
    drawn: DrawnOptions,
    names: Sequence[str],
    skin: BoundSkin | None,
) -> list[FeatherEntry]:
    """What the writer takes of a bake: feathers as they are drawn, and how they follow.

    quality: of the simulation. names: prim name per feather.
    """
    grid, count = (quality.rows, quality.columns), drawn.barbs
    meshes = drawn.grid(quality)
    built = all_of(
        *(partial(_drawn_feather, placement, grid, meshes) for placement in groom.feathers)
    )
    entries = entries_of(groom, [feather for feather, _ in built], static=False, skin=skin)
    for index, placement in enumerate(groom.feathers):
        barbs = None
        if count:
            barbs = barb_curves(placement.kind, grid, count, placement.mirrored)
            points = barbs.points @ placement.rotation.T + placement.position
            barbs = replace(barbs, points=points)
        entries[index] = replace(
            entries[index], name=names[index], points_map=built[index][1], barbs=barbs
        )
    return entries


def _drawn_feather(
    placement: Placement, grid: tuple[int, int], meshes: tuple[int, int]
) -> tuple[Feather, PointMap | None]:
    """The feather to draw, and the map to it from a simulated one of another grid."""
    if grid == meshes:
        return feather_of(placement, *grid), None
    return render_feather(placement.kind, grid, meshes, placement.mirrored)


def metadata_of(groom: Groom, quality: Quality) -> dict[str, Any]:
    """What a cache tells of where it comes from."""
    return {"featherfx": __version__, "groom": groom.name, "quality": quality.name}
