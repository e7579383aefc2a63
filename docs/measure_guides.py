"""Prints the table of guides on the pigeon in docs/detail.md.

python docs/measure_guides.py [FRAMES]     default 40

The pigeon with every feather simulated, and with its coat guided or rigid; processor times of one
thread without the first frame, and the largest distance of any point of a feather at a frame from
where it is when all are simulated, as a share of the feather's length.
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
from featherfx.shot.simulate import simulate
from featherfx.shot.types import Detail

SHOT = Path(__file__).parents[1] / "samples/pigeon/full.toml"
COAT = ("contour", "*covert")
CASES = {
    **{f"guided, one of {n} simulated": ("guided", n) for n in (4, 8, 16)},
    "rigid": ("rigid", 1),
}


def run(shot):
    """Points of all frames, directors left out, and processor seconds after the first frame."""
    simulation = iter(simulate(shot))
    frames = [next(simulation)]
    begin = time.process_time()
    frames += simulation
    spent = time.process_time() - begin
    return [[np.delete(p, (1, 2), axis=1) for p in frame.points] for frame in frames], spent


def main() -> None:
    warnings.simplefilter("ignore", InputWarning)
    shot = replace(read_shot(SHOT), last_frame=int(sys.argv[1]) if len(sys.argv) > 1 else 40)
    feathers = shot.groom.feathers
    regions = np.array([feather.region for feather in feathers])
    coat = [k for k, feather in enumerate(feathers) if feather.kind.name in COAT]
    whole, spent = run(shot)
    print(f"all {len(feathers)} simulated: {spent:.1f} s")
    print("| coat | seconds | worst | of 99 in 100 | mean | worst region |")
    print("|---|---|---|---|---|---|")
    for name, (level, every) in CASES.items():
        details = tuple(Detail(level=level, kind=kind, every=every) for kind in COAT)
        points, spent = run(replace(shot, details=details))
        errors = np.array(
            [
                [np.linalg.norm(a[k] - b[k], axis=2).max() / feathers[k].kind.length for k in coat]
                for a, b in zip(whole, points, strict=True)
            ]
        )
        worst = regions[coat[int(np.unravel_index(errors.argmax(), errors.shape)[1])]]
        cells = [100 * errors.max(), 100 * np.percentile(errors, 99), 100 * errors.mean()]
        print(
            f"| {name} | {spent:.1f} | "
            + " | ".join(f"{each:.2f} %" for each in cells)
            + f" | {worst} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
