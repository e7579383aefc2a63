"""Other forms than meshes: condensed feathers, and static plumage as instances.

Condensed feathers are rachises that carry the nodes of their barbs. Every point of such a rachis
has the nodes of its two barbs, from root to end and without the root, as the primvars P_barbl and
P_barbr. Left is as seen from dorsal with the tip ahead. Beside a mesh all nodes are there. Without
a mesh half of the rows and nodes are, and integers code the others (featherfx/feather/detail.py).

Instances are a PointInstancer whose prototypes are the repeated shapes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from featherfx.algebra.vectors import frames_to_quats
from featherfx.feather.colours import at_nodes, colour_feather, uniform
from featherfx.feather.detail import ThinnedGrid, choose_rows_and_nodes, detail_of
from featherfx.feather.profiles import held_by_hooks
from featherfx.feather.shapes import encode_shape
from featherfx.feather.types import LEADING, TRAILING, Array, Feather, RowPoints, barb_slice
from featherfx.files.atomic_write import standing
from featherfx.files.disk_cache import stable_number
from featherfx.groom.materials import colour_text, look_text
from featherfx.groom.types import Placement, shading_of
from featherfx.shot.frames import place
from featherfx.usd import arrays
from featherfx.usd.types import (
    BARB_COLOUR_PRIMVARS,
    BARB_COUNT_PRIMVAR,
    BARB_NODE_PRIMVARS,
    COLOUR_PRIMVAR,
    DETAIL_GRID_ATTRIBUTE,
    MESH_PRIM,
    SHAPE_PRIMVAR,
    SHAPE_SIZE_PRIMVAR,
    FeatherEntry,
    StageSpace,
    choose_origin,
)
from featherfx.usd.write.chunks import AnimatedPrims
from featherfx.usd.write.layers import (
    MATERIALS_SCOPE,
    StageInfo,
    define_root,
    finish_layers,
    new_layers,
    publish,
)
from featherfx.usd.write.materials import choose_inputs, define_materials
from featherfx.usd.write.options import StageOptions
from featherfx.usd.write.output import (
    MeshGroup,
    check_output,
    output_files,
    prim_name,
    unique_prim_names,
)
from featherfx.usd.write.posed_groups import PosedGroup
from featherfx.usd.write.poses import ToStage, make_posed_feathers, surface_kernels
from featherfx.usd.write.prims import author_primvars, author_shared, define_mesh

if TYPE_CHECKING:
    from featherfx.usd.write.poses import PosedFeather


def left_leads(feather: Feather) -> bool:
    """Return whether the leading barbs are the left ones, seen from dorsal with the tip ahead."""
    nodes, columns = feather.rest.nodes[..., 1], feather.columns
    leading, trailing = (nodes[:, barb_slice(side, columns)] for side in (LEADING, TRAILING))
    return bool(leading.sum() >= trailing.sum())


def find_details(
    feathers: Sequence[PosedFeather], points: Sequence[RowPoints]
) -> NDArray[np.int32]:
    """Return the coded rest of all thinned feathers, one after the other (feather/detail.py).

    points: of each feather, on its whole grid. Feathers of one grid are coded at once.
    """
    alike: dict[int, tuple[ThinnedGrid, list[int]]] = {}
    for k, feather in enumerate(feathers):
        if feather.thin:
            alike.setdefault(id(feather.thin), (feather.thin, []))[1].append(k)
    found: dict[int, NDArray[np.int32]] = {}
    for thin, own in alike.values():
        rest = [feathers[k].rest_points for k in own]
        lengths = np.array([feathers[k].length for k in own])
        each = detail_of([points[k] for k in own], rest, lengths, thin)
        found |= dict(zip(own, each, strict=True))
    return np.concatenate([found[k].ravel() for k in range(len(points))])


def _constant_values(
    info: StageInfo, group: PosedGroup, entries: Sequence[FeatherEntry], rest: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the constant values of condensed feathers, USD arrays by the names of their primvars.

    rest: points of the barbs at rest, by the names in P_BARB.
    """
    values, shades = [], []
    for entry in entries:
        feather = entry.feather
        grid = feather.rows, feather.columns
        kept = choose_rows_and_nodes(*grid, None if group.feathers[0].form.thinned else grid)
        shades.append(_barb_shades(entry, kept))
        along = feather.station[kept.rows] / feather.station[-1]
        barb = kept.nodes[1:][: kept.columns]
        across = 0.5 + 0.5 * barb / feather.columns
        own = np.ones(feather.columns) if entry.barb_widths is None else entry.barb_widths
        sides = [LEADING, TRAILING]
        st = [np.stack(np.broadcast_arrays(u, along[:, None]), -1) for u in (across, 1.0 - across)]
        grown = [feather.barb_length[side, kept.rows] > 0.0 for side in sides]
        widths = [each[:, None] * own[barb - 1] for each in grown]
        left = slice(None) if left_leads(feather) else slice(None, None, -1)
        values.append((st[left], widths[left]))
    uv, widths = zip(*values, strict=True)
    made: dict[str, Any] = {}
    for side, end in enumerate("lr"):
        made[f"uv_barb{end}"] = arrays.vec2f(np.concatenate([v[side].reshape(-1, 2) for v in uv]))
        diameters = np.concatenate([each[side].ravel() for each in widths])
        made[f"width_barb{end}"] = arrays.floats(info.space.lengths(diameters))
        made[f"rest_barb{end}"] = rest[BARB_NODE_PRIMVARS[side]]
    if all(each is not None for each in shades):
        for name, colours in zip(BARB_COLOUR_PRIMVARS, zip(*shades, strict=True), strict=True):
            made[name] = arrays.vec3f(np.concatenate(colours))
    made["leadingIsRight"] = arrays.ints([not left_leads(each.feather) for each in entries])
    made[SHAPE_SIZE_PRIMVAR] = arrays.floats(
        [each.shape[2] if each.shape else 1.0 for each in entries]
    )
    return made


def _barb_shades(entry: FeatherEntry, kept: ThinnedGrid) -> list[Array] | None:
    """Return linear colours (K, 3) of the nodes of left and right barbs; None: no colours."""
    if entry.colours is None:
        return None
    nodes = at_nodes(entry.colours, entry.feather)[kept.rows[:, None], kept.nodes]
    few = 1 + kept.columns
    sides = [nodes[:, 1:few].reshape(-1, 3), nodes[:, few:].reshape(-1, 3)]
    return sides if left_leads(entry.feather) else sides[::-1]


def _shape_texts(entries: Sequence[FeatherEntry]) -> dict[str, list[str]]:
    """Return shapes and colours of feathers as texts; empty where one has no shape."""
    shapes = [entry.shape for entry in entries if entry.shape is not None]
    if len(shapes) < len(entries):
        return {}
    texts = {SHAPE_PRIMVAR: [encode_shape(*each[:2]) for each in shapes]}
    if entries[0].colours is not None:
        texts[COLOUR_PRIMVAR] = [colour_text(each[0].colour) for each in shapes]
    return texts


def define_condensed(
    stage: Any,
    info: StageInfo,
    path: Any,
    group: PosedGroup,
    entries: Sequence[FeatherEntry],
    rest: Mapping[str, Any],
) -> None:
    """Author the constant primvars of condensed feathers on their rachises."""
    prim = stage.GetPrimAtPath(path)
    for name, texts in _shape_texts(entries).items():
        author_shared(prim, name, texts, group.interpolation)
    if group.feathers[0].form.thinned:
        table = prim.CreateAttribute(DETAIL_GRID_ATTRIBUTE, Sdf.ValueTypeNames.Int2Array)
        table.SetVariability(Sdf.VariabilityUniform)
        table.Set(arrays.vec2i([(e.feather.rows, e.feather.columns) for e in entries]))
    for name, value in _constant_values(info, group, entries, rest).items():
        each = name in ("leadingIsRight", SHAPE_SIZE_PRIMVAR)
        author_primvars(prim, group.interpolation if each else "", **{name: value})
        if name.endswith(("_barbl", "_barbr")):
            UsdGeom.PrimvarsAPI(prim).GetPrimvar(name).SetElementSize(group.columns)


def condense(points: RowPoints, left: Any, stage: ToStage, out: Sequence[Any]) -> bool:
    """Write barbs and orientations of the N rows of rachises; return whether all are finite.

    left: whether the leading barb is the left one, one for all or (N,). out: (N m, 3) nodes of left
    and right barbs, (N, 4) rotations.
    """
    columns = points.nodes.shape[1] // 2
    barbs = [points.nodes[:, barb_slice(side, columns)] for side in (LEADING, TRAILING)]
    is_left, finite = np.reshape(left, (-1, 1, 1)), True
    for pair, numbers in ((barbs, out[0]), (barbs[::-1], out[1])):
        world = np.ascontiguousarray(np.where(is_left, *pair)).reshape(-1, 3)
        finite &= bool(surface_kernels.write_points(world, stage, numbers))
    space = StageSpace(1.0, "Y" if stage.y_up else "Z")
    lateral, dorsal = (space.directions(points.directors[:, k]) for k in range(2))
    # those of a mapped grid are not quite orthonormal
    lateral = lateral / np.linalg.norm(lateral, axis=1, keepdims=True)
    dorsal = dorsal - lateral * np.einsum("rc,rc->r", lateral, dorsal)[:, None]
    dorsal /= np.linalg.norm(dorsal, axis=1, keepdims=True)
    frames = np.stack([np.cross(lateral, dorsal), lateral, dorsal], axis=2)
    out[2][...] = np.roll(frames_to_quats(frames), -1, axis=1)
    return finite


_PLUMAGE, _PROTOTYPES = "plumage", "prototypes"


def write_instances(
    path: str | Path,
    placements: Sequence[Placement],
    shapes: Sequence[Feather],
    chosen: Sequence[int],
    options: StageOptions,
    metadata: Mapping[str, Any],
) -> None:
    """Write feathers at rest as instances; complete or not at all.

    shapes: of the prototypes, in their own frames at their own sizes. chosen: per placement, the
    number of its shape. Ids, kinds and regions are primvars with one value an instance; `ids` are
    numbers made from the ids, the same whatever else the groom holds. The layout is "payload" where
    options ask for that or clips, else "flat". Raises OutputError.
    """
    layout = "payload" if options.layout in ("payload", "clips") else "flat"
    target = check_output(path, options.overwrite, layout)
    before = {file: standing(file) for file in output_files(target, layout)}
    info = StageInfo(
        prim_name(target.stem),
        replace(
            StageSpace.from_options(options), origin=choose_origin([p.position for p in placements])
        ),
        None,
        24.0,
        {**metadata, "layout": layout},
    )
    layers = new_layers(info, layout)
    stage = Usd.Stage.Open(layers.topology)
    define_root(stage, info)
    at = info.root_path.AppendChild(_PLUMAGE)
    instancer = UsdGeom.PointInstancer.Define(stage, at)
    entries = _entries(placements, shapes, chosen)
    paths = _define_prototypes(stage, layers.topology, info, at, entries)
    instancer.CreatePrototypesRel().SetTargets(paths)
    _author_instances(instancer, placements, chosen, info.space)
    extent = instancer.ComputeExtentAtTime(Usd.TimeCode.Default(), Usd.TimeCode.Default())
    instancer.CreateExtentAttr(extent)
    del stage
    publish(finish_layers(layers, info, target, np.asarray(extent), None), before)


def _entries(
    placements: Sequence[Placement], shapes: Sequence[Feather], chosen: Sequence[int]
) -> list[FeatherEntry]:
    first: dict[int, Placement] = {}
    for placement, shape in zip(placements, chosen, strict=True):
        first.setdefault(shape, placement)
    kinds = [first[number].kind for number in range(len(shapes))]
    coloured = any(not kind.colour.is_plain for kind in kinds)
    shading = shading_of(kinds)
    return [
        FeatherEntry(
            id=f"{kind.name}_{number:04d}",
            kind=kind.name,
            region="",
            feather=shape,
            rest_points=place(shape.rest, np.zeros(3), np.eye(3)),
            static=True,
            held=held_by_hooks(kind, shape, True),
            # instances of one shape are equally bright
            colours=colour_feather(uniform(kind), shape, None, "", shading) if coloured else None,
            look=look_text(kind.drawn_look),
            barb_count=kind.barb_count,
        )
        for number, (shape, kind) in enumerate(zip(shapes, kinds, strict=True))
    ]


def _define_prototypes(
    stage: Any, layer: Any, info: StageInfo, at: Any, entries: Sequence[FeatherEntry]
) -> list[Any]:
    """Define meshes below the instancer, which only instances draw."""
    materials = define_materials(
        stage, info.root_path.AppendChild(MATERIALS_SCOPE), choose_inputs(entries)
    )
    scope = at.AppendChild(_PROTOTYPES)
    UsdGeom.Scope.Define(stage, scope)
    names = unique_prim_names([entry.id for entry in entries])
    paths = [scope.AppendChild(name) for name in names]
    posed = make_posed_feathers(entries, replace(info.space, origin=StageSpace.origin))
    groups = [
        PosedGroup(MeshGroup(entry.id, (k,)), posed, [True] * len(entries), True)
        for k, entry in enumerate(entries)
    ]
    poses = [group.rest() for group in groups]
    for entry, path, group, pose in zip(entries, paths, groups, poses, strict=True):
        points = pose.values[MESH_PRIM, "points"].value
        define_mesh(stage, path, group, [entry], points, materials)
    prims = AnimatedPrims(groups, [{MESH_PRIM: path} for path in paths])
    with Sdf.ChangeBlock():
        for index, pose in enumerate(poses):
            for key in prims.paths[index]:
                if key[1] != "velocities":
                    prims.create(layer, index, key).default = pose.values[key].value
    return paths


def _author_instances(
    instancer: Any, placements: Sequence[Placement], chosen: Sequence[int], space: StageSpace
) -> None:
    positions = space.positions(np.array([p.position for p in placements]) - space.origin)
    to_stage = space.directions(np.eye(3)).T
    rotations = to_stage @ np.array([p.rotation for p in placements]) @ to_stage.T
    orientations = frames_to_quats(rotations)
    # the real part is not negative
    orientations = np.where(orientations[:, :1] < 0.0, -orientations, orientations)
    instancer.CreateProtoIndicesAttr(arrays.ints(np.array(chosen)))
    instancer.CreatePositionsAttr(arrays.vec3f(positions))
    instancer.CreateScalesAttr(arrays.vec3f(np.repeat([[p.size] for p in placements], 3, axis=1)))
    quats = orientations.tolist()
    instancer.CreateOrientationsAttr(Vt.QuathArray([Gf.Quath(*each) for each in quats]))
    # half precision turns a long feather's tip by its thickness; older USD lacks the finer one
    if hasattr(instancer, "CreateOrientationsfAttr"):
        instancer.CreateOrientationsfAttr(Vt.QuatfArray([Gf.Quatf(*each) for each in quats]))
    instancer.CreateIdsAttr(Vt.Int64Array([stable_number(p.id) for p in placements]))
    shared: dict[str, list[Any]] = {
        "featherId": [p.id for p in placements],
        "featherKind": [p.kind.name for p in placements],
        "region": [p.region for p in placements],
        BARB_COUNT_PRIMVAR: [p.kind.barb_count for p in placements],
    }
    for name, values in shared.items():
        author_shared(instancer.GetPrim(), name, values, UsdGeom.Tokens.vertex)
