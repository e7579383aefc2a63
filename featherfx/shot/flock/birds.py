"""Birds of a group: their places, phases and sizes, and how each one is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from featherfx.algebra.types import Array
from featherfx.shot.flock.paths import BirdPath, Spline, forward_turn
from featherfx.shot.flock.types import (
    FAR_BIRD,
    MIDDLE_BIRD,
    NEAR_BIRD,
    Bird,
    BirdGroup,
    Loop,
    SeenFrom,
)
from featherfx.shot.view import TimedCamera, relative_sizes

_MOST_OFF = 3.0  # standard deviations, of sizes


def place_birds(group: BirdGroup, number: int, path: Spline, loop: Loop) -> list[Bird]:
    """Place the birds of a group around its path. number: of the group."""
    places = qmc.Halton(3, seed=group.seed).random(group.birds)
    # each bird fills the box evenly; one alone is in its middle
    shifts = (2.0 * places - 1.0) * group.spread * (group.birds > 1)
    heading = path.turns(path.times[:1])[0] @ [1.0, 0.0, 0.0]
    turn = forward_turn(heading)
    return birds_on(group, number, [path.moved(turn @ shift) for shift in shifts], loop)


def birds_on(
    group: BirdGroup, number: int, paths: Sequence[BirdPath], loop: Loop, names: Sequence[str] = ()
) -> list[Bird]:
    """Return a bird on each path, with its phase, size and gusts. names: default: numbers."""
    random = np.random.default_rng([group.seed, number])
    phases = random.integers(0, loop.frames, len(paths))
    off = np.clip(random.standard_normal(len(paths)), -_MOST_OFF, _MOST_OFF)
    gusts = random.integers(0, group.gusts, len(paths))
    return [
        Bird(
            name=names[k] if names else f"bird_{number + 1}_{k + 1:04d}",
            group=number,
            path=path,
            phase=int(phases[k]),
            size=1.0 + group.size_variation * float(off[k]),
            gust=int(gusts[k]),
        )
        for k, path in enumerate(paths)
    ]


def look_at_birds(
    birds: Sequence[Bird], spans: Array, camera: TimedCamera, limits: SeenFrom, times: Array
) -> list[Bird]:
    """Choose by their sizes in the picture which birds are near, and which are far.

    spans: (N,) m, across each bird. times: (K,) s.
    """
    places = np.stack([each.path.positions(times) for each in birds])
    views = [camera.view(float(time)) for time in times]
    sizes = [relative_sizes(view, places[:, k], spans, 0.0) for k, view in enumerate(views)]
    pixels = limits.image_height * np.max(sizes, axis=0)

    def way(size: float) -> str:
        return (
            NEAR_BIRD
            if size > limits.near_above
            else FAR_BIRD
            if size < limits.far_below
            else MIDDLE_BIRD
        )

    return [
        replace(
            bird,
            way=way(size),
            pixels=float(size),
            size=1.0 if way(size) == NEAR_BIRD else bird.size,
        )
        for bird, size in zip(birds, pixels, strict=True)
    ]
