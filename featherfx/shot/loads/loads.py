"""Loads on a batch of feathers during a frame: gravity, wind, grips and dead forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.types import Feather
from featherfx.mechanics.model import Loads, no_contacts
from featherfx.shot.loads.forces import dead_forces, gripped
from featherfx.shot.loads.wind import wind_field
from featherfx.shot.types import Force, Grip, Shot

# drag coefficient of a round shaft across the wind (Hoerner, subcritical)
SHAFT_DRAG = 1.1


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

    grips: (place in the batch, grip) pairs. start_points: (n, 1 + 2 m, 3) world nodes of every
    feather at the first frame, from which the grips' displacements count. roots: (F, 3) m, where a
    scene's wind is sampled for each feather. forces: (place in the batch, force, its weights
    (n, 1 + 2 m)).
    """
    count, wind, source = len(feathers), shot.wind, shot.wind_source
    field = wind_field(wind)
    mean, change = np.tile(field.mean, (count, 1)), np.zeros((count, 3))
    if source is not None and roots is not None:
        mean += source.velocity(roots, 0.5 * (start + end))
        if end > start:
            # the acceleration of the air itself, which passes the roots halfway
            way = 0.5 * (end - start) * mean
            gain = source.velocity(roots + way, end) - source.velocity(roots - way, start)
            change = gain / (end - start)
    node, targets, stiffness, most = gripped(grips, feathers, start_points, start, end)
    force, force_change = dead_forces(forces, feathers, start, end)
    return Loads(
        # a copy: kernels would be compiled once more for arrays that are read-only
        gravity=np.array(shot.gravity, dtype=float),
        air=np.array([wind.air_density, wind.drag_normal, wind.drag_tangential, SHAFT_DRAG]),
        wind_mean=mean,
        wind_change=change,
        wind_wave=np.ascontiguousarray(field.wave_vectors.T),
        wind_rate=field.frequencies,
        wind_amplitude=np.ascontiguousarray(field.amplitudes.T),
        wind_phase=field.phases,
        grip_node=node,
        grip_start=targets[0],
        grip_end=targets[1],
        grip_stiffness=stiffness,
        max_grip_force=most,
        force=force,
        contacts=no_contacts(count),
        force_change=force_change,
        added_mass=np.ones(count) if wind.added_mass else np.zeros(0),
    )
