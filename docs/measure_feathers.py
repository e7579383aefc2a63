"""Prints the table of time against the number of feathers in docs/plumage.md.

python docs/measure_feathers.py [COUNT ...]     default 20 to 5,000

Contour feathers of one density on a growing patch of a skin, in a light wind; quality draft. Times
are processor times of the whole process, one thread simulating: other work on the machine disturbs
them through shared caches only, and of two rounds the least is taken. "Each" is the time of a frame
after the first over the number of feathers, and "simulated" the part of it that is spent before
anything is written, of a simulation of its own.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
import warnings
from pathlib import Path

from measure_plumage import write_skin

from featherfx.api import read_shot
from featherfx.baking.bake import bake
from featherfx.errors import InputWarning
from featherfx.shot.simulate import simulate

COUNTS = (20, 50, 100, 200, 500, 1000, 2000, 5000)
DENSITY = 25_000.0  # 1/m^2
FRAMES = 5
ROUNDS = 2

GROOM = """
name = "patch"
[skin]
usd = "skin.usdc"
prim = "/egg"
[layout]
[[region]]
id = "patch"
kind = "body_contour"
count = {count}
length = 0.035
follow = 1
variants = 8
where = [{{ sphere = [0, 0, 0.2, {radius}] }}]
flow = {{ direction = [-1, 0, 0] }}
variation = {{ length = 0.05, curl = 2, turn = 4, roll = 2 }}
"""

SHOT = f"""
name = "patch"
groom = "groom.toml"
frames = [1, {FRAMES}]
quality = "draft"
motion = {{ base = "shake", amplitude = 0.01 }}
wind = {{ base = "breeze", direction = [-1, 0.2, 0] }}
[[shelter]]
share = 0.7
"""


def measured(home: Path, count: int) -> dict[str, float]:
    """Processor seconds of the parts of one bake."""
    radius = math.sqrt(count / (math.pi * DENSITY))
    (home / "groom.toml").write_text(GROOM.format(count=count, radius=radius))
    (home / "shot.toml").write_text(SHOT)
    begin = time.process_time()
    feathers = len(read_shot(home / "shot.toml").groom.feathers)
    groom = time.process_time() - begin
    marks: list[float] = []
    begin = time.process_time()
    bake(
        home / "shot.toml",
        home / "out.usdc",
        overwrite=True,
        on_frame=lambda done, total: marks.append(time.process_time()),
    )
    end = time.process_time()
    frames = iter(simulate(read_shot(home / "shot.toml")))
    next(frames)
    simulated = time.process_time()
    for _ in frames:
        pass
    simulated = (time.process_time() - simulated) / (FRAMES - 1)
    # the first mark is made before anything is simulated
    frame = (marks[-1] - marks[1]) / (FRAMES - 1)
    return {
        "feathers": feathers,
        "groom": groom,
        "first": marks[1] - marks[0],
        "frame": frame,
        "each": 1e3 * frame / feathers,
        "simulated": 1e3 * simulated / feathers,
        "bake": end - begin,
    }


def main() -> None:
    warnings.simplefilter("ignore", InputWarning)
    counts = [int(each) for each in sys.argv[1:]] or list(COUNTS)
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        write_skin(home / "skin.usdc")
        measured(home, 20)  # compiles
        print(
            "| feathers | groom, s | first frame, s | a frame, s | each, ms |"
            " simulated, ms | bake, s |"
        )
        print("|---|---|---|---|---|---|---|")
        rounds = [[measured(home, count) for count in counts] for _ in range(ROUNDS)]
        for tries in zip(*rounds, strict=True):
            row = {name: min(each[name] for each in tries) for name in tries[0]}
            print(
                f"| {row['feathers']:.0f} | {row['groom']:.2f} | {row['first']:.2f} |"
                f" {row['frame']:.3f} | {row['each']:.2f} | {row['simulated']:.2f} |"
                f" {row['bake']:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
