"""Random scenes of feathers that touch: each ends finite, or with a feather, a frame and a reason.

Two to forty feathers of four kinds, thrown together anywhere in a box that is small for them, in
each other as they come; roots that shake at up to 30 m/s and wind of up to 40 m/s. Each is a
process of its own, with the bounds of the other kinds (cases.py).
"""

from __future__ import annotations

import json
import math
import os
import random
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from featherfx.api import read_shot
from featherfx.errors import InputError, SimulationError
from featherfx.shot.loop.simulate import simulate

from .cases import SECONDS, Failure, Found, child, ended_by, nothing

KINDS = ("body_contour", "covert", "swan_secondary", "tail_feather")
FRAMES = 4


class Case(NamedTuple):
    """What became of a scene. depth: m, the deepest in motion; None where it was ended; seconds: of
    processor time."""

    number: int
    feathers: int
    outcome: str
    depth: float | None
    seconds: float
    said: str


def run(cases: Sequence[int], seed: int) -> Iterator[Found]:
    """Outcomes of each scene by name.

    done: all frames are finite. named: an error that names feather, frame and reason. broken: any
    other. hang, crash: ended by a bound or a signal.
    """
    with tempfile.TemporaryDirectory() as name:
        # kernels are loaded once, for all
        _ended(_scene(random.Random("first"), Path(name)), -1)
        for number in cases:
            result = nothing()
            case = _tried(random.Random(f"{seed} {number}"), number, Path(name))
            if case.outcome not in ("done", "named"):
                result.failures.append(Failure(number, case.said))
            result.outcomes[case.outcome] += 1
            result.scenes.append(case._asdict())
            result.through.append(number)
            yield result


def _tried(chance: random.Random, number: int, folder: Path) -> Case:
    """What becomes of a scene in a process of its own."""
    scene, log = _scene(chance, folder), folder / "log"
    log.unlink(missing_ok=True)
    end = child(log, lambda file: _write(file, _ended(scene, number)))
    if os.WIFSIGNALED(end):
        outcome, signal = ended_by(end)
        return Case(number, scene[1], outcome, None, None, SECONDS, signal)
    if end:
        return Case(number, scene[1], "broken", None, None, 0.0, log.read_text())
    return Case(*json.loads(log.read_text()))


def _write(file: int, case: Case) -> None:
    os.write(file, json.dumps(case).encode())


def _scene(chance: random.Random, folder: Path) -> tuple[Path, int]:
    """A shot file, and how many feathers it has."""
    count = chance.randint(2, 40)
    edge = 0.03 * count ** (1.0 / 3.0)
    lines = ['name = "thrown"']
    for k in range(count):
        place = [round(chance.uniform(-edge, edge), 5) for _ in range(3)]
        shaft = [round(chance.gauss(0.0, 1.0), 4) for _ in range(3)]
        up = np.cross(shaft, [chance.gauss(0.0, 1.0) for _ in range(3)]).round(4).tolist()
        lines += [
            "[[feather]]",
            f'id = "f{k}"',
            f'kind = "{chance.choice(KINDS)}"',
            f"position = {place}",
            f"direction = {shaft}",
            f"up = {up}",
            f"scale = {chance.uniform(0.2, 0.6):.3f}",
        ]
    (folder / "groom.toml").write_text("\n".join(lines) + "\n")
    frequency, speed = chance.uniform(0.5, 8.0), chance.choice([0.0, chance.uniform(0.0, 30.0)])
    lines = [
        'name = "thrown"',
        'groom = "groom.toml"',
        f"frames = [1, {FRAMES}]",
        "frames_per_second = 24",
        'quality = "draft"',
        "[contact]",
        "[motion]",
        'kind = "shake"',
        f"frequency = {frequency:.4f}",
        f"amplitude = {speed / (2.0 * math.pi * frequency):.5f}",
        "direction = [0, 0.3, 1]",
        "[wind]",
        'base = "breeze"',
        f"speed = {chance.choice([0.0, chance.uniform(0.0, 40.0)]):.3f}",
    ]
    (folder / "shot.toml").write_text("\n".join(lines) + "\n")
    return folder / "shot.toml", count


def _ended(scene: tuple[Path, int], number: int) -> Case:
    path, count = scene
    start = time.process_time()
    depth, outcome, said = 0.0, "done", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            simulation = simulate(read_shot(path), 1)
            for frame in simulation:
                if not all(np.isfinite(points).all() for points in frame.rows):
                    outcome, said = "broken", f"frame {frame.number:g} is not finite"
        told = simulation.report["contact"]
        depth = told["worst_depth"]
    except SimulationError as error:
        named = error.feather and error.frame is not None and error.reason
        outcome, said = "named" if named else "broken", str(error)
    except InputError as error:
        outcome, said = "broken", str(error)
    return Case(number, count, outcome, depth, time.process_time() - start, said)
