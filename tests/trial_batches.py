"""Batches for trial: feathers of the shipped presets, plain rods, random poses and rotations."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_to_quats
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import kind_of
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Model, no_hooks
from featherfx.shot.read.reference import list_presets
from featherfx.solver.state import State, rest_state

Random = np.random.Generator

FEATHER_PRESETS = [each.name for each in list_presets() if each.family == "feather"]


@cache
def preset_kind(name: str) -> FeatherKind:
    """The feather kind of a shipped preset, nothing overridden."""
    _, tree = load_preset(f"feather/{name}")
    return kind_of(name, tree, Place("presets", name, Problems()))


def preset_batch(
    name: str,
    rows: int = 9,
    columns: int = 4,
    coefficients: int = 2,
    count: int = 1,
    mirrored: bool = False,
) -> tuple[Feather, Model]:
    """A preset's feather and a batch of `count` of it."""
    kind = preset_kind(name)
    feather = build_feather(kind, rows, columns, mirrored)
    return feather, make_model([feather] * count, [kind] * count, coefficients)


def rod(
    rows: int,
    length: float = 1.0,
    bending: float = 1.0,
    torsion: float = 1.0,
    stretching: float = 1e6,
    line_mass: float = 1.0,
) -> Model:
    """A straight held rod without barbs: EI and GJ in N m^2, EA in N, kg/m."""
    element = length / (rows - 1)
    stiffness = np.zeros((1, rows - 1, 6))
    stiffness[..., :3] = stretching * element
    stiffness[..., 3] = torsion / element
    stiffness[..., 4:] = bending / element
    rest = np.zeros((1, rows - 1, 6))
    rest[..., 0] = 1.0
    mass = np.full((1, rows, 1), line_mass * element)
    mass[0, [0, -1]] *= 0.5
    clamp = np.zeros((1, 2, rows, 4))
    clamp[..., 0] = 1.0
    return Model(
        held=np.array([True]),
        length=np.full((1, rows - 1), element),
        rachis_rest=rest,
        rachis_stiffness=stiffness,
        clamp=clamp,
        joints=np.zeros((1, 2, rows, 0, 4)),
        segment=np.zeros((1, 2, rows)),
        shapes=np.zeros((0, 0)),
        barb_stiffness=np.zeros((1, 2, rows, 0)),
        cell_rest=np.zeros((1, 2, rows - 1, 0, 2, 3)),
        cell_stiffness=np.zeros((1, 2, rows - 1, 0, 2, 2)),
        hinge_rest=np.zeros((1, 2, rows, 0, 3)),
        hinge_stiffness=np.zeros((1, 2, rows, 0)),
        twist_rest=np.zeros((1, 2, rows - 1, 0, 2)),
        twist_stiffness=np.zeros((1, 2, rows - 1, 0)),
        mass=mass,
        rotary_inertia=np.full((1, rows, 2), 1e-6 * line_mass * length**2 * element),
        rachis_area=np.zeros((1, rows)),
        air_volume=np.zeros((1, rows, 1)),
        passing=np.full((1, 2, 2), np.inf),
        attached=np.zeros((1, 2)),
        retardation=np.zeros((1, 2)),
        relaxation_time=np.zeros((1, 2, 0)),
        relaxation_weight=np.zeros((1, 2, 0)),
        hooks=no_hooks(1, rows),
    )


def at_origin(model: Model) -> State:
    """All feathers of a batch at rest, roots at the origin, unturned."""
    count = model.feathers
    return rest_state(model, np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)))


def random_quat(rng: Random) -> Array:
    """(4,) unit quaternion, uniform over all rotations."""
    quat = rng.normal(size=4)
    return quat / np.linalg.norm(quat)


def rotation_of(vector: Any) -> Array:
    """(3, 3) matrix of a rotation vector (rad)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


def turned(quat: Array, vector: Array) -> Array:
    """(4,) quaternion followed by a world rotation vector (rad)."""
    from featherfx.algebra.vectors import quats_to_frames

    return frames_to_quats(rotation_of(vector) @ quats_to_frames(quat))


def random_pose(model: Model, rng: Random, bend: float = 0.1, curl: float = 0.3) -> State:
    """One feather far from rest: rows turned by about `bend` rad, barbs curled by about `curl`,
    rachis points shifted by a thousandth of the feather's length."""
    state = at_origin(model)
    size = model.length[0].sum()
    for i in range(model.rows):
        state.rotation[0, i] = turned(state.rotation[0, i], bend * rng.normal(size=3))
    state.centre[0] += 1e-3 * size * rng.normal(size=(model.rows, 3))
    state.coefficient[...] = curl * rng.normal(size=state.coefficient.shape)
    return state


def barb_slopes(
    row: Array, clamp: Array, joints: Array, segment: float, shapes: Array, coefficients: Array
) -> Array:
    """(6 + 2 C, 3, m) derivatives of a barb's nodes by shift and turn of its row (about a rachis
    point at the origin) and by its coefficients."""
    from featherfx.mechanics.barb_kernels import (
        barb_axes,
        barb_jacobian,
        barb_points,
        root_jacobian,
    )

    columns, origin = shapes.shape[1], np.zeros(3)
    points, jacobian = np.zeros((columns, 3)), np.zeros((6 + len(coefficients), 3, columns + 1))
    frames = np.zeros((columns, 4))
    barb_points(row, origin, clamp, joints, segment, shapes, coefficients, frames, points)
    root_jacobian(origin, points, jacobian)
    axes = np.zeros((columns, 6))
    barb_axes(frames, shapes, coefficients, axes)
    barb_jacobian(axes, shapes, origin, points, jacobian)
    return jacobian[:, :, 1:]


def assembled(
    model: Model, loads: Any, fraction: float, factors: Any, work: Any, signed: bool = False
) -> Array:
    """Gradient (N,) of the first feather's step energy at the evaluated pose work.now.

    The Hessian is left in work.system.band.
    """
    from featherfx.solver.step.assembly_kernels import assemble
    from featherfx.solver.types import STABILISING_STIFFNESS, WHOLE_STIFFNESS

    wanted = WHOLE_STIFFNESS if signed else STABILISING_STIFFNESS
    assemble(model, loads, 0, fraction, factors, wanted, 0.0, work)
    return -work.system.right.copy()
