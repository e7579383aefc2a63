"""Feathers, strips and poses for the tests of the nodal kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from feather_kinds import RACHIS_MATERIAL, VANE_MATERIAL
from scipy.spatial.transform import Rotation

from featherfx.feather.build import build_feather
from featherfx.groom.materials import VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import nodal_rest_state
from featherfx.lab.strip import strip_feather, strip_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.vane_rest import end_corrections

LENGTH = 0.35
VANE = replace(VANE_MATERIAL, loss_factor=0.0)


def isotropic(young: float, thickness: float) -> VaneMaterial:
    """A plate without Poisson effect, alike along barbs and across them. young: Pa; thickness: m,
    or other units that fit."""
    bending = young * thickness**3 / 12.0
    return VaneMaterial(
        modulus_along_barbs=young,
        modulus_across_barbs=young,
        shear_modulus=0.5 * young,
        thickness=thickness,
        surface_density=1.0,
        barb_bending_normal=bending,
        barb_bending_in_plane=0.0,
        barb_taper=0.0,
        bending_across=bending,
        loss_factor=0.0,
    )


def curved_kind() -> FeatherKind:
    """A feather with camber, sweep, twist and curled barbs."""
    leading = VaneShape(
        ((0.0, 0.0), (0.08, 0.022), (0.3, 0.035), (0.7, 0.036), (1.01, 0.0)),
        (BarbGuide(0.0, 35.0, 5.0, 3.0), BarbGuide(1.0, 22.0, 6.0, 2.0)),
    )
    trailing = VaneShape(
        ((0.0, 0.0), (0.03, 0.05), (0.15, 0.1), (0.45, 0.12), (0.75, 0.1), (1.01, 0.0)),
        (BarbGuide(0.0, 65.0, 25.0, 8.0), BarbGuide(1.0, 25.0, 8.0, 3.0)),
    )
    return FeatherKind(
        name="trial",
        length=LENGTH,
        calamus=0.15,
        barb_spacing=5e-4,
        rachis=RachisShape(0.006, 0.0008, 1.2, 8.0, 12.0, 5.0),
        leading=leading,
        trailing=trailing,
        vane_material=VANE,
        rachis_material=replace(RACHIS_MATERIAL, loss_factor=0.0),
    )


def flat_kind() -> FeatherKind:
    """Straight barbs and shaft, barbs as stiff within the vane as out of it.

    Then both kinematics have one continuum limit: what a barb's energy says does not depend on
    whether its section follows the vane (nodal) or is carried along the barb (barb-curvature).
    """
    kind = curved_kind()

    def straight(vane: VaneShape) -> VaneShape:
        guides = tuple(BarbGuide(g.position, g.angle, 0.0, 0.0) for g in vane.guides)
        return VaneShape(vane.outline, guides)

    return replace(
        kind,
        leading=straight(kind.leading),
        trailing=straight(kind.trailing),
        rachis=replace(kind.rachis, camber=0.0, sweep=0.0, twist=0.0),
        vane_material=replace(VANE, barb_bending_in_plane=VANE.barb_bending_normal),
    )


def feather_models(kind, rows, columns, coefficients=2, **options):
    """(model, nodal) of one feather."""
    feather = build_feather(kind, rows, columns)
    model = make_model([feather], [kind], coefficients)
    return model, nodal_model(model, [feather], [kind], **options)


def strip_models(length, width, rows, columns, vane, pinned, **options):
    """(model, nodal) of one strip without a shaft; pinned: (n, 1 + 2 m)."""
    kind = strip_kind(length, vane)
    feather = strip_feather(length, width, rows, columns)
    model = make_model([feather], [kind], 0)
    nodal = nodal_model(model, [feather], [kind], has_rachis=False, pinned=pinned, **options)
    return model, nodal


def at_rest(model, nodal, rotation=None, position=(0.0, 0.0, 0.0)):
    rotation = np.eye(3) if rotation is None else rotation
    return nodal_rest_state(model, nodal, np.array([position]), rotation[None])


def shifted(state, nodal, step):
    """The state with its unknowns (N,) moved by a step, as the solver numbers them."""
    new, slot = state.copy(), nodal.slot[0]
    for i, p in np.argwhere(slot >= 0):
        new.points.nodes[0, i, p] += step[slot[i, p] : slot[i, p] + 3]
    for i in np.flatnonzero(nodal.frame_slot[0] >= 0):
        at = nodal.frame_slot[0, i]
        before = Rotation.from_quat(np.roll(new.rotation[0, i], -1))
        turned = Rotation.from_rotvec(step[at : at + 3]) * before
        new.rotation[0, i] = np.roll(turned.as_quat(), 1)
    return new


def end_row_loads(loads, model, direction, total):
    """Dead load of the given total (N) spread along the last row as a constant traction, in the
    shares in which a vane's stress is summed along its barbs."""
    columns = model.columns
    side = np.r_[0.5, np.ones(columns - 1), 0.5] @ end_corrections(columns)
    weight = np.r_[side[:0:-1], 2.0 * side[0], side[1:]] / (2 * columns)
    order = [*range(2 * columns, columns, -1), *range(1 + columns)]
    force = np.zeros((1, model.rows, 1 + 2 * columns, 3))
    force[0, -1, order] = total * weight[:, None] * np.asarray(direction)
    return loads._replace(force=force)
