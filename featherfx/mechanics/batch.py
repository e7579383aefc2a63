"""From rest geometry and materials to the constant arrays of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, frames_to_quats, quats_to_frames, rotation_vectors
from featherfx.feather.profiles import (
    at_places,
    barb_bending,
    hooked_fraction,
    hooked_stiffness,
    in_cells,
    vane_shares,
)
from featherfx.feather.types import Feather, barb_slice
from featherfx.groom.materials import VaneMaterial
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.model import Model, VaneHooks, no_hooks
from featherfx.mechanics.resolution import (
    has_elastic_clamp,
    is_guarded,
    may_open,
    may_slip,
    rachis_mass,
    rachis_stiffness,
    strip_stiffness,
    vane_width,
)
from featherfx.mechanics.vane_rest import (
    barb_nodes,
    cell_weights,
    cells_at_rest,
    clamped_shapes,
    curvature_shapes,
    end_corrections,
    hinges_at_rest,
    twists_at_rest,
)

# G of the compression guard over b A k (guard_kernels)
_GUARD_SCALE = 1.0 / 2592.0
# part of a vane that its barbs fill (barb surface fraction, Jouve 2024, table 5.2)
FIBRE_FRACTION = 0.14
# Pa, guard of barbs that nothing joins: k b n^2 / 864 = 540 N/m with the swan's b. Of 2e9 to 2e11
# the last kept ends that are pushed by 10 mN apart, at the same number of steps
_FIBRE_GUARD = 2e11
# J, at which a triangle yields whose hooks hold: none gets there, and its square is finite
_NEVER = 1e150
# of the scatter of the strength from gap to gap
_SCATTER_SEED = 41
# least share of hooks: what holds nothing still has an area that the air meets
MIN_HOOKED = 1e-6
# least n of a gap that is open at rest
_MIN_NEAREST = 0.01
# least compliance of an elastic clamp, in that of the barb it holds
_MIN_CLAMP = 1e-6
# powers of the size with which the constants of feathers grow that are `similar`
# (featherfx/groom/presets/scaling.py); the others are pure numbers
_POWERS: dict[str, float | Array] = {
    "length": 1.0,
    "rachis_stiffness": 3.0,
    "segment": 1.0,
    "barb_stiffness": 3.0,
    "cell_rest": np.array([-1.0, 1.0, -1.0]),
    "cell_stiffness": 3.0,
    "hinge_rest": np.array([0.0, -4.0, -4.0]),
    "hinge_stiffness": 3.0,
    "twist_rest": np.array([-3.0, 0.0]),
    "twist_stiffness": 3.0,
    "mass": 3.0,
    "rotary_inertia": 5.0,
    "rachis_area": 2.0,
    "air_volume": 3.0,
    "passing": 0.0,
    "attached": 0.0,
    "retardation": 0.0,
    "relaxation_time": 0.0,
    "relaxation_weight": 0.0,
    "cell_guard": np.array([3.0, 0.0]),
}


def make_model(
    feathers: Sequence[Feather],
    kinds: Sequence[FeatherKind],
    coefficients: int,
    touching: bool = False,
) -> Model:
    """Constant arrays of feathers that share a grid.

    feathers, kinds: one each per feather of the batch; all feathers have equal rows and columns
    and all kinds the same `barb_course`. coefficients: per barb and direction, 0 for rigid barbs,
    at most one a column: turns of more joints than there are would move nothing.
    touching: whether loose barbs do not pass through each other.
    Where a kind's barbs are clamped elastically, all get one more: see clamped_shapes.
    Damping is left at zero: featherfx.solver.damping.with_damping adds it. Roots are held.
    """
    columns = feathers[0].columns
    coefficients = min(coefficients, columns)
    vane = kinds[0].vane_material
    elastic = any(has_elastic_clamp(kind) for kind in kinds)
    guarded = any(is_guarded(kind, touching) for kind in kinds)
    known: dict[tuple[int, FeatherKind], dict[str, Array]] = {}
    parts = []
    for feather, kind in zip(feathers, kinds, strict=True):
        key = (id(feather), kind)
        if key not in known:
            known[key] = _constants(feather, kind, coefficients, elastic, touching)
        parts.append(known[key])
    stacked: dict[str, Any] = {name: np.stack([p[name] for p in parts]) for name in parts[0]}
    if not any(kind.vane_material.ribbon for kind in kinds):
        stacked["rachis_rest"] = stacked["rachis_rest"][:, :, :6].copy()
    if not guarded:
        stacked["cell_guard"] = np.zeros((len(parts), 0, 0, 0, 0, 0))
    hooks = no_hooks(len(parts), feathers[0].rows)
    if any(may_slip(kind) for kind in kinds):
        each = [_hooks(feather, kind) for feather, kind in zip(feathers, kinds, strict=True)]
        hooks = VaneHooks(*(np.stack(arrays) for arrays in zip(*each, strict=True)))
    factors = partial(barb_bending, vane)
    shapes = curvature_shapes(coefficients, columns, vane.barb_taper, factors)
    return Model(
        held=np.ones(len(parts), dtype=np.bool_),
        shapes=clamped_shapes(shapes) if elastic else shapes,
        retardation=np.zeros((len(parts), 2)),
        relaxation_time=np.zeros((len(parts), 2, 0)),
        relaxation_weight=np.zeros((len(parts), 2, 0)),
        hooks=hooks,
        **stacked,
    )


def resized(model: Model, sizes: Array) -> Model:
    """The model of feathers `similar` to its own and (F,) times as large, none of which slips."""
    found = {}
    for name, power in _POWERS.items():
        values = getattr(model, name)
        factors = np.power(sizes.reshape(-1, *[1] * (values.ndim - 1)), power)
        found[name] = values * factors if values.size else values
    absent = (model.segment == 0.0)[..., None]
    found["barb_stiffness"] = np.where(absent, model.barb_stiffness, found["barb_stiffness"])
    return model._replace(**found)


def _guard(feather: Feather, kind: FeatherKind, touching: bool) -> Array:
    """(2, n-1, m, 2, 2) cell_guard: of the vane, or, where that has none, of fibres."""
    vane, held = kind.vane_material, _held(feather, kind)
    own = vane.compression_guard * held
    fibres = own <= vane.compression_guard * MIN_HOOKED
    loose = 1.0 if may_open(kind) else (1.0 - held) * (touching and not vane.ribbon)
    modulus = np.where(fibres, _FIBRE_GUARD * loose, own)
    area = cells_at_rest(feather)[1] * cell_weights(feather.columns)[..., 0]
    stiffness = _GUARD_SCALE * _thickness(feather, kind) * area * modulus
    return np.stack([stiffness, np.where(fibres, FIBRE_FRACTION, 1.0)], axis=-1)


def _constants(
    feather: Feather, kind: FeatherKind, coefficients: int, elastic: bool, touching: bool
) -> dict[str, Array]:
    """Arrays of Model for one feather by name, without the leading axis F."""
    frames = row_frames(feather.rest.directors)
    centre = feather.rest.nodes[:, 0]
    length = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    clamp, joints, segment = _barb_rest(feather, frames)
    cell_rest, cell_area = cells_at_rest(feather)
    vane = kind.vane_material
    held = _held(feather, kind)
    across = held * in_cells(vane.across_barbs_profile, kind, feather)
    thick = in_cells(vane.thickness_profile, kind, feather)
    held_area = (across * thick * cell_area)[..., None] * cell_weights(feather.columns)
    bending = across * thick**3
    hinge_rest, hinge_stiffness = hinges_at_rest(feather, bending, vane.bending_across)
    twist_rest, twist_stiffness = twists_at_rest(feather, cell_area)
    return dict(
        length=length,
        rachis_rest=np.concatenate(
            [_rachis_rest(centre, frames, length), _ribbon(feather, kind, length)], axis=1
        ),
        rachis_stiffness=_rachis_stiffness(feather, kind, length),
        clamp=clamp,
        joints=joints,
        segment=segment,
        barb_stiffness=_barb_stiffness(feather, kind, coefficients, elastic),
        cell_rest=cell_rest,
        cell_stiffness=held_area
        * np.array([vane.modulus_across_barbs, vane.shear_modulus])
        * vane.thickness,
        hinge_rest=hinge_rest,
        hinge_stiffness=hinge_stiffness,
        twist_rest=twist_rest,
        twist_stiffness=4.0
        * vane.twist_ratio
        * vane.bending_across
        * twist_stiffness
        * bending[..., 0],
        mass=_mass(feather, kind, cell_area, length),
        rotary_inertia=_rotary_inertia(feather, kind, length),
        rachis_area=feather.width * _row_length(length),
        air_volume=_air_volume(feather, kind, cell_area),
        passing=_passing(vane),
        attached=np.array([vane.attached_coefficient, _lift_slope(feather, cell_area)]),
        cell_guard=_guard(feather, kind, touching),
    )


def _passing(vane: VaneMaterial) -> Array:
    """(2, 2) 1 / T, Pa s/m, and (1 - p) / p^2 of both vanes; infinite where they are closed."""
    gaps, speed = (np.broadcast_to(each, 2) for each in (vane.permeability, vane.transmissivity))
    closed = np.where(gaps > 0.0, 0.0, np.inf)
    resistance = np.divide(1.0, speed, out=closed, where=speed > 0.0)
    rise = np.divide(1.0 - gaps, gaps**2, out=np.zeros(2), where=gaps > 0.0)
    return np.stack([resistance, rise], axis=1)


def _held(feather: Feather, kind: FeatherKind) -> Array:
    """(2, n-1, m, 2) share of each triangle's stiffness that its hooked barbules have."""
    if kind.vane_material.ribbon:
        # its stiffness is all in the rachis'
        return np.full(feather.cell.shape, MIN_HOOKED)
    return np.maximum(hooked_stiffness(kind, feather), MIN_HOOKED)


def _thickness(feather: Feather, kind: FeatherKind) -> Array:
    """(n-1, m, 1) m, of the vane in the middle of each cell."""
    vane = kind.vane_material
    return vane.thickness * in_cells(vane.thickness_profile, kind, feather)


def _hooks(feather: Feather, kind: FeatherKind) -> VaneHooks:
    """Yield, growth, release and strength of one vane's gaps, without the leading axis.

    All gaps of a triangle share the slip up to the strength, so that its slip strain is that of
    one over the spacing of barbs; one of them opens, so that this slip is over the triangle's
    height.
    """
    cell_rest, cell_area = cells_at_rest(feather)
    vane, held = kind.vane_material, _held(feather, kind)
    own = _thickness(feather, kind) * cell_area * held
    volume = own[..., None] * cell_weights(feather.columns)
    scatter = np.random.default_rng(_SCATTER_SEED).normal(size=cell_area.shape[:2])
    weaker = np.exp(vane.hook_scatter * scatter)[:, :, None, None, None]
    strength = vane.hook_strength / vane.hook_yield_across
    limit = np.array([vane.hook_yield_across, vane.hook_yield_shear]) * weaker * volume
    shared = vane.hook_slip / kind.barb_spacing
    hardening = limit[..., 0] * shared
    growth = np.divide(strength - 1.0, hardening, out=np.zeros_like(hardening), where=hardening > 0)
    release = limit[..., 0] * vane.hook_release * cell_rest[..., 2]
    if vane.hooks != "open":
        release = np.full_like(release, np.inf)
    if vane.hooks == "closed":
        limit[:] = _NEVER
    loose = held <= MIN_HOOKED
    factors = in_cells(vane.across_barbs_profile, kind, feather)[..., None]
    stiffness = volume * factors * np.array([vane.modulus_across_barbs, vane.shear_modulus])
    there = (stiffness > 0.0) & ~loose[..., None]
    strains = np.divide(stiffness, limit, out=np.zeros_like(limit), where=there)
    limit[loose] = 0.0
    return VaneHooks(
        limit=limit,
        growth=growth,
        release=release,
        strength=np.array(strength),
        opened=np.where(loose, 1.0, _opened(feather, cell_area)),
        bounds=strains.max(axis=(0, 1, 2, 3)),
    )


def _opened(feather: Feather, cell_area: Array) -> Array:
    """(2, n-1, m, 2), n of gaps that are open at rest, 0 of the others.

    Where a split gapes, its barbs touch at the distance that they would have without it.
    """
    if feather.split.size == 0:
        return np.zeros(cell_area.shape)
    whole = replace(feather, rest=feather.rest._replace(nodes=feather.unsplit))
    _, unsplit_area = cells_at_rest(whole)
    nearer = np.divide(unsplit_area, cell_area, out=np.ones_like(cell_area), where=cell_area > 0.0)
    return np.where(feather.split, np.clip(nearer, _MIN_NEAREST, 1.0), 0.0)


def row_frames(directors: Array) -> Array:
    """(..., n, 3, 3) row frames, columns d1, d2, d3, of directors (..., n, 2, 3)."""
    second, third = directors[..., 0, :], directors[..., 1, :]
    return np.stack([np.cross(second, third), second, third], axis=-1)


def _row_length(length: Array) -> Array:
    """(n,) length of rachis that each row stands for."""
    own = np.zeros(len(length) + 1)
    own[:-1] += 0.5 * length
    own[1:] += 0.5 * length
    return own


def _rachis_rest(centre: Array, frames: Array, length: Array) -> Array:
    relative = np.einsum("nji,njk->nik", frames[:-1], frames[1:])
    bend = rotation_vectors(relative)
    turns = frames_to_quats(frames)
    # quaternions 1.. of a row, each with the sign nearest to the one before it
    sign = np.sign(dots(turns[:-1], turns[1:]))
    half = turns[:-1] + turns[1:] * np.where(sign == 0.0, 1.0, sign)[:, None]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    middle = quats_to_frames(half)
    stretch = np.einsum("nji,nj->ni", middle, np.diff(centre, axis=0) / length[:, None])
    return np.concatenate([stretch, bend], axis=1)


def _rachis_stiffness(feather: Feather, kind: FeatherKind, length: Array) -> Array:
    width = 0.5 * (feather.width[:-1] + feather.width[1:])
    height = 0.5 * (feather.height[:-1] + feather.height[1:])
    stretch, bend = rachis_stiffness(width, height, kind.rachis_material)
    middle = 0.5 * (feather.station[:-1] + feather.station[1:]) / feather.station[-1]
    modulus = at_places(kind.rachis_material.modulus_profile, middle)[:, None]
    stretch, bend = stretch * modulus, bend * modulus
    strip = _strip_width(feather, kind)[:, None]
    flat = strip_stiffness(strip[:, 0], kind.vane_material)
    stretch, bend = (
        np.where(strip > 0.0, of, own) for of, own in zip(flat, (stretch, bend), strict=True)
    )
    return np.concatenate([stretch * length[:, None], bend / length[:, None]], axis=1)


def _strip_width(feather: Feather, kind: FeatherKind) -> Array:
    """(n-1,) m, of the ribbon that each element is, 0 where it is a rachis."""
    if not kind.vane_material.ribbon:
        return np.zeros(feather.rows - 1)
    width = vane_width(feather)
    return np.asarray(0.5 * (width[:-1] + width[1:]))


def _ribbon(feather: Feather, kind: FeatherKind, length: Array) -> Array:
    """(n-1, 2) nu and f of ribbon_kernels."""
    vane = kind.vane_material
    flat = _strip_width(feather, kind) ** 2 / (vane.thickness * length)
    beam = 1.0 - vane.poissons_ratio**2
    return np.stack(
        [np.full(len(length), vane.poissons_ratio), 3.0 / 16.0 * beam * flat**2], axis=1
    )


def _mass(feather: Feather, kind: FeatherKind, cell_area: Array, length: Array) -> Array:
    """(n, 1 + 2 m) lumped masses."""
    mass = vane_mass(feather, kind, cell_area)
    line, _, _ = rachis_mass(feather.width, feather.height, kind.rachis_material)
    mass[:, 0] += line * _row_length(length)
    return mass


def vane_mass(feather: Feather, kind: FeatherKind, cell_area: Array | None = None) -> Array:
    """(n, 1 + 2 m) kg, of the vane at the nodes. cell_area: of the triangles, if known."""
    columns = feather.columns
    cell_area = cells_at_rest(feather)[1] if cell_area is None else cell_area
    mass = np.zeros((feather.rows, 1 + 2 * columns))
    density = kind.vane_material.surface_density
    thick = in_cells(kind.vane_material.thickness_profile, kind, feather)
    for side, node in enumerate(_at_corners(cell_area * thick * density)):
        is_barb = feather.barb_length[side] > 0.0
        even = node[is_barb]
        moved = even @ end_corrections(columns) - even
        # a barb beside one that is hardly there would be left with less than nothing at a node
        most, taken = 0.5 * even, np.maximum(-moved, 0.0)
        fraction = np.divide(most, taken, out=np.ones_like(even), where=taken > most)
        node[is_barb] = even + fraction.min(axis=1, keepdims=True) * moved
        mass[:, 0] += node[:, 0]
        mass[:, barb_slice(side, columns)] = node[:, 1:]
    return mass


def _at_corners(cells: Array) -> Array:
    """(2, n, m + 1) a third of what triangles (2, n-1, m, 2) have at each of their corners."""
    sides, rows, columns, _ = cells.shape
    node = np.zeros((sides, rows + 1, columns + 1))
    first, second = np.moveaxis(cells / 3.0, -1, 0)
    node[:, :-1, :-1] += first
    node[:, :-1, 1:] += first + second
    node[:, 1:, :-1] += first + second
    node[:, 1:, 1:] += second
    return node


def _lift_slope(feather: Feather, cell_area: Array) -> float:
    """Slope of the vane's lift by its angle, 1/rad, of its aspect ratio (Helmbold 1942)."""
    area = float(cell_area.sum())
    aspect = float(feather.barb_span.sum(axis=1).max()) ** 2 / area if area > 0.0 else 0.0
    return 2.0 * np.pi * aspect / (2.0 + np.sqrt(aspect * aspect + 4.0))


def _air_volume(feather: Feather, kind: FeatherKind, cell_area: Array) -> Array:
    """(n, 1 + 2 m) m^3 of air that a vane carries: pi c / 4 an area (air_kernels).

    c, where barbs are hooked: of the hooked strip across the rachis that a node lies in; where they
    are loose: of a barb with its barbules, as air passes between them.
    """
    columns, nodes, frames = feather.columns, feather.rest.nodes, feather.rest.directors
    offset = nodes[:, :, None] - nodes[:, 0]
    nearest = np.einsum("ipkx,ipkx->ipk", offset, offset).argmin(axis=2)
    offset = np.take_along_axis(offset, nearest[:, :, None, None], axis=2)[:, :, 0]
    along, aside = row_frames(frames)[..., 0][nearest], frames[:, 0][nearest]
    place = feather.station[nearest] + np.einsum("ipx,ipx->ip", offset, along)
    reach = np.abs(np.einsum("ipx,ipx->ip", offset, aside))
    hooked = 1.0 if kind.vane_material.ribbon else hooked_fraction(kind, feather)
    chord, carried = np.zeros(reach.shape), np.zeros((2, *reach.shape))
    solid = 1.0 - np.broadcast_to(kind.vane_material.permeability, 2)
    parts = _at_corners(cell_area * hooked), _at_corners(cell_area * (1.0 - hooked))
    for side, (closed, loose) in enumerate(zip(*parts, strict=True)):
        barbs, grown = barb_slice(side, columns), feather.barb_length[side] > 0.0
        carried[:, :, 0] += solid[side] * closed[:, 0], solid[side] * loose[:, 0]
        carried[:, :, barbs] = solid[side] * closed[:, 1:], solid[side] * loose[:, 1:]
        if columns > 0 and grown.any():
            fraction = closed[grown].sum(axis=1) / (closed + loose)[grown].sum(axis=1)
            at, width = place[grown, barbs.stop - 1], reach[grown, barbs.stop - 1] * fraction
            order = np.argsort(at)
            chord += np.interp(place, at[order], width[order])
    return np.asarray(0.25 * np.pi * (chord * carried[0] + kind.barb_spacing * carried[1]))


def _rotary_inertia(feather: Feather, kind: FeatherKind, length: Array) -> Array:
    """(n, 2) kg m^2: a director moves where the rachis turns about the other one."""
    _, about_second, about_third = rachis_mass(feather.width, feather.height, kind.rachis_material)
    return np.stack([about_third, about_second], axis=1) * _row_length(length)[:, None]


def _barb_rest(feather: Feather, frames: Array) -> tuple[Array, Array, Array]:
    """Clamp (2, n, 4), joints (2, n, m, 4) and segment lengths (2, n) at rest."""
    nodes = barb_nodes(feather.rest.nodes)
    steps = np.diff(nodes, axis=2)
    segment = feather.barb_length / feather.columns
    present = segment > 0.0
    outward = np.stack([frames[:, :, 1], -frames[:, :, 1]])
    normal = np.broadcast_to(frames[:, :, 2], outward.shape)
    joints = np.zeros((*steps.shape[:3], 4))
    joints[..., 0] = 1.0
    clamp = np.zeros((*steps.shape[:2], 4))
    before = np.zeros((*steps.shape[:2], 3, 3))
    for j in range(feather.columns):
        along = np.where(present[..., None], steps[:, :, j], outward)
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        # the vane's normal is carried along the barb without turning about it
        normal = normal - along * np.einsum("snk,snk->sn", normal, along)[..., None]
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        frame = np.stack([along, np.cross(normal, along), normal], axis=-1)
        if j == 0:
            clamp = frames_to_quats(np.einsum("nji,snjk->snik", frames, frame))
        else:
            joints[:, :, j] = frames_to_quats(np.einsum("snji,snjk->snik", before, frame))
        before = frame
    return clamp, joints, segment


def _barb_stiffness(feather: Feather, kind: FeatherKind, coefficients: int, elastic: bool) -> Array:
    """(2, n, 2 C): root stiffness of the row's bundle of barbs over the barb's length.

    elastic: with the stiffness of the bundle's clamp behind that of each direction.
    """
    vane = kind.vane_material
    length = feather.barb_length
    if vane.ribbon:
        # across itself the strip is a plate, within itself stiff
        plate = vane.bending_across
        stiff = plate * (float(length.max()) / vane.thickness) ** 2
        vane = replace(vane, barb_bending_normal=plate, barb_bending_in_plane=stiff)
    scale = np.divide(feather.barb_span, length, out=np.zeros_like(length), where=length > 0)
    roots = vane_shares(kind, feather.station)
    thick = at_places(vane.thickness_profile.rachis, roots)
    scale = scale * at_places(vane.along_barbs_profile.rachis, roots) * thick**3
    parts = []
    for bending, clamp in (
        (vane.barb_bending_normal, vane.barb_clamp_normal),
        (vane.barb_bending_in_plane, vane.barb_clamp_in_plane),
    ):
        parts.append(np.repeat((scale * bending)[:, :, None], coefficients, axis=2))
        if elastic:
            least = _MIN_CLAMP * length / bending
            compliance = np.where(length > 0.0, np.maximum(clamp, least), 1.0)
            parts.append((feather.barb_span / compliance)[:, :, None])
    stiffness = np.concatenate(parts, axis=2)
    return np.where(stiffness > 0.0, stiffness, 1.0)
