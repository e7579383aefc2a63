"""Prints what levels by a camera save on the pigeon, and the largest way that a change adds.

python docs/measure_levels.py [EVERY]     every n-th feather, default 8

A camera has the whole bird in view and backs away until its feathers are ten pixels long; 96
frames, then the same with 480 frames in which the bird holds still after its walk. "Added" is what
the passage from one level to the next adds to the way of a point within a frame, as a share of the
feather's length; asked for is less than 0.5 %.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.api import read_shot
from featherfx.errors import InputWarning
from featherfx.lab.bench.skips import backing_away, share_of
from featherfx.shot.detail.changes import Fades
from featherfx.shot.simulate import simulate

SHOT = Path(__file__).parents[1] / "samples/pigeon/full.toml"


class Watch:
    """Largest share of its length that any passage moved a point by, and passages begun."""

    def __init__(self) -> None:
        self.added, self.begun = 0.0, 0
        grow, begin = Fades.grow, Fades.begin

        def watched(fades, feathers, poses):
            grow(fades, feathers, poses)
            for f in feathers:
                first, second = (
                    poses[f, int(at)].points.nodes for at in (fades.now[f], fades.to[f])
                )
                apart = np.linalg.norm(second - first, axis=2).max()
                self.added = max(self.added, fades.grown[f] * apart / fades._lengths[f])

        def counted(fades, index):
            found = begin(fades, index)
            self.begun += len(found)
            return found

        Fades.grow, Fades.begin = watched, counted


def spent(shot) -> float:
    begin = time.process_time()
    for _ in simulate(shot):
        pass
    return time.process_time() - begin


def main() -> None:
    warnings.simplefilter("ignore", InputWarning)
    every = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    shot = share_of(read_shot(SHOT), 1, every)
    print("| frames | seconds without | with | saved | changes | added, % of the length |")
    print("|---|---|---|---|---|---|")
    for last in (96, 480):
        long = replace(shot, last_frame=last)
        without = spent(long)
        watch = Watch()
        with_levels = spent(backing_away(long))
        saved = 100.0 * (1.0 - with_levels / without)
        print(
            f"| {last} | {without:.1f} | {with_levels:.1f} | {saved:.0f} % | {watch.begun} |"
            f" {100.0 * watch.added:.3f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
