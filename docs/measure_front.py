"""Prints the tables of presets and of the front in docs/benchmarks.md.

python docs/measure_front.py [--scenes]

The shaken swan primary of the benchmarks: error beside the reference of `featherfx bench`, and
processor time, of every setting once, and of those near the front five times more, the least. With
--scenes: of the presets, and of numbers for all feathers alike, in scenes of other kinds, of which
every feather is there eight times, so that what a shot costs by itself counts as little as in
larger ones.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from math import exp, inf, log

from featherfx.groom.presets.library import plain
from featherfx.groom.presets.presets import load_preset
from featherfx.lab.bench import front as scenes
from featherfx.lab.bench.experiments import FULL, QUALITIES, preset_shake
from featherfx.lab.bench.scenes import scene
from featherfx.lab.bench.shake import Shake, ShakeRun, barb_curvature, swan_primary
from featherfx.lab.bench.shake import trajectory_error as error_of
from featherfx.shot.groups import NEWTON_FRACTION
from featherfx.shot.types import Quality, Shot

GRIDS = tuple(product((4, 5, 6, 8, 11), (2, 3, 4), (0, 1)))
TOLERANCES = (4e-3, 2.5e-3, 1e-3, 7e-4, 3.5e-4, 1.5e-4)
FINER = ((11, 6, 2), (15, 10, 2))
FINER_TOLERANCES = (3.5e-5, 2e-5)
RADII = (0.0, 0.5, 0.8)
# of the time of the front, what is measured again; runs
NEAR, AGAIN = 1.3, 5

SCENES = ("shake in vacuum", "flap", "gust", "pull", "soft plume")
COPIES, ROUNDS = 8, 1
NUMBERS = {"error": None, "tolerance": 1e-3}
CHANGES: tuple[tuple[str, dict[str, float | None]], ...] = (
    ("draft", {}),
    ("preview", {}),
    ("final", {}),
    ("draft", NUMBERS),
    ("draft", NUMBERS | {"simulated_columns": 2, "tolerance": 3.5e-4}),
    ("preview", NUMBERS | {"coefficients": 1, "simulated_rows": 15, "simulated_columns": 4}),
    ("preview", NUMBERS | {"tolerance": 1.5e-4}),
    ("preview", NUMBERS | {"tolerance": 1.5e-4, "simulated_rows": 15, "simulated_columns": 4}),
    ("final", NUMBERS | {"tolerance": 2e-5}),
)

Timed = tuple[Shake, ShakeRun, float]


def settings() -> list[Shake]:
    coarse = product(GRIDS, TOLERANCES, RADII)
    fine = product(FINER, FINER_TOLERANCES, RADII)
    return [
        Shake(*grid, step=0.0, tolerance=t, radius=r, newton=NEWTON_FRACTION * t, max_substeps=4096)
        for grid, t, r in (*coarse, *fine)
    ]


def front(timed: list[Timed], near: float = 1.0) -> list[Timed]:
    """What nothing is better than at near times less time, by error."""
    found, least = [], float("inf")
    for each in sorted(timed, key=lambda one: one[2]):
        if each[1].seconds <= near * least:
            found.append(each)
        least = min(least, each[1].seconds)
    return found


def main() -> None:
    kind = swan_primary()
    reference = barb_curvature(kind, FULL.reference)

    def run(shake: Shake) -> Timed:
        found = barb_curvature(kind, shake)
        return shake, found, error_of(found, reference, kind.length)

    def best(shake: Shake) -> Timed:
        return min((run(shake) for _ in range(AGAIN)), key=lambda one: one[1].seconds)

    timed = [best(shake) for shake, _, _ in front([run(each) for each in settings()], NEAR)]
    for each in front(timed):
        show("front", each)
    for name in QUALITIES:
        show(name, best(preset_shake(kind, name)))


def show(name: str, timed: Timed) -> None:
    shake, found, error = timed
    grid = f"{shake.rows}, {shake.columns}, {shake.coefficients}"
    cost = 1e3 * found.seconds / shake.duration
    print(
        f"| {name} | {grid} | {shake.tolerance:g} | {shake.radius:g} | {error:.3g} | {cost:.3g} "
        f"| {found.steps} | {found.step_iterations:.2f} |",
        flush=True,
    )


def many(shot: Shot) -> Shot:
    """A shot of which every feather, and grip, is there several times in the same place."""

    def named(name: str, k: int) -> str:
        return f"{name}_{k}" if k else name

    copies, grips = range(COPIES), shot.grips
    feathers = [replace(p, id=named(p.id, k)) for k in copies for p in shot.groom.feathers]
    return replace(
        shot,
        groom=replace(shot.groom, feathers=tuple(feathers)),
        grips=tuple(replace(g, feather=named(g.feather, k)) for k in copies for g in grips),
        twins="none",
    )


def compare() -> None:
    finest = {name: scenes.run(scenes.at(scene(name), scenes.FINEST)) for name in SCENES}
    least: dict[tuple[int, str], float] = {}
    errors: dict[tuple[int, str], list[float]] = {}
    for _, (k, (base, change)), name in product(range(ROUNDS), enumerate(CHANGES), SCENES):
        values = plain(load_preset(f"quality/{base}")[1]) | change
        shot = many(scene(name))
        found = scenes.run(replace(shot, quality=Quality(name=base, **values)))
        cost = 1e3 * found.seconds / len(shot.groom.feathers)
        least[k, name] = min(cost, least.get((k, name), inf))
        first = {f: found.feathers[f] for f in finest[name].feathers}
        own = scenes.errors(found._replace(feathers=first), finest[name])
        errors[k, name] = [100.0 * each for each in own]
    for k, (base, change) in enumerate(CHANGES):
        of_scenes = [f"{max(errors[k, n]):.2f}, {least[k, n]:.0f} ms" for n in SCENES]
        every = [each for n in SCENES for each in errors[k, n]]
        middle = exp(sum(log(each) for each in every) / len(every))
        cost = sum(least[k, n] for n in SCENES) / len(SCENES)
        print(f"| {base} {change or ''} | {' | '.join(of_scenes)} | {middle:.2f}, {cost:.0f} ms |")


if __name__ == "__main__":
    if sys.argv[1:] == ["--scenes"]:
        compare()
    else:
        main()
