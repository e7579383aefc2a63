"""Hooks of random cases: vanes that slip, open, are split or loose in part, and are zipped up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.materials import VaneMaterial
from featherfx.groom.types import FeatherKind, Hooked, Splits, VaneShape
from featherfx.lab.bench.drawn import log_uniform
from featherfx.mechanics.model import Model
from featherfx.solver.preen import close_gaps
from featherfx.solver.state import State

# of the draws of hooks, apart from those of the rest of a case, which is the same without
_STREAM = 1
# draws of splits that may cross before a vane stays whole
_TRIES = 20
# shares of cases with splits and with vanes that are loose in part, and of frames before which a
# stroke zips the vane up
_SPLIT, _LOOSE, _STROKES = 0.5, 0.3, 0.5


@dataclass(frozen=True)
class Stroke:
    """A stroke of a beak between two frames over a whole feather. fraction: of what is open that
    it closes. reach: m, over which it does."""

    fraction: float
    reach: float


def hooks_of(seed: int) -> np.random.Generator:
    """Draws the hooks of a case."""
    return np.random.default_rng([_STREAM, seed])


def hooked(
    feather: Feather, kind: FeatherKind, random: np.random.Generator
) -> tuple[Feather, FeatherKind]:
    """A feather, and its kind, with hooks."""
    kind = replace(kind, vane_material=_hooks(kind.vane_material, random))
    if random.random() < _LOOSE:
        kind = _with_vanes(kind, replace(kind.leading, hooked=_loose(random)), kind.trailing)
    if random.random() >= _SPLIT:
        return build_feather(kind, feather.rows, feather.columns), kind
    for _ in range(_TRIES):
        split = _with_vanes(kind, _split(kind.leading, random), _split(kind.trailing, random))
        try:
            return build_feather(split, feather.rows, feather.columns), split
        except InputError:
            continue
    return build_feather(kind, feather.rows, feather.columns), kind


def strokes_of(
    random: np.random.Generator, frames: int, length: float
) -> tuple[Stroke | None, ...]:
    """Return the strokes before each frame of a feather of a length (m)."""
    return tuple(
        Stroke(random.uniform(0.1, 1.0), log_uniform(random, 1e-4, 1.0) * length)
        if frame > 0 and random.random() < _STROKES
        else None
        for frame in range(frames)
    )


def zipped(model: Model, state: State, stroke: Stroke | None) -> State:
    """The state after a stroke."""
    if stroke is None or not model.hooked:
        return state
    touched = np.ones(model.hooks.growth.shape[1:], dtype=bool)
    gaps = close_gaps(model, state, 0, touched, stroke.fraction, stroke.reach)
    if gaps is None:
        return state
    new = state.copy()
    for own, after in zip(new.gaps_of(0), gaps, strict=True):
        own[...] = after
    return new


def _hooks(vane: VaneMaterial, random: np.random.Generator) -> VaneMaterial:
    """Yields at strains of a thousandth to 1, strengths up to tenfold."""
    strain = log_uniform(random, 1e-3, 1.0)
    across = float(np.clip(strain * vane.modulus_across_barbs, 1.0, 1e9))
    return replace(
        vane,
        hooks=str(random.choice(["closed", "slip", "open", "open"])),
        hook_yield_across=across,
        hook_yield_shear=float(np.clip(strain * vane.shear_modulus, 1.0, 1e9)),
        hook_strength=min(across * log_uniform(random, 1.0, 10.0), 1e9),
        hook_slip=log_uniform(random, 1e-7, 1e-3),
        hook_release=log_uniform(random, 1e-7, 1e-3),
        hook_scatter=random.uniform(0.0, 0.5),
    )


def _loose(random: np.random.Generator) -> Hooked:
    share = _shares(random), _shares(random)
    return Hooked(rachis=share[0], barb=share[1])


def _shares(random: np.random.Generator) -> tuple[tuple[float, float], ...]:
    places: Array = np.sort(random.uniform(0.0, 1.0, 2))
    return tuple((float(place), float(random.choice([0.0, 0.5, 1.0]))) for place in places)


def _split(vane: VaneShape, random: np.random.Generator) -> VaneShape:
    if not vane.outline:
        return vane
    splits = Splits(
        count=int(random.integers(1, 5)),
        depth=random.uniform(0.1, 1.0),
        width=float(random.choice([0.0, 0.004, 0.02])),
        irregularity=random.uniform(0.0, 1.0),
        seed=int(random.integers(0, 1000)),
    )
    return replace(vane, splits=splits)


def _with_vanes(kind: FeatherKind, leading: VaneShape, trailing: VaneShape) -> FeatherKind:
    return replace(kind, leading=leading, trailing=trailing)
