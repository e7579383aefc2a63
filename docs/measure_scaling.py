"""Droop and first frequency of a feather at several sizes, by each rule of scaling.

python docs/measure_scaling.py [preset]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.feather.build import build_feather
from featherfx.groom.keys.problems import Problems
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.presets.library import Library
from featherfx.groom.read.read import groom_of
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state
from featherfx.solver.step.modes import frequencies

SIZES = (0.25, 0.5, 1.0, 2.0, 5.0)
ROWS, COLUMNS, COEFFICIENTS = 21, 6, 2


def measured(kind: FeatherKind) -> tuple[float, float, float]:
    """Droop of the tip and of the lowest barb's end below its root, over the length, in a frame
    that holds the shaft level; and the first frequency, Hz."""
    feather = build_feather(kind, ROWS, COLUMNS)
    model = make_model([feather], [kind], COEFFICIENTS)
    start = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    with Solver(model, Settings(newton=1e-7 * kind.length)) as solver:
        loads = no_loads(1, (0.0, 0.0, -9.81))
        state, status, _ = solver.equilibrium(start, loads)
    assert status[0] == 0
    down = (start.points.nodes[0] - state.points.nodes[0])[..., 2]
    own = down[:, 1:] - down[:, :1]
    return down[-1, 0] / kind.length, own.max() / kind.length, frequencies(model, 0, 1)[0]


def main(preset: str = "swan_primary") -> None:
    library = Library((), Problems())
    feather = {"id": "a", "kind": preset, "position": [0, 0, 0]}
    groom = groom_of({"name": "one", "feather": [feather]}, Path("one.toml"), library)
    library.problems.raise_any()
    assert groom is not None
    print(f"{preset}: rule, size, tip and barbs down (% of the length), first frequency (Hz)")
    for rule in ("similar", "behaviour", "fixed_vane"):
        kind = replace(groom.feathers[0].kind, scaling=rule)
        for size in SIZES:
            tip, barbs, rate = measured(adjusted(kind, Change(scale=size)))
            print(f"| {rule} | {size:g} | {100 * tip:.2f} | {100 * barbs:.2f} | {rate:.2f} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
