"""Prints the figures of docs/measurements.md that come from a simulation.

python docs/measure.py [samples/swan_wing/shot.toml ...]
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.api import read_shot
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.shot.simulate import Simulation, simulate
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state

SAMPLES = Path(__file__).resolve().parents[1] / "samples"
FRAME = 1.0 / 24.0

# samples that take seconds
QUICK = ("swan_wing", "feather_pull", "breeze")


def segment_changes(feather: Feather, points: np.ndarray) -> Iterator[np.ndarray]:
    """Relative changes of length of the barb segments of each side; points: (n, P, 3)."""
    m = feather.columns
    for side in range(2):
        nodes = np.concatenate(
            [points[:, :1], points[:, 3 + side * m : 3 + (side + 1) * m]], axis=1
        )
        length = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
        present = feather.barb_length[side] > 0.0
        yield length[present] / (feather.barb_length[side, present, None] / m) - 1.0


def run(path: Path, jobs: int) -> tuple[str, float, float, Simulation]:
    """Hash of all points, largest change of a segment, wall seconds and the simulation."""
    begin = time.perf_counter()
    simulation = simulate(read_shot(path), jobs=jobs)
    digest, worst = hashlib.sha256(), 0.0
    for frame in simulation:
        for feather, points in zip(simulation.feathers, frame.points, strict=True):
            digest.update(points.tobytes())
            for change in segment_changes(feather, points):
                worst = max(worst, float(np.abs(change).max(initial=0.0)))
    return digest.hexdigest(), worst, time.perf_counter() - begin, simulation


def rest_drift(feather: Feather, kind: FeatherKind, coefficients: int) -> float:
    """Largest way (m) of a point in 1 s without loads, the root held."""
    model = make_model([feather], [kind], coefficients)
    state = start = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    with Solver(model, Settings()) as solver:
        for _ in range(24):
            state, report = solver.step(state, no_loads(1), hold_roots(state), FRAME)
            if report.status.any():
                return float("nan")
    return float(np.linalg.norm(state.points.nodes - start.points.nodes, axis=-1).max())


def time_error(path: Path) -> float:
    """Largest distance from a run with a 50th of the tolerance, as a share of feather length."""
    shot = read_shot(path)
    fine = replace(shot.quality, tolerance=0.02 * shot.quality.tolerance)
    worst = 0.0
    for one, other in zip(simulate(shot), simulate(replace(shot, quality=fine)), strict=True):
        for placement, a, b in zip(shot.groom.feathers, one.points, other.points, strict=True):
            way = np.delete(a - b, (1, 2), axis=1)
            worst = max(worst, np.linalg.norm(way, axis=2).max() / placement.kind.length)
    return float(worst)


def main() -> None:
    paths = [Path(each) for each in sys.argv[1:]] or [
        SAMPLES / name / "shot.toml" for name in QUICK
    ]
    for path in paths:
        run(path, 1)
        digest, worst, seconds, simulation = run(path, 1)
        other, _, seconds_of_two, _ = run(path, 2)
        shot = simulation.shot
        kind, feather = shot.groom.feathers[0].kind, simulation.feathers[0]
        coefficients = [each.coefficients for each in simulation.resolutions]
        drift = rest_drift(feather, kind, coefficients[0])
        print(f"{shot.name}: {len(simulation.feathers)} feathers, quality {shot.quality.name}")
        print(f"  seconds with 1 and 2 jobs      {seconds:.2f}, {seconds_of_two:.2f}")
        print(f"  Newton iterations, mean, max   {simulation.report['newton_iterations']}")
        print(f"  sub-steps, mean, max           {simulation.report['substeps']}")
        print(f"  coefficients of the barbs      {sorted(set(coefficients))}")
        print(f"  barb segments, largest change  {worst:.1e}")
        print(f"  drift of the first feather     {drift:.1e} m in 1 s")
        print(f"  error of the sub-stepping      {time_error(path):.2%} of a feather's length")
        print(f"  same bytes for 1 and 2 jobs    {digest == other}")


if __name__ == "__main__":
    main()
