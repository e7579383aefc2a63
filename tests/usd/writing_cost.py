"""Writes a large cache and the same bytes raw; prints seconds, bytes and peak memory as JSON.

Run as a program, so that the peak memory is its own: folder, feathers, frames, layout.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np

from featherfx.api import read_groom
from featherfx.feather.build import build_feather
from featherfx.shot.types import Frame
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write import CacheWriter

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
ROWS, COLUMNS = 71, 22


def entries(count: int) -> list[FeatherEntry]:
    """Feathers of about 3,000 points each."""
    kind = read_groom(SAMPLES / "feather_pull/groom.toml").feathers[0].kind
    feather = build_feather(kind, ROWS, COLUMNS)
    return [FeatherEntry(f"f{k}", "k", "r", feather, feather.points) for k in range(count)]


def frame(number: int, rest: np.ndarray, count: int) -> Frame:
    """All feathers bend, each by itself; every coordinate of every frame is another number."""
    bend = 0.1 * np.sin(0.1 * number + 0.7137 * np.arange(count))
    points, velocities = [], []
    for angle in bend:
        bent = rest.copy()
        bent[..., 2] += angle * np.sin(9.0 * rest[..., 0] + 7.0 * rest[..., 1] + angle)
        points.append(bent)
        velocities.append(angle * np.cos(5.0 * bent))
    return Frame(number, number / 24.0, tuple(points), tuple(velocities))


def seconds_raw(folder: Path, sizes: list[int], chunk: np.ndarray) -> float:
    """Time to write as many bytes to as many files, each forced to disk."""
    spent = 0.0
    for k, size in enumerate(sizes):
        begin = time.perf_counter()
        with (folder / f"raw{k}").open("wb") as file:
            chunk[: size // 4].tofile(file)
            file.flush()
            os.fsync(file.fileno())
        spent += time.perf_counter() - begin
        (folder / f"raw{k}").unlink()
    return spent


def main(folder: Path, count: int, frames: int, layout: str) -> None:
    feathers = entries(count)
    rest = feathers[0].rest_points
    poses, posing = frame(0, rest, count), 0.0
    with CacheWriter(folder / "warm.usdc", feathers[:1], (1, 1)) as writer:
        writer.write(Frame(1, 0.0, poses.points[:1], poses.velocities[:1]))
    begin = time.perf_counter()
    with CacheWriter(folder / "large.usdc", feathers, (1, frames), layout=layout) as writer:
        for number in range(1, frames + 1):
            start = time.perf_counter()
            poses = frame(number, rest, count)
            posing += time.perf_counter() - start
            writer.write(poses)
    spent = time.perf_counter() - begin - posing
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    sizes = [file.stat().st_size for file in folder.rglob("*.usdc")]
    noise = np.random.default_rng(1).random(max(sizes) // 4 + 1, dtype=np.float32)
    raw = seconds_raw(folder, sizes, noise)
    points = len(feathers[0].feather.surface.row)
    figures = {"seconds": spent, "raw": raw, "bytes": sum(sizes), "peak": peak, "points": points}
    print(json.dumps(figures))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
