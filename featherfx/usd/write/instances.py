"""Static plumage as instances: a PointInstancer whose prototypes are the repeated shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from featherfx.algebra.rotation import frames_to_quats
from featherfx.feather.colours import colour_feather, shading_of, uniform
from featherfx.feather.types import Feather
from featherfx.files.atomic_write import standing
from featherfx.files.content import stable_number
from featherfx.groom.looks import look_text
from featherfx.groom.types import Placement
from featherfx.shot.frames import place
from featherfx.usd import arrays
from featherfx.usd.types import (
    BARB_COUNT_PRIMVAR,
    MESH_PRIM,
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
from featherfx.usd.write.poses import make_posed_feathers
from featherfx.usd.write.prims import author_shared, define_mesh

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
