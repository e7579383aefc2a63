"""The prims of a cache, with all of them that never changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pxr import Usd

from featherfx.usd.types import FeatherEntry
from featherfx.usd.write.curves import define_barbs, define_rachis
from featherfx.usd.write.material import define_materials
from featherfx.usd.write.mesh import MeshValues, define_mesh
from featherfx.usd.write.names import unique_prim_names
from featherfx.usd.write.poses import BARB, MESH, RACHIS, PosedFeather
from featherfx.usd.write.representations import define_representations
from featherfx.usd.write.samples import AnimatedPrims
from featherfx.usd.write.stage import (
    BARBS,
    FEATHERS,
    MATERIALS,
    RACHISES,
    StageInfo,
    define_root,
    define_scopes,
)


def animated_prims(
    info: StageInfo, entries: Sequence[FeatherEntry], posed: Sequence[PosedFeather]
) -> AnimatedPrims:
    """Where the mesh and the curves of every feather stand."""
    names = unique_prim_names([entry.name or entry.id for entry in entries])

    def paths(scope: str, suffix: str = "") -> list[Any]:
        own = unique_prim_names([name + suffix for name in names])
        return [info.root_path.AppendPath(f"{scope}/{name}") for name in own]

    barbs = zip(paths(BARBS, "_barbs"), posed, strict=True)
    drawn = [path if feather.has_barbs else None for path, feather in barbs]
    return AnimatedPrims(posed, paths(FEATHERS), paths(RACHISES, "_rachis"), drawn)


def define_prims(
    layer: Any, info: StageInfo, entries: Sequence[FeatherEntry], prims: AnimatedPrims
) -> None:
    """Author the prims in a layer, and everything of them that never changes.

    Rest points, topology and texture coordinates stay in memory with the layer, so this comes
    when the samples have gone to disk.
    """
    stage, has_barbs = Usd.Stage.Open(layer), any(each.has_barbs for each in prims.feathers)
    define_root(stage, info)
    define_scopes(stage, info, has_barbs)
    define_representations(stage, info, has_barbs)
    materials = define_materials(stage, info.root_path.AppendChild(MATERIALS))
    shapes: dict[int, MeshValues] = {}
    for index, entry in enumerate(entries):
        posed, surface = prims.feathers[index], entry.feather.surface
        if id(surface) not in shapes:
            shapes[id(surface)] = MeshValues(surface)
        pose = posed.rest()
        rest = {part: pose.values[part, "points"].value for part in posed.parts}
        at = {part: prims.paths[index][part, "points"].GetPrimPath() for part in posed.parts}
        define_mesh(stage, at[MESH], entry, shapes[id(surface)], rest[MESH], materials)
        up = info.space.directions(entry.rest_points[0, 2])
        define_rachis(stage, at[RACHIS], entry, rest[RACHIS], posed.widths, up, materials)
        if posed.has_barbs:
            define_barbs(stage, at[BARB], entry, rest[BARB], posed.barb_widths, materials)
