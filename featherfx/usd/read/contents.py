"""Contents of stages: what grooms and shots can name, and the scenery of a cache.

Named are meshes, skeletons, curves and cameras. Scenery is skins and colliders of a cache's shot,
and meshes of other files, over its time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom, UsdSkel

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, warn_input
from featherfx.groom.keys.problems import Place, Problems
from featherfx.phases import LeftOut, StageRead, note_read
from featherfx.shot.frames import StageClock
from featherfx.usd.read.drawn_meshes import DrawnMesh, drawn_meshes, is_drawn, list_undrawn
from featherfx.usd.read.stage import (
    SourceScene,
    choose_variants,
    list_broken,
    open_scene,
    prim_kind,
    prims_below,
    rest_time,
    sampled_range,
    transform_points,
)
from featherfx.usd.read.surface import MeshOptions, Surface, open_drawn, open_mesh
from featherfx.usd.read.values import (
    EARLIEST_TIME,
    INTEGER_ARRAY,
    VECTOR_ARRAY,
    collect_errors,
    compute,
    list_elements,
    locate_file,
    locate_package,
    open_stage,
    read_sized_array,
    read_targets,
    read_texts,
    read_times,
    read_value,
)


@dataclass(frozen=True)
class PrimvarReport:
    """A primvar of a prim or of one above it.

    count: values before indices are resolved, 1 for a single one. element_size: values for each
    element.
    """

    name: str
    type: str
    interpolation: str
    count: int
    element_size: int
    inherited: bool


@dataclass(frozen=True)
class PrimReport:
    """A prim that grooms and shots may name.

    kind: a key of stage.PRIM_KINDS. points: of a mesh, curves or points at rest. parts: faces of a
    mesh, curves, joints, instances; 0 of others. size: (3,) m, of the box around the points along
    the stage's axes, transforms included; None without points. box: least and greatest of the
    points in the prim's own units and axes, as a groom has them in the space of its skin. sampled:
    first and last time code of anything that moves it, skeletons included. samples: most that one
    of its own attributes has. joints: paths of a skeleton's. subsets: names of a mesh's. skeleton:
    that moves a mesh, empty where none does. prototypes: of an instancer. in_instance: lies within
    a native instance. Of a mesh that a shot can take, else None: triangles: that are drawn. closed:
    whether it is a volume. mirrored: whether transforms mirror it. subdivision: its scheme.
    cage_distance: m, largest distance of its points to the subdivided surface. moves: first and
    last time code at which points move. displacement: m, largest way of a point from the first.
    """

    path: str
    kind: str
    type: str
    points: int
    parts: int
    size: tuple[float, ...] | None
    box: tuple[tuple[float, ...], tuple[float, ...]] | None
    sampled: tuple[float, float] | None
    samples: int
    primvars: tuple[PrimvarReport, ...]
    joints: tuple[str, ...]
    subsets: tuple[str, ...]
    skeleton: str
    prototypes: tuple[str, ...]
    in_instance: bool
    triangles: int | None = None
    closed: bool | None = None
    mirrored: bool | None = None
    subdivision: str | None = None
    cage_distance: float | None = None
    moves: tuple[float, float] | None = None
    displacement: float | None = None


@dataclass(frozen=True)
class StageReport:
    """Metadata of a stage, and its prims in the order of the stage.

    start and end: time codes, None where they are not authored. problems: unreadable prims and
    missing files, one line each.
    """

    file: str
    meters_per_unit: float
    meters_per_unit_is_authored: bool
    up_axis: str
    default_prim: str
    start: float | None
    end: float | None
    time_codes_per_second: float
    frames_per_second: float
    prims: tuple[PrimReport, ...]
    problems: tuple[str, ...]

    def of_kind(self, kind: str) -> tuple[PrimReport, ...]:
        """Return the prims of a kind, a key of stage.PRIM_KINDS."""
        return tuple(prim for prim in self.prims if prim.kind == kind)


def inspect_stage(path: str | Path) -> StageReport:
    """Return the contents of a USD file with its payloads, within native instances too.

    Unreadable prims are left out and listed in `problems`. Raises InputError for a file that cannot
    be opened.
    """
    problems = Problems()
    place = Place(str(path), "", problems)
    scene, prims, left = open_scene(Path(path), place), [], []
    for prim in prims_below(scene.stage.GetPseudoRoot()):
        kind, told = prim_kind(prim), "neither grooms nor shots read"
        if kind:
            told = "cannot be read"
            with collect_errors(place):
                prims.append(_prim_report(scene, prim, kind, place))
                continue
        if kind or prim.IsA(UsdGeom.Gprim):
            left.append(LeftOut(str(prim.GetPath()), str(prim.GetTypeName()), told))
    note_read(StageRead(str(path), "/", "prim", len(prims), tuple(left)))
    for what, why in list_broken(scene.stage).items():
        place.child(what).fail(why)
    stage, default = scene.stage, scene.stage.GetDefaultPrim()
    return StageReport(
        file=str(path),
        meters_per_unit=scene.space[0],
        meters_per_unit_is_authored=bool(stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit)),
        up_axis=scene.space[1],
        default_prim=str(default.GetPath()) if default else "",
        start=_authored(stage, "startTimeCode"),
        end=_authored(stage, "endTimeCode"),
        time_codes_per_second=scene.time_codes_per_second,
        frames_per_second=float(stage.GetFramesPerSecond()),
        prims=tuple(prims),
        problems=tuple(map(str, problems.listed())),
    )


def _authored(stage: Any, name: str) -> float | None:
    return float(stage.GetMetadata(name)) if stage.HasAuthoredMetadata(name) else None


def _prim_report(scene: SourceScene, prim: Any, kind: str, place: Place) -> PrimReport:
    surface = _open_surface(scene, prim, place) if kind == "mesh" else None
    skeleton = None if surface is None else surface.skeleton
    is_mesh, is_skeleton, is_instancer = (
        kind == each for each in ("mesh", "skeleton", "instancer")
    )
    joints = read_texts(UsdSkel.Skeleton(prim).GetJointsAttr()) if is_skeleton else []
    prototypes = (
        read_targets(UsdGeom.PointInstancer(prim).GetPrototypesRel()) if is_instancer else []
    )
    subsets = UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(prim)) if is_mesh else []
    places = _places(prim)
    points = (
        np.empty((0, 3))
        if not places
        else read_sized_array(places, rest_time(places), VECTOR_ARRAY)
    )
    moving = _moving(prim, kind)
    return PrimReport(
        path=str(prim.GetPath()),
        kind=kind,
        type=str(prim.GetTypeName()),
        points=len(points),
        parts=len(joints) if is_skeleton else _parts(prim, kind),
        size=_size(scene, prim, points),
        box=_box(points),
        sampled=sampled_range(prim, moving) if surface is None else surface.sampled,
        samples=max((len(read_times(each)) for each in moving), default=0),
        primvars=_primvars(prim),
        joints=tuple(joints),
        subsets=tuple(each.GetPrim().GetName() for each in subsets),
        skeleton="" if skeleton is None else str(skeleton.GetPath()),
        prototypes=tuple(map(str, prototypes)),
        in_instance=bool(prim.IsInstanceProxy()),
        **({} if surface is None else _surface_facts(surface)),
    )


def _open_surface(scene: SourceScene, prim: Any, place: Place) -> Surface | None:
    """Return a mesh as skins and colliders are read; None, after adding problems, if it is not."""
    if not prim.IsDefined() or prim.IsAbstract():
        return None
    with collect_errors(place):
        return open_mesh(scene, str(prim.GetPath()), MeshOptions(subdivision=False), place)
    return None


def _surface_facts(surface: Surface) -> dict[str, Any]:
    displacement = surface.displacement(surface.looks)
    return {
        "triangles": len(surface.triangles),
        "closed": bool(surface.closed.all()),
        "mirrored": surface.mirrored,
        "subdivision": surface.scheme,
        "cage_distance": surface.cage_distance(),
        "moves": surface.sampled if displacement > 0.0 else None,
        "displacement": displacement,
    }


def _places(prim: Any) -> Any:
    """Return the attribute of a prim's points, of an instancer's positions; else None."""
    if prim.IsA(UsdGeom.PointInstancer):
        return UsdGeom.PointInstancer(prim).GetPositionsAttr()
    return UsdGeom.PointBased(prim).GetPointsAttr() if prim.IsA(UsdGeom.PointBased) else None


def _parts(prim: Any, kind: str) -> int:
    attributes = {
        "mesh": lambda: UsdGeom.Mesh(prim).GetFaceVertexCountsAttr(),
        "curves": lambda: UsdGeom.Curves(prim).GetCurveVertexCountsAttr(),
        "instancer": lambda: UsdGeom.PointInstancer(prim).GetProtoIndicesAttr(),
    }
    return (
        len(read_sized_array(attributes[kind](), EARLIEST_TIME, INTEGER_ARRAY))
        if kind in attributes
        else 0
    )


def _moving(prim: Any, kind: str) -> list[Any]:
    """Return attributes of a prim that may move it; of a skeleton those of its animation."""
    if kind == "skeleton":
        source = compute(prim, UsdSkel.BindingAPI(prim).GetInheritedAnimationSource)
        if not source:
            return []
        names = ("translations", "rotations", "scales", "blendShapeWeights")
        return [source.GetAttribute(name) for name in names]
    if kind == "camera":
        return [UsdGeom.Camera(prim).GetFocalLengthAttr()]
    turning = [UsdGeom.PointInstancer(prim).GetOrientationsAttr()] if kind == "instancer" else []
    return [_places(prim), *turning]


def _box(points: NDArray[Any]) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    return tuple(low.tolist()), tuple(high.tolist())


def _size(scene: SourceScene, prim: Any, points: NDArray[Any]) -> tuple[float, ...] | None:
    if (box := _box(points)) is None:
        return None
    low, high = box
    corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
    # along the world's axes, then put back to the order of the stage's
    matrix = scene.matrix(prim, rest_time(_places(prim)))
    box = np.ptp(transform_points(corners.astype(np.float64), matrix), axis=0)
    turned = box[[0, 2, 1]] if scene.space[1] == "Y" else box
    return tuple(turned.tolist())


def _primvars(prim: Any) -> tuple[PrimvarReport, ...]:
    api = UsdGeom.PrimvarsAPI(prim)
    found = []
    for primvar in compute(prim, api.FindPrimvarsWithInheritance):
        attribute = primvar.GetAttr()
        value = read_value(attribute, EARLIEST_TIME)
        if value is None:
            continue
        found.append(
            PrimvarReport(
                name=str(primvar.GetPrimvarName()),
                type=str(attribute.GetTypeName()),
                interpolation=str(primvar.GetInterpolation()),
                count=len(list_elements(value)),
                element_size=int(primvar.GetElementSize()),
                inherited=attribute.GetPrim() != prim,
            )
        )
    return tuple(sorted(found, key=lambda each: each.name))


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
