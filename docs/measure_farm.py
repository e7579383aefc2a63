"""How jobs on a cluster scale: a flock of four birds by one worker and by two, and the schedule of
many workers from what its shares took.

    python docs/measure_farm.py FOLDER [--frames 24] [--row 5] [--workers 1 2]

Shares are islands of feathers that touch. The job is run with each number of workers on this
machine; times of the schedule are of the processor, so that other work on the machine counts less.
For many workers, orders are given out as a job gives them: looking at a shot, its shares, the
largest first, to whoever is free, and merging when the last is there. Flocks of more birds take the
mean share for each; looking and merging go with the birds.
"""

from __future__ import annotations

import argparse
import heapq
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
BIRDS = 4


def span(
    looking: float, shares: list[float], merging: float, workers: int, shots: int = 1
) -> float:
    """s from the first order to the last, of shots that are alike."""
    free = [0.0] * workers
    for _ in range(shots):
        heapq.heapreplace(free, free[0] + looking)
    begin = max(sorted(free)[:workers])
    free, ends = [begin] * workers, [begin] * shots
    for share in sorted(shares, reverse=True):
        for shot in range(shots):
            ends[shot] = max(ends[shot], free[0] + share)
            heapq.heapreplace(free, free[0] + share)
    for end in sorted(ends):
        heapq.heapreplace(free, max(free[0], end) + merging)
    return max(free)


def measured(folder: Path, frames: int, row: int, workers: int) -> dict:
    """The report of a job, with processor seconds of its orders."""
    from farm.flock import flock

    import featherfx

    out = folder / str(workers)
    out.mkdir(parents=True, exist_ok=True)
    shot = flock(folder, BIRDS, 1.5, frames=frames, row=row)
    return featherfx.bake_many([shot], out, workers=workers, shares=BIRDS, overwrite=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--row", type=int, default=5)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    given = parser.parse_args()
    found = {n: measured(given.folder, given.frames, given.row, n) for n in given.workers}
    for workers, report in found.items():
        shot = report["shots"][0]
        own = [round(each["processor_seconds"], 2) for each in shot["shares"]]
        wall = [round(each["wall_seconds"], 2) for each in shot["shares"]]
        print(f"{workers} workers: {report['wall_seconds']:.1f} s; looking", shot["looking"])
        print("  shares, processor s", own, "wall s", wall, "merging", shot["merging"])
    shot = found[given.workers[0]]["shots"][0]
    looking = shot["looking"]["processor_seconds"]
    shares = [each["processor_seconds"] for each in shot["shares"]]
    merging = shot["merging"]["processor_seconds"]
    mean = sum(shares) / len(shares)
    print("birds shots workers speed-up")
    for birds, shots in ((BIRDS, 1), (BIRDS, 25), (100, 1), (400, 1)):
        times = birds / BIRDS
        own = shares if birds == BIRDS else [mean] * birds
        parts = looking * times, own, merging * times
        alone = span(*parts, 1, shots)
        for workers in (1, 2, 4, 10, 25, 50, 100):
            print(birds, shots, workers, round(alone / span(*parts, workers, shots), 2))


if __name__ == "__main__":
    main()
