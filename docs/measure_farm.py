"""How jobs on a cluster scale: a flock of four birds by one worker and by two, and the schedule of
many workers from what its orders took.

    python docs/measure_farm.py FOLDER [--frames 96] [--chunk 8] [--row 5] [--workers 1 2]

Shares are islands of feathers that touch: one for each bird, in the 12 common steps a frame of
samples/flapping_bird, so that birds take alike. The job is run with each number of
workers on as many cores of this machine, since one worker would lay and write on a second core, and
of its time by the clock is told what baking takes, which more workers share, and what is the same
for any number of them: loading, starting and ending them, looking, merging. The first job of a shot
does not know which of its birds takes longest; the others do. Times of the schedule are of the
processor, so that other work on the machine counts less.
For many workers, orders of the run with most workers are given out as a job gives them, each to
whoever is free: looking at a shot, its shares, chunks that are merged, and what completes it. A
flock of more birds has as many shares of the mean, and looking, merging and completing take as much
more as it has birds: an upper bound, since part of each is always the same.
"""

from __future__ import annotations

import argparse
import compileall
import heapq
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
BIRDS, STEPS = 4, "steps = 12\n"


class Orders(NamedTuple):
    """s of the orders of one shot."""

    looking: float
    shares: list[float]
    pieces: list[float]
    completing: float

    def of(self, birds: int) -> Orders:
        """The orders of a flock of more birds."""
        times, mean = birds / BIRDS, sum(self.shares) / len(self.shares)
        pieces = [times * each for each in self.pieces]
        return Orders(times * self.looking, [mean] * birds, pieces, times * self.completing)


def span(orders: Orders, workers: int, shots: int) -> float:
    """s from the first order to the last, of shots that are alike."""
    free = [0.0] * workers

    def given(seconds: float, since: float) -> float:
        end = max(heapq.heappop(free), since) + seconds
        heapq.heappush(free, end)
        return end

    begin = max(given(orders.looking, 0.0) for _ in range(shots))
    ends = [begin] * shots
    for stage in (sorted(orders.shares, reverse=True), orders.pieces, [orders.completing]):
        since = list(ends)
        for seconds in stage:
            for shot in range(shots):
                ends[shot] = max(ends[shot], given(seconds, since[shot]))
    return max(ends)


def measured(folder: Path, frames: int, chunk: int, row: int, workers: int) -> dict[str, Any]:
    """The report of a job by a command of its own; its seconds have loading the program as well."""
    from farm.flock import flock

    out = folder / str(workers)
    out.mkdir(parents=True, exist_ok=True)
    shot, report = flock(folder, BIRDS, 1.5, STEPS, frames=frames, row=row), out / "report.json"
    command = f"-m featherfx bake {shot} -o {out} --report {report} --overwrite --engine dask"
    options = f"--workers {workers} --shares {BIRDS} --chunk {chunk}"
    own = sorted(os.sched_getaffinity(0))[:workers]
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
    }
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, *command.split(), *options.split()],
        check=True,
        env=environment,
        preexec_fn=lambda: os.sched_setaffinity(0, own),
    )
    seconds = time.perf_counter() - begin
    found: dict[str, Any] = json.loads(report.read_text())
    loading = {"loading": seconds - found["wall_seconds"]}
    return found | {"seconds": loading | found["seconds"]}


def orders_of(report: dict[str, Any]) -> Orders:
    """Processor s of a job's orders; birds are alike, so all shares take the mean of those that
    were not the first of their worker, which loads or compiles its kernels."""
    shot = report["shots"][0]
    merging, name = shot["merging"], "processor_seconds"
    own: dict[str, list[float]] = {}
    for each in shot["shares"]:
        own.setdefault(each["worker"], []).append(each[name])
    warm = [each for some in own.values() for each in sorted(some)[: len(some) - (len(some) > 1)]]
    shares = [sum(warm) / len(warm)] * len(shot["shares"])
    pieces = [each[name] for each in merging["pieces"]]
    return Orders(shot["looking"][name], shares, pieces, merging[name])


def told(seconds: dict[str, float]) -> str:
    """Seconds of a job by the clock, in one line."""
    parts = ", ".join(f"{name} {each:.1f}" for name, each in seconds.items())
    return f"{sum(seconds.values()):.1f} s ({parts})"


def times_as_fast(first: dict[str, float], other: dict[str, float], parts: list[str]) -> float:
    """How much faster some parts of another job were."""
    return sum(first[each] for each in parts) / sum(other[each] for each in parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=96)
    parser.add_argument("--chunk", type=int, default=8)
    parser.add_argument("--row", type=int, default=5)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    given = parser.parse_args()
    package = Path(__file__).resolve().parents[1] / "featherfx"
    compileall.compile_dir(str(package), quiet=2)  # as an installed program is
    orders, first = None, {}
    for workers in given.workers:
        report = measured(given.folder, given.frames, given.chunk, given.row, workers)
        orders = orders_of(report)
        print(f"{workers} workers: {told(report['seconds'])}; processor s", orders)
        first = first or report["seconds"]
        gains = {"job": times_as_fast(first, report["seconds"], list(first))}
        gains["baking"] = times_as_fast(first, report["seconds"], ["baking"])
        print(", ".join(f"{name} {each:.2f} times as fast" for name, each in gains.items()))
    assert orders is not None
    print("birds shots workers speed-up")
    for birds, shots in ((BIRDS, 1), (BIRDS, 25), (100, 1)):
        own = orders if birds == BIRDS else orders.of(birds)
        for workers in (1, 2, 4, 10, 25, 50, 100):
            gain = span(own, 1, shots) / span(own, workers, shots)
            print(birds, shots, workers, round(gain, 2))


if __name__ == "__main__":
    main()
