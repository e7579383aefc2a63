"""Cache entries: feathers and metadata as the writer of caches takes them, and their limits."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx import usd
from featherfx._version import __version__
from featherfx.baking.options import BakeOptions, DrawnOptions
from featherfx.errors import Problem, all_of, require
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.profiles import at_places, barb_diameters, held_by_hooks, in_cells, on_faces
from featherfx.feather.shapes import distinct_shapes, with_detail
from featherfx.feather.types import Array, BarbCurves, Feather, RowMap
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.materials import Profile, look_text
from featherfx.groom.types import FeatherKind, Groom, Placement, shading_of
from featherfx.limits import refuse_beyond_memory
from featherfx.mechanics.resolution import may_slip
from featherfx.phases import phase
from featherfx.shot.frames import place
from featherfx.shot.patterns import Wet, last_fitting
from featherfx.shot.types import Quality, Shot
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write.options import BOTH_FORMS, CONDENSED_FORM, CURVES_FORM

if TYPE_CHECKING:
    from featherfx.feather.colours import FeatherColours
    from featherfx.shot.skin import BoundSkin
    from featherfx.usd.write.stages import Bodies

# bytes of a mesh point and of a barb, measured: while one feather is built, of a feather and of its
# map from the simulated grid, which feathers of one shape share, and of its poses on their way
_BUILDING_BYTES, _BUILT_BYTES, _MAP_BYTES, _POSE_BYTES = 2000, 190, 170, 100
_BUILDING_BARB_BYTES, _BARB_BYTES, _BARBULE_BYTES = 32_000, 10_000, 400


def entries_of(
    groom: Groom, feathers: Sequence[Feather], static: bool, skin: BoundSkin | None = None
) -> list[FeatherEntry]:
    """Make the entry of every feather of a groom."""
    coloured, shading = _coloured(groom), _shading(groom)
    shapes = [_shape(placement) for placement in groom.feathers]
    # the same for feathers of one shape, whatever their size
    held: dict[tuple[int, bool], Array | None] = {}
    for shape, placement, feather in zip(shapes, groom.feathers, feathers, strict=True):
        if (key := (id(shape[0]), shape[1])) not in held:
            held[key] = held_by_hooks(placement.kind, feather, static)
    return [
        FeatherEntry(
            id=placement.id,
            kind=placement.kind.name,
            region=placement.region,
            feather=feather,
            rest_points=place(feather.rest, placement.position, placement.rotation),
            static=static,
            root=None if skin is None else skin.roots[index],
            barb_widths=barb_diameters(
                placement.kind, np.linspace(0.0, 1.0, feather.columns + 1)[1:]
            ),
            vane_stiffness=_vane_stiffness(placement.kind),
            stiffened=_stiffened(placement.kind, feather),
            held=held[id(shape[0]), shape[1]],
            hooked=not static and may_slip(placement.kind),
            colours=_colour(placement, feather, None, shading) if coloured else None,
            shape=shape,
            look=look_text(placement.kind.drawn_look),
            barb_count=placement.kind.barb_count,
        )
        for index, (placement, feather, shape) in enumerate(
            zip(groom.feathers, feathers, shapes, strict=True)
        )
    ]


def _shape(placement: Placement) -> tuple[FeatherKind, bool, float]:
    kind, size = placement.prototype, placement.size
    return (
        (placement.kind, placement.mirrored, 1.0)
        if kind is None
        else (kind, placement.mirrored, size)
    )


def _colour(
    placement: Placement, feather: Feather, barbs: BarbCurves | None, shading: Sequence[str]
) -> FeatherColours:
    from featherfx.feather.colours import colour_feather

    return colour_feather(placement.kind, feather, barbs, placement.id, shading)


def _coloured(groom: Groom) -> bool:
    """Check for any feather with colours; then all are written with theirs."""
    return any(not each.kind.colour.is_plain for each in groom.feathers)


def _shading(groom: Groom) -> tuple[str, ...]:
    """Name what any feather has for shaders; then that of all is written."""
    return shading_of(each.kind for each in groom.feathers)


def refuse_too_large(
    groom: Groom, quality: Quality, drawn: DrawnOptions, source: str, instances: bool = False
) -> None:
    """Raise InputError where the meshes, barbs and barbules to draw do not fit, as into memory.

    quality: of the simulation. source: of the problem. instances: whether feathers of one shape are
    drawn once.
    """
    if drawn.barbules:
        parting = dict.fromkeys(p.kind.name for p in groom.feathers if p.kind.may_part)
        told = "may split, and barbules would bridge the split. Leave --barbules out"
        faults = [f"vanes of the kind '{name}' {told}" for name in parting]
        faults += [] if drawn.barbs else ["needs barbs. Give --barbs N, too"]
        require(*(Problem(source, "barbules", each) for each in faults))
    first, chosen = distinct_shapes(groom.feathers)
    rows, columns = drawn.grid(quality)
    points = rows * (2 * columns + 3)
    held = _BUILT_BYTES + (0 if (rows, columns) == (quality.rows, quality.columns) else _MAP_BYTES)
    each = 0 if instances else _POSE_BYTES * points
    needed = _BUILDING_BYTES * points + held * points * len(first) + each * len(chosen)
    what = f"{len(chosen)} feathers of {rows} rows and {columns} columns a side"
    if drawn.barbs:
        needed += drawn.barbs * (_BUILDING_BARB_BYTES + _BARB_BYTES * len(first))
        what += f" with {drawn.barbs} barbs a vane"
        barbules = 4 * drawn.barbs * (drawn.barbules or 0)
        needed += _BARBULE_BYTES * barbules * (len(first) + len(chosen))
        what += f" and {drawn.barbules} barbules a side" if barbules else ""
    refuse_beyond_memory(needed, source, "", what)


def refuse_splits_elsewhere(
    groom: Groom, quality: Quality, drawn: DrawnOptions, source: str
) -> None:
    """Raise InputError where vanes that may split would be drawn otherwise than they are
    simulated: between rows of another grid there is no split."""
    names = {p.kind.name: p.kind.may_part for p in groom.feathers if may_slip(p.kind)}
    if drawn.grid(quality) == (quality.rows, quality.columns):
        return
    problems = [
        Problem(
            source,
            "groom",
            f"hooks of the kind '{name}' may {'open' if parts else 'slip'}, and such a vane is "
            "drawn as it is simulated: leave out --render-rows and --render-columns",
        )
        for name, parts in names.items()
    ]
    require(*problems)


def refuse_unfit_form(groom: Groom, options: BakeOptions, source: str) -> None:
    """Raise InputError where feathers cannot be written in the form that is asked for."""
    problems = []
    if options.form == CURVES_FORM and not options.barbs:
        problems.append(Problem(source, "as", "curves needs barbs (--barbs N)"))
    if options.form == CURVES_FORM and options.diagnostics:
        problems.append(
            Problem(source, "as", "curves has no faces for diagnostics. Leave out --diagnostics")
        )
    if options.form == CONDENSED_FORM and (options.barbs or options.diagnostics):
        problems.append(
            Problem(source, "as", "condensed has no barbs and diagnostics. Leave them out")
        )
    if options.form in (CONDENSED_FORM, BOTH_FORMS):
        names = dict.fromkeys(p.kind.name for p in groom.feathers if p.kind.may_part)
        told = "may split, which condensed feathers have no place for. Use --as mesh or curves"
        problems += [
            Problem(source, "groom", f"vanes of the kind '{name}' {told}") for name in names
        ]
    if options.rates == "none" and options.accelerations:
        problems.append(
            Problem(
                source,
                "velocities",
                "none leaves no accelerations either. Leave out --accelerations",
            )
        )
    require(*problems)


def _vane_stiffness(kind: FeatherKind) -> tuple[float, float]:
    """N/m, thickness times modulus across the barbs and in shear."""
    vane = kind.vane_material
    return vane.thickness * vane.modulus_across_barbs, vane.thickness * vane.shear_modulus


def _stiffened(kind: FeatherKind, feather: Feather) -> Array | None:
    """(T,) factors of the vane's stiffness at each triangle; None where all are 1."""
    vane = kind.vane_material
    profiles = vane.thickness_profile, vane.across_barbs_profile
    if profiles == (Profile(), Profile()):
        return None
    thick, across = (in_cells(each, kind, feather) for each in profiles)
    return on_faces(feather, np.broadcast_to(thick * across, feather.cell.shape))


def drawn_entries(
    groom: Groom,
    quality: Quality,
    drawn: DrawnOptions,
    names: Sequence[str],
    skin: BoundSkin | None,
    wets: Sequence[Wet] = (),
) -> list[FeatherEntry]:
    """Make the entries of a bake: feathers as they are drawn, and maps from the simulated grid.

    quality: of the simulation. names: prim name per feather. wets: rules of the shot.
    """
    grid, count = (quality.rows, quality.columns), drawn.barbs
    meshes = drawn.grid(quality)
    coarse = build_feathers(groom.feathers, *grid)
    built: list[tuple[Feather, RowMap | None]]
    with phase("building", len(groom.feathers)) as done:
        if grid == meshes:
            built = [(feather, None) for feather in coarse]
        else:

            def build(number: int, placement: Placement) -> tuple[Feather, RowMap | None]:
                done(number)
                from featherfx.feather.barb_looks import render_feather

                return render_feather(placement.kind, grid, meshes, placement.mirrored)

            built = all_of(*(partial(build, *each) for each in enumerate(groom.feathers)))
            if groom.coat is not None:
                from featherfx.feather.leaves import lie_on_leaves  # only where a groom has a coat

                fine = lie_on_leaves(groom.feathers, [feather for feather, _ in built])
                built = [
                    (own, to_fine and with_detail(to_fine, c, own) if p.leaf else to_fine)
                    for p, own, c, (_, to_fine) in zip(
                        groom.feathers, fine, coarse, built, strict=True
                    )
                ]
    entries = entries_of(groom, [feather for feather, _ in built], static=False, skin=skin)
    for index, (placement, wet) in enumerate(
        zip(groom.feathers, last_fitting(wets, groom.feathers), strict=True)
    ):
        barbs = None
        if count:
            from featherfx.feather.barb_looks import barbed_feather

            shape = placement.kind, grid, count, placement.mirrored
            barbs = barbed_feather(*shape, placement.id, drawn.barbules or 0)
            if placement.leaf is not None:
                barbs = replace(barbs, points=barbs.points_map(coarse[index].rest))
            points = barbs.points @ placement.rotation.T + placement.position
            barbs = replace(barbs, points=points)
            if entries[index].colours is not None:
                colours = _colour(placement, built[index][0], barbs, _shading(groom))
                entries[index] = replace(entries[index], colours=colours)
        entries[index] = replace(
            entries[index],
            name=names[index],
            points_map=built[index][1],
            barbs=barbs,
            wet=wet >= 0 and wets[wet].clump > 0.0,
        )
    return entries


def metadata_of(groom: Groom, quality: Quality) -> dict[str, Any]:
    """Return metadata about the origin of a cache."""
    told = {"featherfx": __version__, "groom": groom.name, "quality": quality.name}
    x, y, _ = groom.forward
    heading = {} if x == 1.0 else {"heading": float(np.degrees(np.arctan2(y, x)))}
    moduli: dict[str, dict[str, float]] = {"kind_moduli": {}, "id_moduli": {}}
    places = np.linspace(0.0, 1.0, 101)
    for each in groom.feathers:
        material = each.kind.rachis_material
        mean = float(np.mean(at_places(material.modulus_profile, places)))
        own = material.youngs_modulus * mean
        if moduli["kind_moduli"].setdefault(each.kind.name, own) != own:
            moduli["id_moduli"][each.id] = own
    thickness = max(each.kind.vane_material.thickness for each in groom.feathers)
    return told | heading | moduli | {"thickness": thickness}


def scenery_of(shot: Shot, path: Path, bodies: Bodies) -> dict[str, Any]:
    """Return metadata of a cache at a path about skin and colliders of its shot, for images.

    bodies: of BakeTask.
    """
    found = []
    if shot.skin is not None:
        drawn = [part.surface for part in shot.skin.parts if part.surface.bones is None]
        found = [("skin", surface, shot.skin.clock) for surface in drawn]
    found += [("collider", each.surface, each.clock) for each in shot.colliders]
    layers = {each[0].file: file for file, each in bodies.items()}
    # a collider may be the skin, too
    known = {(each[1].file, each[1].path): each for each in reversed(found)}
    return _told_scenery(
        [
            _scenery(
                path,
                role,
                layers.get(surface.file, surface.file),
                surface.path,
                surface.variant_sets,
            )
            | {"start": clock.start, "time_codes_per_frame": float(clock.step)}
            | ({} if surface.subdivision else {"subdivision": False})
            for role, surface, clock in reversed(known.values())
        ],
        float(shot.first_frame),
    )


def scenery_of_groom(groom: Groom, path: Path) -> dict[str, Any]:
    """Return metadata of a groom at rest at a path about its mesh, for images."""
    if groom.skin_keys is None:
        return {}
    keys = ("usd", "prim", "rest", "variant_sets", "subdivision")
    name, prim, rest, variants, subdivision = (groom.skin_keys[key] for key in keys)
    file = usd.values.locate_file(groom.source.parent, name)
    place = Place(str(groom.source), "skin.variant_sets", Problems())
    scene = usd.stage.SourceScene(file, usd.values.open_stage(file))
    scene = usd.stage.choose_variants(scene, variants, place)
    if usd.stage.prim_kind(scene.stage.GetPrimAtPath(prim)) != "mesh":
        return {}
    # at rest a mesh is drawn in the pose that was groomed
    at = {} if rest is None else {"rest": float(rest)}
    at |= {} if subdivision else {"subdivision": False}
    entry = _scenery(path, "skin", file, prim, variants)
    return _told_scenery([entry | {"start": 0.0, "time_codes_per_frame": 1.0} | at], 0.0)


def _scenery(
    path: Path, role: str, file: Path, prim: str, variant_sets: Mapping[str, str]
) -> dict[str, Any]:
    found: dict[str, Any] = {"role": role, "file": _from(path.parent, file), "prim": prim}
    return found | ({"variant_sets": dict(variant_sets)} if variant_sets else {})


def _told_scenery(entries: Sequence[dict[str, Any]], first: float) -> dict[str, Any]:
    """first: time code of the cache at which files are at their `start`."""
    told = {str(number): each | {"first": first} for number, each in enumerate(entries)}
    return {"scenery": told} if told else {}


def _from(folder: Path, file: Path) -> str:
    """A path from a folder; whole where there is no way from it."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:
        return file.absolute().as_posix()
