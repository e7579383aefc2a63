"""What acts on a batch of feathers during a frame: gravity, wind, grips, root paths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import frames_to_turns, rotation_vectors
from featherfx.feather.types import Feather
from featherfx.mechanics.model import Loads, no_contacts
from featherfx.shot.loads.forces import force_at
from featherfx.shot.loads.wind import wind_field
from featherfx.shot.motion.motion import Roots
from featherfx.shot.types import Force, Grip, Shot
from featherfx.solver.solver import RootPath

Array = NDArray[np.float64]

PATH_SAMPLES = 5
# drag coefficient of a round shaft across the wind (Hoerner, subcritical)
SHAFT_DRAG = 1.1


def root_path(motion: Roots, members: NDArray[np.int64], start: float, end: float) -> RootPath:
    """Paths of the roots with indices members (F,) from start to end (s)."""
    poses = [motion.frames(time) for time in np.linspace(start, end, PATH_SAMPLES)]
    positions = np.stack([pose[0][members] for pose in poses], axis=1)
    rotations = np.stack([pose[1][members] for pose in poses], axis=1)
    relative = np.einsum("fkij,flj->fkil", rotations, rotations[:, 0])
    vectors = rotation_vectors(relative)
    for k in range(1, PATH_SAMPLES):
        vectors[:, k] = _nearest_branch(vectors[:, k], vectors[:, k - 1])
    samples = np.concatenate([positions, vectors], axis=2)
    return RootPath(samples, frames_to_turns(rotations[:, 0]))


def _nearest_branch(vectors: Array, before: Array) -> Array:
    """Rotation vectors (F, 3) on the branch (full turns added) nearest to those before."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = np.divide(vectors, angle, out=np.zeros_like(vectors), where=angle > 1e-12)
    turns = np.round((np.einsum("fk,fk->f", before, axis) - angle[:, 0]) / (2 * np.pi))
    return vectors + 2 * np.pi * turns[:, None] * axis


def frame_loads(
    shot: Shot,
    grips: Sequence[tuple[int, Grip]],
    feathers: Sequence[Feather],
    start_points: Sequence[Array],
    start: float,
    end: float,
    roots: Array | None = None,
    forces: Sequence[tuple[int, Force, Array]] = (),
) -> Loads:
    """Loads of a batch of F feathers from start to end (s since the first frame).

    grips: (place in the batch, grip) pairs. start_points: (n, P, 3) world points of every feather
    at the first frame, from which the grips' displacements count. roots: (F, 3) m, where a scene's
    wind is sampled for each feather. forces: (place in the batch, force, its weights (n, P)).
    """
    count = len(feathers)
    most = max((sum(1 for f, _ in grips if f == place) for place in range(count)), default=0)
    node = np.full((count, most, 2), -1, dtype=np.int64)
    targets = np.zeros((2, count, most, 3))
    stiffness = np.zeros((count, most))
    used = [0] * count
    for place, grip in grips:
        g = used[place]
        used[place] += 1
        node[place, g] = grip_node(grip, feathers[place])
        rest = start_points[place][node[place, g, 0], node[place, g, 1]]
        for k, time in enumerate((start, end)):
            targets[k, place, g] = rest + grip_share(grip, time) * grip.displacement
        stiffness[place, g] = grip.stiffness
    wind, source = shot.wind, shot.wind_source
    field = wind_field(wind)
    mean = np.tile(field.mean, (count, 1))
    if source is not None and roots is not None:
        mean += source.velocity(roots, 0.5 * (start + end))
    force, change = _dead_forces(forces, feathers, start, end)
    return Loads(
        gravity=np.asarray(shot.gravity, dtype=float),
        air=np.array([wind.air_density, wind.drag_normal, wind.drag_tangential, SHAFT_DRAG]),
        wind_mean=mean,
        wind_wave=field.wave_vectors,
        wind_rate=field.frequencies,
        wind_amplitude=field.amplitudes,
        wind_phase=field.phases,
        grip_node=node,
        grip_start=targets[0],
        grip_end=targets[1],
        grip_stiffness=stiffness,
        force=force,
        contacts=no_contacts(count),
        force_change=change,
    )


def _dead_forces(
    forces: Sequence[tuple[int, Force, Array]],
    feathers: Sequence[Feather],
    start: float,
    end: float,
) -> tuple[Array, Array]:
    """force and force_change of Loads."""
    if not forces:
        return np.zeros((len(feathers), 0, 0, 3)), np.zeros((0, 0, 0, 3))
    force = np.zeros((len(feathers), *feathers[0].points.shape))
    change = np.zeros_like(force)
    for place, each, weights in forces:
        before, after = force_at(each, start), force_at(each, end)
        force[place] += weights[..., None] * before
        change[place] += weights[..., None] * (after - before)
    return force, change


def grip_share(grip: Grip, time: float) -> float:
    """Share of a grip's displacement at a time (s); starts and ends with no velocity."""
    if grip.end <= grip.start:
        return 1.0 if time >= grip.end else 0.0
    share = min(max((time - grip.start) / (grip.end - grip.start), 0.0), 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def grip_node(grip: Grip, feather: Feather) -> tuple[int, int]:
    """Row and material point that a grip holds."""
    row = round(grip.row * (feather.rows - 1))
    column = round(grip.column * feather.columns)
    if column == 0:
        return row, 0
    return row, 2 + (0 if grip.side == "leading" else feather.columns) + column
