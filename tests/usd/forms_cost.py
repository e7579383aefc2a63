"""Bytes and processor time per feather and frame of each form of a cache, as a table.

Run as a program: folder, feathers, frames. Feathers of the swan's wing bend, each by itself; they
share one mesh. The first run compiles. Seconds are those of the writer, files on disk included; of
rigid feathers, which turn, those of the export of a cache that is there.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from featherfx.api import read_groom
from featherfx.baking.entries import entries_of
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.render import barb_curves
from featherfx.feather.types import both
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.convert.rigid import export_rigid
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

GROOM = Path(__file__).resolve().parents[2] / "samples/swan_wing/groom.toml"
BARBS = 100
FORMS = [
    ("mesh", "full", (11, 4)),
    ("mesh", "half", (11, 4)),
    ("mesh", "none", (11, 4)),
    ("both", "full", (11, 4)),
    ("curves", "full", (11, 4)),
    ("condensed", "full", (11, 4)),
    ("condensed", "none", (11, 4)),
    ("condensed", "none", (21, 6)),
]


def entries(count: int, grid: tuple[int, int], barbs: int) -> list[FeatherEntry]:
    groom = read_groom(GROOM)
    some = groom.feathers[0]
    (built,) = build_feathers([some], *grid)
    curves = barb_curves(some.kind, grid, barbs, some.mirrored) if barbs else None
    (made,) = entries_of(type(groom)(**{**vars(groom), "feathers": (some,)}), [built], static=False)
    return [FeatherEntry(**{**vars(made), "id": f"f{k}", "barbs": curves}) for k in range(count)]


def frame(number: int, given: list[FeatherEntry]) -> Frame:
    rest, poses = given[0].rest_points, []
    for k in range(len(given)):
        wave = 0.01 * np.sin(0.3 * number + k + 20.0 * rest.nodes[..., :1]) * [0.0, 0.0, 1.0]
        points = rest._replace(nodes=rest.nodes + wave)
        rates = both(lambda part, k=k: np.cos(part + k), points)
        poses.append(FeatherPose(points, rates, rates))
    return Frame(number, number / 24.0, tuple(poses))


def measured(folder: Path, count: int, frames: int, form: str, rates: str, grid) -> str:
    given = entries(count, grid, BARBS if form == "curves" else 0)
    path, spent = folder / "form.usdc", 0.0
    options = WriteOptions(form=form, velocities=rates, group="all", layout="clips", overwrite=True)
    begin = time.process_time()
    with CacheWriter(path.with_suffix(".usda"), given, (1, frames), 24.0, options) as writer:
        spent += time.process_time() - begin
        for number in range(1, frames + 1):
            made = frame(number, given)
            begin = time.process_time()
            writer.write(made)
            spent += time.process_time() - begin
        begin = time.process_time()
    spent += time.process_time() - begin
    clips = sum(each.stat().st_size for each in folder.rglob("[0-9]*.usdc"))
    constant = path.with_suffix(".payload.usdc").stat().st_size
    return (
        f"| {form} | {rates} | {grid[0]} x {grid[1]} | {clips / count / frames:.0f} |"
        f" {constant / count:.0f} | {1e6 * spent / count / frames:.0f} |"
    )


def turned(number: int, given: list[FeatherEntry]) -> Frame:
    """Feathers that turn about their roots, each by itself."""
    rest, poses = given[0].rest_points, []
    for k in range(len(given)):
        angle = 0.3 * np.sin(0.3 * number + k)
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        points = both(lambda part, turn=turn: part @ turn.T, rest)
        poses.append(FeatherPose(points, rest, rest))
    return Frame(number, number / 24.0, tuple(poses))


def rigid(folder: Path, count: int, frames: int) -> str:
    """The row of feathers that are transforms: of `frames` and of two frames, and their export."""
    sizes, spent = [], 0.0
    for last in (2, frames):
        given, path = entries(count, (11, 4), 0), folder / "whole.usdc"
        options = WriteOptions(group="all", layout="flat", overwrite=True)
        with CacheWriter(path, given, (1, last), 24.0, options) as writer:
            for number in range(1, last + 1):
                writer.write(turned(number, given))
        begin = time.process_time()
        assert export_rigid(path, folder / "rigid.usdc", 0.1, overwrite=True) == count
        spent = time.process_time() - begin
        sizes.append((folder / "rigid.usdc").stat().st_size)
    each = (sizes[1] - sizes[0]) / (frames - 2)
    return (
        f"| rigid | none | 11 x 4 | {each / count:.0f} | {(sizes[0] - 2 * each) / count:.0f} |"
        f" {1e6 * spent / count / frames:.0f} |"
    )


def main(folder: Path, count: int, frames: int) -> None:
    print("| form | velocities | rows x columns | bytes a sample | constant bytes | microseconds |")
    print("|---|---|---|---|---|---|")
    for each in FORMS:
        print(measured(folder, count, frames, *each), flush=True)
    print(rigid(folder, count, frames), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
