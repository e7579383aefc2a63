"""Inverse statics: the unloaded shape of feathers whose balance under gravity is a given pose.

The given pose is held by stresses that balance the weight, so rest strains follow from these:

    rachis element     B^T s = (N, M),     s = dW(e),     rest strain = given strain - e
    barb               k q = Q(q),         rest turns = given turns, turned back by q
    vane               strain zero in the given pose

N, M: weight of all beyond the element, and its moment about the element's end. B: the part of the
strains' gradient that belongs to that end (rachis_kernels). Q: the weight's generalised force on
the coefficients q of a barb (barb_kernels). A feather is a cantilever, so s follows from statics
alone, and the solution is exact on every grid. Derived here.

Whether the given pose is also where the feather comes to rest is tried: at rest under a little less
gravity first, it has to come back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import frames_to_quats, quats_to_frames, vectors_to_frames
from featherfx.errors import some_of, warn_input
from featherfx.feather.types import barb_slice
from featherfx.groom.types import Groom, Placement
from featherfx.mechanics.model import Model, no_loads
from featherfx.mechanics.ribbon_kernels import curl_energy
from featherfx.solver.solver import Solver
from featherfx.solver.state import State
from featherfx.solver.types import CONVERGED

# rad: most that two rows or a joint may be turned back; beyond, other rest shapes have the same
# pose
_MAX_TURN = 3.0
# iterations for coefficients of barbs and for strips; rad, change that ends them
_MAX_ITERATIONS, _TURN_TOLERANCE = 60, 1e-12
# share of gravity to come back from, and of the length, how near
_LESS, _NEAR = 0.98, 1e-3


class UnloadedShape(NamedTuple):
    """Feathers with the given pose as balance. model: with their rest strains. state: in the given
    pose. missing: (F,) those without such a shape, which keep the given one as unloaded."""

    model: Model
    state: State
    missing: Flags


def find_unloaded(solver: Solver, state: State, gravity: Array) -> UnloadedShape:
    """Find the unloaded shape of feathers whose balance under gravity is their rest shape.

    solver: its model has the given pose as rest shape. state: of that at rest. gravity: (F, 3)
    m/s^2, in the frame of the state.
    """
    given = solver.model
    force = given.mass[..., None] * gravity[:, None, None]
    rachis = _rachis_strains(given, state, force)
    barb = _barb_turns(given, state, force)
    turned = np.abs(given.rachis_rest[..., 3:6] - rachis[..., 3:])
    missing = ~(turned.max(axis=(1, 2)) < _MAX_TURN) | ~(
        np.abs(_turns(given, barb)).max(axis=(1, 2, 3, 4), initial=0.0) < _MAX_TURN
    )
    model = _with_rest(given, rachis, barb, ~missing)
    pose = _with_strains(state, rachis, barb, ~missing)
    missing |= ~_comes_back(solver, model, pose, gravity)
    return UnloadedShape(
        _with_rest(given, rachis, barb, ~missing),
        _with_strains(state, rachis, barb, ~missing),
        missing,
    )


def _rachis_strains(model: Model, state: State, force: Array) -> Array:
    """(F, n-1, 6) strains of the rachis under dead forces (F, n, 1 + 2 m, 3) N."""
    nodes, centre = state.points.nodes, state.centre
    row = force.sum(axis=2)
    moment = np.cross(nodes - centre[:, :, None], force).sum(axis=2)
    whole = _beyond(row)[:, 1:]
    about_origin = _beyond(moment + np.cross(centre, row))[:, 1:]
    moment = about_origin - np.cross(centre[:, 1:], whole)
    quats = state.rotation
    half = quats_to_frames(quats[:, 1:] + quats[:, :-1])
    length = model.length[..., None]
    stretch = length * np.einsum("fnij,fni->fnj", half, whole)
    turn = model.rachis_rest[..., 3:6]
    angle = np.linalg.norm(turn, axis=-1)[..., None]
    axis = np.divide(turn, angle, out=np.zeros_like(turn), where=angle > 1e-8)
    world = np.einsum("fnij,fnj->fni", half, axis)
    factor = np.where(angle > 1e-8, 0.5 * angle / np.sin(0.5 * np.maximum(angle, 1e-8)), 1.0)
    lever = 0.5 * np.tan(0.25 * angle)
    span = np.diff(centre, axis=1) / length
    normals = np.swapaxes(half, -1, -2)  # by k
    arms = np.cross(span[:, :, None], normals)
    by_turn = lever[..., None] * np.cross(arms, world[:, :, None]) - 0.5 * arms
    moment = moment - np.einsum("fnki,fnk->fni", by_turn, stretch)
    bends = factor[..., None] * normals + ((1.0 - factor) * axis)[..., None] * world[:, :, None]
    bend = np.linalg.solve(np.swapaxes(bends, -1, -2), moment[..., None])[..., 0]
    stress = np.concatenate([stretch, bend], axis=-1)
    strain = stress / model.rachis_stiffness
    if model.rachis_rest.shape[2] > 6:
        for place in np.ndindex(strain.shape[:2]):
            strain[place][3:5] = _strip_strain(
                model.rachis_rest[place], model.rachis_stiffness[place], stress[place]
            )
    return strain


def _beyond(values: Array) -> Array:
    """(F, n, 3) sums from every row to the tip."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]


def _strip_strain(rest: Array, stiffness: Array, stress: Array) -> Array:
    """(2,) twist and bending of a strip whose section curls, by Newton; NaN where there is none.
    rest: (8,) in the given pose."""
    strain, step = np.zeros(6), 1e-7

    def excess(trial: Array) -> Array:
        own = rest.copy()
        own[4] -= trial[4]
        curl = curl_energy(trial, own, stiffness[4])
        return np.array([*(stiffness[3:5] * trial[3:5] + curl[1:3] - stress[3:5])])

    for _ in range(_MAX_ITERATIONS):
        left = excess(strain)
        slopes = [(excess(strain + step * each) - left) / step for each in np.eye(6)[3:5]]
        change = np.linalg.solve(np.transpose(slopes), left)
        strain[3:5] -= change
        if np.abs(change).max() < _TURN_TOLERANCE:
            return strain[3:5]
    return np.full(2, np.nan)


def _barb_turns(model: Model, state: State, force: Array) -> Array:
    """(F, 2, n, 2 C) coefficients that barbs have in the given pose."""
    points, count = _barbs(state.points.nodes), model.coefficients
    pull = _barbs(force)[:, :, :, 1:]
    if not count:
        return np.zeros((model.feathers, 2, model.rows, 0))
    # moments of the weight beyond each joint, about it
    beyond = np.cumsum(pull[:, :, :, ::-1], axis=3)[:, :, :, ::-1]
    about = np.cross(points[:, :, :, 1:], pull)
    about = np.cumsum(about[:, :, :, ::-1], axis=3)[:, :, :, ::-1]
    moment = about - np.cross(points[:, :, :, :-1], beyond)
    # (F, 2, n, m, 3, 3) of the segments of barbs in the given pose
    frame = quats_to_frames(state.rotation)[:, None] @ quats_to_frames(model.clamp)
    found = []
    for j in range(model.columns):
        frame = frame @ quats_to_frames(model.joints[:, :, :, j])
        found.append(frame)
    local = np.einsum("fsnmij,fsnmi->fsnmj", np.stack(found, axis=3), moment)
    barb = np.zeros((model.feathers, 2, model.rows, 2 * count))
    for _ in range(_MAX_ITERATIONS):
        turns = _turns(model, barb)
        columns = _turn_gradient(turns)
        loads = np.einsum("...ai,...i->...a", columns, local)
        wanted = np.concatenate([loads[..., a] @ model.shapes.T for a in range(2)], axis=-1)
        wanted = wanted / model.barb_stiffness
        change, barb = np.abs(wanted - barb).max(axis=(1, 2, 3)), wanted
        if change.max() < _TURN_TOLERANCE:
            return barb
    barb[change >= _TURN_TOLERANCE] = np.nan
    return barb


def _barbs(nodes: Array) -> Array:
    """(F, 2, n, m + 1, 3), of nodes (F, n, 1 + 2 m, 3)."""
    columns, root = nodes.shape[2] // 2, nodes[:, :, :1]
    sides = [nodes[:, :, barb_slice(side, columns)] for side in range(2)]
    return np.stack([np.concatenate([root, each], axis=2) for each in sides], axis=1)


def _turns(model: Model, barb: Array) -> Array:
    """(F, 2, n, m, 3) rotation vectors of joints by coefficients."""
    count = model.coefficients
    normal, in_plane = barb[..., :count] @ model.shapes, barb[..., count:] @ model.shapes
    return np.stack([np.zeros_like(normal), normal, in_plane], axis=-1)


def _turn_gradient(turns: Array) -> Array:
    """(..., 2, 3) columns 2 and 3 of the right Jacobian of exp at (0, y, z)."""
    y, z = turns[..., 1], turns[..., 2]
    angle = np.maximum(np.hypot(y, z), 1e-4)
    a = (1.0 - np.cos(angle)) / angle**2
    b = (angle - np.sin(angle)) / angle**3
    by_normal = np.stack([a * z, 1.0 - b * z * z, b * y * z], axis=-1)
    by_in_plane = np.stack([-a * y, b * y * z, 1.0 - b * y * y], axis=-1)
    return np.stack([by_normal, by_in_plane], axis=-2)


def _with_rest(model: Model, rachis: Array, barb: Array, some: Flags) -> Model:
    """The model with the rest strains of some feathers for which the pose has these strains."""
    rest, joints = model.rachis_rest.copy(), model.joints.copy()
    rest[some, :, :6] -= rachis[some]
    if model.coefficients:
        back = vectors_to_frames(-_turns(model, barb[some]))
        joints[some] = frames_to_quats(quats_to_frames(joints[some]) @ back)
    return model._replace(rachis_rest=rest, joints=joints)


def _with_strains(state: State, rachis: Array, barb: Array, some: Flags) -> State:
    """The state of the given pose with its strains."""
    new = state.copy()
    new.strains.rachis[some] = rachis[some, None]
    new.strains.barb[some] = barb[some, None]
    new.coefficient[some] = barb[some]
    return new


def _comes_back(solver: Solver, model: Model, pose: State, gravity: Array) -> Flags:
    """(F,) whether feathers that hang in a little less gravity return to the pose."""
    count = model.feathers
    found, given = np.zeros(count, dtype=np.bool_), solver.model
    solver.model = model
    for each in np.unique(gravity, axis=0):
        members = np.flatnonzero((gravity == each).all(axis=1))
        back, status = pose, np.zeros(count)
        for share in (_LESS, 1.0):
            x, y, z = share * each
            back, status, _ = solver.equilibrium(
                back, no_loads(count, (x, y, z)), feathers=members.tolist()
            )
        far = np.linalg.norm(back.points.nodes - pose.points.nodes, axis=-1).max(axis=(1, 2))
        near = far < _NEAR * model.length.sum(axis=1)
        found[members] = ((status == CONVERGED) & near)[members]
    solver.model = given
    return found


def hang_as_drawn(
    groom: Groom, placements: Sequence[Placement], solver: Solver, state: State
) -> State:
    """Give a solver the unloaded shapes of its feathers; return the state in the drawn pose.

    state: at rest in the drawn pose, where the shot begins. Gravity is the groom's, and turns with
    the roots. An InputWarning names feathers without such a shape.
    """
    gravity = groom.drawn_gravity
    assert gravity is not None
    roots = np.stack([each.rotation for each in placements])
    begun = quats_to_frames(state.rotation[:, 0])
    local = np.einsum("fij,fkj,k->fi", begun, roots, gravity)
    found = find_unloaded(solver, state, local)
    solver.model = found.model
    lost = [placements[f].id for f in np.flatnonzero(found.missing).tolist()]
    if lost:
        message = (
            f"{groom.source}: drawn_pose: no unloaded shape comes to rest in the drawn pose of"
            f" {some_of(lost)}: they hang from it. Make them stiffer, or draw"
            " them lower"
        )
        warn_input(message)
    return found.state
