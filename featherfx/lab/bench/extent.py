"""How much is measured: the feathers, and the settings of a quick and of a full run."""

from __future__ import annotations

from dataclasses import dataclass

from featherfx.lab.bench.shake import EULER, Shake

HERO = Shake(rows=41, columns=10, coefficients=2)
PRODUCTION = Shake(rows=21, columns=6, coefficients=2)


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    grids (rows, columns), coefficients, steps (1/s), radii: of the front. tolerances: share of the
    length, with error control. reference: shake of the reference. batches: feathers at a time.
    duration: s, of the timed runs.
    """

    grids: tuple[tuple[int, int], ...]
    coefficients: tuple[int, ...]
    steps: tuple[int, ...]
    radii: tuple[float, ...]
    tolerances: tuple[float, ...]
    reference: Shake
    batches: tuple[int, ...]
    duration: float


QUICK = Extent(
    grids=((11, 4), (21, 6)),
    coefficients=(1, 2),
    steps=(24, 96, 384),
    radii=(0.0, 0.8, EULER),
    tolerances=(1e-2, 1e-3),
    reference=Shake(rows=81, columns=6, coefficients=3, step=1.0 / 1536.0, radius=0.8),
    batches=(1, 10, 100),
    duration=0.25,
)
FULL = Extent(
    grids=((6, 4), (11, 4), (21, 6), (41, 10)),
    coefficients=(0, 1, 2, 3),
    steps=(24, 96, 384),
    radii=(0.0, 0.5, 0.8, EULER),
    tolerances=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4),
    reference=Shake(rows=161, columns=10, coefficients=3, step=1.0 / 3072.0, radius=0.8),
    batches=(1, 10, 100, 1000),
    duration=0.5,
)
