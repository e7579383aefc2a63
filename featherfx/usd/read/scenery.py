"""Scenery of a cache: skins and colliders of its shot, and meshes of other files, over its time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, warn_input
from featherfx.groom.keys.problems import Place, Problems
from featherfx.provenance import StageRead, note_read
from featherfx.shot.clock import StageClock
from featherfx.usd.read.drawn_meshes import DrawnMesh, drawn_meshes, is_drawn, list_undrawn
from featherfx.usd.read.opening import locate_file, locate_package, open_stage
from featherfx.usd.read.stage import SourceScene, choose_variants
from featherfx.usd.read.surface import MeshOptions, Surface, open_drawn, open_mesh
from featherfx.usd.read.values import VECTOR_ARRAY


class SceneryMesh(NamedTuple):
    """A surface over the time of a cache. clock: of the surface's stage, 1 s a time code of the
    cache. is_framed: whether cameras are to see all of it, which they are not of colliders."""

    scene: SourceScene
    surface: Surface
    clock: StageClock
    is_framed: bool = True

    @property
    def name(self) -> tuple[Path, str]:
        """Return its file and its prim."""
        return self.scene.path.resolve(), self.surface.path

    def points(self, code: float | None) -> Array:
        """Return (V, 3) m at a time code of the cache; None: at rest."""
        surface = self.surface
        return surface.rest if code is None else surface.points(self.clock.code(code))

    def colours(self, usual: Array) -> Array:
        """Return (V, 3) displayColor at its points, else the usual colour (3,)."""
        found = np.tile(usual, (len(self.surface.rest), 1)).astype(np.float64)
        corners = self.surface.read_corners("displayColor", VECTOR_ARRAY)
        if corners is not None:
            points = self.surface.triangles.ravel()
            count = np.bincount(points, minlength=len(found))
            sums = [np.bincount(points, each, len(found)) for each in corners.reshape(-1, 3).T]
            found[count > 0] = (np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])[count > 0]
        return found


def find_scenery(
    entries: Sequence[Mapping[str, Any]], path: Path, roles: Sequence[str], done: str
) -> Iterator[SceneryMesh]:
    """Yield the scenery of some roles, "skin" and "collider", that a cache at a path names.

    entries: of the cache. A warning tells of what is missing. done: what would be done with it.
    """
    for entry in (each for each in entries if each["role"] in roles):
        file, told = locate_file(path.parent, entry["file"]), "is not there and"
        if locate_package(file)[0].is_file():
            try:
                yield open_scenery(file, entry)
                continue
            except InputError as error:
                told = f"cannot be read ({error}) and"
        message = f"{path}: its {entry['role']} {file} {told} not {done}"
        warn_input(message)


def open_scenery(file: Path, entry: Mapping[str, Any]) -> SceneryMesh:
    """Return the surface that an entry of a cache names. Raises InputError."""
    place, prim = Place(str(file), "", Problems()), entry["prim"]
    scene = SourceScene(file, open_stage(file))
    scene = choose_variants(scene, entry.get("variant_sets", {}), place.child("variant_sets"))
    options = MeshOptions(entry.get("rest"), entry.get("subdivision", True), "")
    surface = open_mesh(scene, prim, options, place)
    if not is_drawn(scene.stage.GetPrimAtPath(prim)):
        place.refuse(f"{prim} is invisible, or of a purpose that is not rendered")
    rate = entry["time_codes_per_frame"]
    clock = StageClock(entry["start"] - rate * entry["first"], rate)
    return SceneryMesh(scene, surface, clock, entry["role"] != "collider")


def list_beside(mesh: SceneryMesh) -> Iterator[SceneryMesh]:
    """Yield the drawn meshes under the same prim as a mesh, such as eyes, but for feathers."""
    own = mesh.scene.stage.GetPrimAtPath(mesh.surface.path)
    for each in drawn_meshes(mesh.scene.stage):
        prim = each.mesh.GetPrim()
        is_beside = prim != own and prim.GetParent() == own.GetParent()
        if is_beside and not own.GetParent().IsPseudoRoot() and not is_feather(each):
            yield from _open_drawn(mesh.scene, each, mesh.clock)


def list_meshes(file: Path, rate: float) -> Iterator[SceneryMesh]:
    """Yield the drawn meshes of a file. rate: time codes of the cache in a second.

    A warning tells of those that cannot be read. Raises InputError where there is no mesh.
    """
    scene = SourceScene(file, open_stage(file))
    every = list(drawn_meshes(scene.stage))
    if not every:
        raise InputError(Problem(str(file), "", "holds no visible mesh. Give a file with one"))
    left = tuple(list_undrawn(scene.stage))
    note_read(StageRead(str(file), "/", "drawn surface", len(every), left))
    for each in every:
        yield from _open_drawn(scene, each, StageClock(step=scene.time_codes_per_second / rate))


def _open_drawn(scene: SourceScene, drawn: DrawnMesh, clock: StageClock) -> Iterator[SceneryMesh]:
    place = Place(str(scene.path), "", Problems())
    try:
        yield SceneryMesh(scene, open_drawn(scene, drawn, MeshOptions(uv=""), place), clock)
    except InputError as error:
        warn_input(f"{error}. It is not drawn", 3)


def is_feather(drawn: DrawnMesh) -> bool:
    """Return whether a mesh, or the instance of it, has a feather's id."""
    return drawn.labels is not None or drawn.mesh.GetPrim().HasAttribute("primvars:featherId")
