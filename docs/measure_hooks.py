"""Prints what hooks that may open cost while none slips, for docs/hooks.md.

python docs/measure_hooks.py [PAIRS]     default 100

Processor time of a swan primary with such hooks over that of one with closed hooks, in pairs in
random order: 40 frames of 1/96 s in which it sags, 21 rows and 6 columns.
"""

from __future__ import annotations

import random
import sys
import time
from dataclasses import replace

import numpy as np

from featherfx.feather.build import build_feather
from featherfx.lab.feathers.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state

KIND = feather_kind("swan_primary")
ROWS, COLUMNS, FRAMES, DURATION = 21, 6, 40, 1.0 / 96.0
LOADS = no_loads(1, (0.0, 0.0, -9.81))


def solver(hooks: str) -> Solver:
    """Of a feather whose hooks do that under load."""
    kind = replace(KIND, vane_material=replace(KIND.vane_material, hooks=hooks))
    return Solver(make_model([build_feather(kind, ROWS, COLUMNS)], [kind], 1), Settings())


def sag(own: Solver) -> tuple[float, int, int]:
    """Processor seconds, steps and iterations."""
    state, steps, iterations = rest_state(own.model, np.zeros((1, 3)), np.eye(3)[None]), 0, 0
    begin = time.process_time()
    for _ in range(FRAMES):
        report = own.advance(state, LOADS, hold_roots(state), DURATION)
        steps, iterations = steps + int(report.steps[0]), iterations + int(report.iterations[0])
    spent = time.process_time() - begin
    if own.model.hooked and (state.gaps.slip.any() or (state.gaps.hooked < 1.0).any()):
        raise SystemExit("a gap has slipped")
    return spent, steps, iterations


def main() -> None:
    solvers = {hooks: solver(hooks) for hooks in ("closed", "open")}
    for hooks, own in solvers.items():
        print("{}: {} steps, {} iterations".format(hooks, *sag(own)[1:]))
    order, ratios = random.Random(1), []
    for _ in range(int(sys.argv[1]) if len(sys.argv) > 1 else 100):
        pair = order.sample(list(solvers), 2)
        spent = {hooks: sag(solvers[hooks])[0] for hooks in pair}
        ratios.append(spent["open"] / spent["closed"])
    low, median, high = np.quantile(ratios, (0.25, 0.5, 0.75))
    print(f"median {median:.3f} (half of the pairs {low:.3f} to {high:.3f})")


if __name__ == "__main__":
    main()
