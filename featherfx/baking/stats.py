"""What a groom or shot holds and what its bake will cost, before any bake."""

from __future__ import annotations

import time
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

from featherfx.api import Folders, read_groom, read_quality, read_shot
from featherfx.baking.cost import Spent, bake_cost
from featherfx.baking.options import TRIAL_SECONDS
from featherfx.errors import all_of
from featherfx.feather.build import repeated_shapes
from featherfx.feather.layout.layout import cover, measured
from featherfx.feather.shapes import feathers_of
from featherfx.groom.types import Groom
from featherfx.phases import account
from featherfx.shot.types import Quality

_MOST_NAMED = 10


def plumage_stats(
    path: str | Path,
    *,
    quality: str | None = None,
    jobs: int = 1,
    preset_folders: Folders = (),
    budget: float = TRIAL_SECONDS,
) -> dict[str, Any]:
    """Counts, overlap and penetration of a groom; of a shot also the expected cost of its bake.

    quality: preset instead of the shot's; for a groom, that its meshes are counted at (default
    final). jobs: threads of the bake. Its cost is measured by bakes of a few feathers of the shot,
    which take about budget seconds. SI units, bytes. Raises InputError, and SimulationError where
    one of these feathers cannot be simulated.
    """
    path, folders = Path(path), tuple(preset_folders)
    if _is_shot(path):
        begin, worked = time.perf_counter(), time.process_time()
        shot, chosen = all_of(
            lambda: read_shot(path, folders),
            lambda: read_quality(quality, folders) if quality else None,
        )
        shot = replace(shot, quality=chosen) if chosen else shot
        current = account()
        # a layout that was found here is kept for the bake
        read = Spent(time.perf_counter() - begin, time.process_time() - worked)
        if current is not None:
            own = current.processor_seconds()
            done = sum(own.get(name, 0.0) for name in ("starting", "reading"))
            read = Spent(current.spent("starting", "reading"), done)
        cost = bake_cost(shot, jobs, read, budget)
        return _of_groom(shot.groom, shot.quality) | {"bake": cost}
    groom, grid = all_of(
        lambda: read_groom(path, folders), lambda: read_quality(quality or "final", folders)
    )
    return _of_groom(groom, grid)


def _is_shot(path: Path) -> bool:
    if path.suffix != ".toml":
        return False
    try:
        return "groom" in tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return False  # the reader of grooms tells what is wrong with it


def _of_groom(groom: Groom, quality: Quality) -> dict[str, Any]:
    first, shapes = repeated_shapes(groom.feathers)
    report = measured(groom)
    lengths = [feather.kind.length for feather in groom.feathers]
    used = Counter(shapes)
    built = feathers_of([groom.feathers[k] for k in first], quality.rows, quality.columns)
    points = [len(feather.surface.row) for feather in built]
    return {
        "name": groom.name,
        "feathers": len(groom.feathers),
        "regions": dict(Counter(feather.region for feather in groom.feathers)),
        "kinds": dict(Counter(feather.kind.name for feather in groom.feathers)),
        "shapes": len(first),
        "most_of_one_shape": max(used.values()),
        "length": {"least": min(lengths), "greatest": max(lengths)},
        "quality": quality.name,
        "mesh_points": sum(points[shape] for shape in shapes),
        "mesh_points_of_shapes": sum(points),
        "overlap": {
            "pairs": len(report.pairs),
            "neighbours_of_each": 2.0 * len(report.pairs) / len(groom.feathers),
            "feathers_over_a_point": cover(groom),
        },
        "penetration": {
            "pairs": len(report.unresolved),
            "deepest": report.unresolved[0].depth if report.unresolved else 0.0,
            "worst": [
                {"feather": each.upper, "under": each.lower or "skin", "depth": each.depth}
                for each in report.unresolved[:_MOST_NAMED]
            ],
        },
    }
