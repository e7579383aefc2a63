"""Feathers that are alike and to which the same happens are solved once.

Two feathers of a batch are twins over a sample if they have one shape, or one the other's mirror
image, if their states are each other's image, and if root, gravity and wind do the same to both as
seen from their roots. One of them is stepped; the others become its images. Feathers with grips,
forces or targets of their own, those that have left their roots, and those in gusts are no twins.

"mirrored": only mirror images in the plane y = 0, of bodies that stand in it, where all of this
holds to the last bit. The solver has no preferred side, so a feather's values are then those that
it would have got by itself, whoever else is simulated.
"all": wherever twins stand, to within SLACK. What is written differs from what each would have got
by itself by rounding, and by what the tolerance allows where a step's length hangs on a rounding,
or a feather flutters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.rotation import quats_to_frames
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.groom.types import Placement
from featherfx.mechanics.model import Loads
from featherfx.shot.detail.cycle import SLACK
from featherfx.solver.image import MIRROR, StateImage
from featherfx.solver.solver import StepReport
from featherfx.solver.state import LONG_STEP_COUNTS, State
from featherfx.solver.step.root_path import RootPath

# of the largest value of a feather's array, by which states of twins may differ
STATE_SLACK = 1e-5


class Alike(NamedTuple):
    """What of a batch may be twins. shape: (F,) number of the feather's shape, mirrored or not.
    mirrored: (F,). exact: whether only to the last bit."""

    shape: Indices
    mirrored: Flags
    exact: bool


class Twins(NamedTuple):
    """own: (P,) feathers that become images of those in given (P,)."""

    own: Indices
    given: Indices
    image: StateImage

    def written(self, state: State, report: StepReport | None = None) -> State:
        """The state in which the twins stand as those that were stepped do; in the report, in
        place, they err as these do."""
        if not len(self.own):
            return state
        new = state.copy()
        images = self.image.of(state, self.given, self.own)
        for name, array in new.arrays().items():
            array[self.own] = images[name]
        for name in () if report is None else ("error", "move", *LONG_STEP_COUNTS):
            figure = getattr(report, name)
            figure[self.own] = figure[self.given]
        return new

    def pairs_of(self, other: Twins) -> bool:
        """Whether the same feathers are images of the same ones."""
        return np.array_equal(self.own, other.own) and np.array_equal(self.given, other.given)

    def stepped(self, awake: Flags) -> Indices:
        """Of feathers that are awake (F,), those that are not images of others."""
        awake = awake.copy()
        awake[self.own] = False
        return np.flatnonzero(awake)

    @staticmethod
    def none() -> Twins:
        """No feathers."""
        none = np.zeros(0, dtype=np.int64)
        return Twins(none, none, StateImage(np.zeros((0, 3, 3)), np.zeros((0, 3))))


def alike(placements: Sequence[Placement], twins: str) -> Alike | None:
    """What of a batch's feathers may be twins, if any. twins: key of the shot."""
    if twins == "none":
        return None
    # kinds are compared once for each that there is
    known: dict[int, int] = {}
    kinds: dict[object, int] = {}
    for each in placements:
        for kind in (each.kind, each.prototype):
            if kind is not None and id(kind) not in known:
                known[id(kind)] = kinds.setdefault(kind.uncoloured, len(kinds))
    shapes: dict[object, int] = {}
    keys = [(known[id(p.kind)], known.get(id(p.prototype)), p.size) for p in placements]
    shape = np.array([shapes.setdefault(key, len(shapes)) for key in keys])
    mirrored = np.array([p.mirrored for p in placements])
    exact = twins == "mirrored"
    return None if len(shapes) == len(keys) else Alike(shape, mirrored, exact)


def twins_of(
    some: Alike,
    state: State,
    path: RootPath,
    loads: Loads,
    awake: Flags,
    written: Twins | None = None,
) -> Twins:
    """Twins among the feathers of a batch that are awake (F,).

    path: of their roots. written: those whose images the state has, as nothing has changed since.
    """
    free = awake & ~_led_apart(loads)
    count = np.bincount(some.shape[free], minlength=int(some.shape.max()) + 1)
    numbers = np.flatnonzero(free & (count[some.shape] > 1))
    if not len(numbers) or _gusts(loads):
        return Twins.none()
    frames = quats_to_frames(path.base[numbers])
    flipped = some.mirrored[numbers]
    seen = _as_given(frames, flipped) if some.exact else _from_roots(frames, flipped)
    inputs = _inputs(seen, flipped, path, loads, numbers, some.exact)
    given = _first_alike(some.shape[numbers], inputs, 0.0 if some.exact else SLACK)
    pairs = np.flatnonzero(given != np.arange(len(numbers)))
    turn = np.swapaxes(seen[pairs], 1, 2) @ seen[given[pairs]]
    own, others = numbers[pairs], numbers[given[pairs]]
    starts = path.samples[:, 0, :3]
    shift = starts[own] - np.einsum("pij,pj->pi", turn, starts[others])
    found = Twins(own, others, StateImage(turn, shift))
    if written is not None and found.pairs_of(written):
        return found
    same = _same(state, own, others, found.image, some.exact)
    return Twins(own[same], others[same], StateImage(turn[same], shift[same]))


def _gusts(loads: Loads) -> bool:
    return bool(loads.air[0] > 0.0 and np.any(loads.wind_amplitude))


def _led_apart(loads: Loads) -> Flags:
    """(F,) feathers with grips; all where forces act."""
    if loads.force.size or loads.couple.size:
        return np.ones(len(loads.wind_mean), dtype=np.bool_)
    return np.asarray((loads.grip_stiffness > 0.0).any(axis=1))


def _as_given(frames: Array, flipped: Flags) -> Array:
    """(P, 3, 3) from the world to what twins see alike: mirrored ones see it in the mirror."""
    return np.where(flipped[:, None, None], np.diag(MIRROR), np.eye(3)) + np.zeros_like(frames)


def _from_roots(frames: Array, flipped: Flags) -> Array:
    """(P, 3, 3) from the world to what twins see alike, their root frames."""
    seen = np.swapaxes(frames, 1, 2).copy()
    seen[flipped, 1] *= -1.0
    return seen


def _inputs(
    seen: Array, flipped: Flags, path: RootPath, loads: Loads, numbers: Indices, exact: bool
) -> Array:
    """(P, K) what acts on each, as it sees it."""
    places, turns = np.split(path.samples[numbers], 2, axis=2)
    if not exact:
        places = places - places[:, :1]
    sign = np.where(flipped, -1.0, 1.0)[:, None, None]
    vectors = [places, sign * turns, loads.wind_mean[numbers, None]]
    vectors += [np.broadcast_to(loads.gravity, (len(numbers), 1, 3))]
    parts = [(part @ np.swapaxes(seen, 1, 2)).reshape(len(numbers), -1) for part in vectors]
    if exact:
        quats = path.base[numbers] * np.where(flipped[:, None], [1.0, -1.0, 1.0, -1.0], 1.0)
        first = np.take_along_axis(quats, np.abs(quats).argmax(axis=1)[:, None], axis=1)
        parts.append(quats * np.sign(first))
    return np.concatenate(parts, axis=1)


def _first_alike(shape: Indices, inputs: Array, slack: float) -> Indices:
    """(P,) of each the place of the first one of its shape with the same inputs, or its own.

    Sorted by one sum of their inputs, equals are neighbours.
    """
    weights = np.random.default_rng(0).uniform(0.5, 1.0, inputs.shape[1])
    total = np.einsum("pk,k->p", inputs, weights)
    order = np.lexsort((np.arange(len(total)), total, shape))
    apart = np.diff(total[order]) > slack * inputs.shape[1] * (1.0 + np.abs(total[order][1:]))
    begins = np.concatenate([[True], apart | (np.diff(shape[order]) != 0)])
    run = np.cumsum(begins) - 1
    first = np.full(run[-1] + 1, len(total))
    np.minimum.at(first, run, order)
    given = np.empty(len(total), dtype=np.int64)
    given[order] = first[run]
    near = np.abs(inputs - inputs[given]) <= slack * (1.0 + np.abs(inputs))
    return np.where(near.all(axis=1), given, np.arange(len(total)))


def _same(state: State, own: Indices, given: Indices, image: StateImage, exact: bool) -> Flags:
    """(P,) whether the states of feathers are the images of others'."""
    same = np.ones(len(own), dtype=np.bool_)
    if not len(own):
        return same
    images = image.of(state, given, own)
    for name, array in state.arrays().items():
        now, then = (each.reshape(len(own), -1) for each in (array[own], images[name]))
        if not now.shape[1]:
            continue
        size = 0.0 if exact else STATE_SLACK * np.abs(now).max(axis=1, keepdims=True)
        same &= (np.abs(now - then) <= size).all(axis=1)
    return same
