"""Writes a large cache and the same bytes raw; prints seconds, bytes and peak memory as JSON.

Run as a program, so that the peak memory is its own: folder, feathers, frames, layout. The first
run on a machine compiles and is slow. The cache
and raw files of as many bytes are written in turns of a few frames, so that both meet the same
machine; the time to make the frames counts for neither.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np

from featherfx.api import read_groom
from featherfx.feather.build import build_feather
from featherfx.feather.types import RowPoints, both
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
ROWS, COLUMNS = 71, 22
TURN = 24  # frames of the cache between two turns of raw files


class Clock:
    """Wall and processor seconds (of all threads) spent within its blocks."""

    def __init__(self) -> None:
        self.wall = self.processor = 0.0

    def __enter__(self) -> None:
        self._begin = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        self.wall += time.perf_counter() - self._begin[0]
        self.processor += time.process_time() - self._begin[1]


def entries(count: int) -> list[FeatherEntry]:
    """Feathers of about 3,000 points each."""
    kind = read_groom(SAMPLES / "feather_pull/groom.toml").feathers[0].kind
    feather = build_feather(kind, ROWS, COLUMNS)
    return [FeatherEntry(f"f{k}", "k", "r", feather, feather.rest) for k in range(count)]


def frame(number: int, rest: RowPoints, count: int) -> Frame:
    """All feathers bend, each by itself; every coordinate of every frame is another number."""
    bend = 0.1 * np.sin(0.1 * number + 0.7137 * np.arange(count))
    poses = []
    for angle in bend:

        def bent(part: np.ndarray, angle: float = angle) -> np.ndarray:
            away = angle * np.sin(9.0 * part[..., 0] + 7.0 * part[..., 1] + angle)
            return part + away[..., None] * [0.0, 0.0, 1.0]

        points = both(bent, rest)
        rates = both(lambda part, angle=angle: angle * np.cos(5.0 * part), points)
        poses.append(FeatherPose(points, rates, rates))
    return Frame(number, number / 24.0, tuple(poses))


def write_raw(path: Path, size: int, values: np.ndarray) -> None:
    """The plainest way to have bytes on the disk, as one file."""
    with path.open("wb") as file:
        for left in range(size, 0, -values.nbytes):
            values[: left // values.itemsize].tofile(file)
        file.flush()
        os.fsync(file.fileno())
    path.unlink()


def main(folder: Path, count: int, frames: int, layout: str) -> None:
    feathers = entries(count)
    rest = feathers[0].rest_points
    values = np.sin(np.arange(60_000, dtype=np.float32))
    cache, raw, seen = Clock(), Clock(), set()

    def raw_turn() -> None:
        """As many bytes, in as many files, as the cache has grown by."""
        new = sorted(set(folder.rglob("[0-9]*.usdc")) - seen)
        seen.update(new)
        with raw:
            for file in new:
                write_raw(folder / "raw", file.stat().st_size, values)

    with cache:
        writer = CacheWriter(
            folder / "large.usdc", feathers, (1, frames), options=WriteOptions(layout=layout)
        )
    with contextlib.ExitStack() as stack:
        stack.enter_context(writer)
        for number in range(1, frames + 1):
            poses = frame(number, rest, count)
            with cache:
                writer.write(poses)
                del poses  # as a bake does, before the next is made
                if number % TURN == 0:
                    assert writer.samples_done == number
            if number % TURN == 0:
                raw_turn()
        with cache:
            stack.close()
    raw_turn()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    figures = {
        "points": len(feathers[0].feather.surface.row),
        "bytes": sum(file.stat().st_size for file in seen),
        "files": len(seen),
        "seconds": cache.wall,
        "raw": raw.wall,
        "processor_seconds": cache.processor,
        "raw_processor_seconds": raw.processor,
        "peak": peak,
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
