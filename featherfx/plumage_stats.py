"""What a groom or shot holds and what its bake will cost, before any bake."""

from __future__ import annotations

import time
import tomllib
from collections import Counter
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from featherfx.api import Folders, read_groom, read_quality, read_shot
from featherfx.bake_task import all_of

if TYPE_CHECKING:
    from featherfx.groom.types import Groom
    from featherfx.shot.types import Quality, Shot

# feathers and frames that are simulated to learn what one costs
TRIED_FEATHERS, TRIED_FRAMES = 8, 4
_MOST_NAMED = 10


def plumage_stats(
    path: str | Path,
    *,
    quality: str | None = None,
    jobs: int = 1,
    preset_folders: Folders = (),
) -> dict[str, Any]:
    """Counts, overlap and penetration of a groom; of a shot also the expected cost of its bake.

    quality: preset instead of the shot's; for a groom, that its meshes are counted at (default
    final). jobs: threads of the bake. The cost is measured by simulating a few feathers of the shot
    for its first frames. SI units, bytes. Raises InputError, and SimulationError where one of
    these feathers cannot be simulated.
    """
    path, folders = Path(path), tuple(preset_folders)
    if _is_shot(path):
        shot, chosen = all_of(
            lambda: read_shot(path, folders),
            lambda: read_quality(quality, folders) if quality else None,
        )
        from dataclasses import replace

        shot = replace(shot, quality=chosen) if chosen else shot
        return _of_groom(shot.groom, shot.quality) | {"bake": _bake_cost(shot, jobs)}
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
    from featherfx.feather.layout import cover, measured
    from featherfx.feather.scaled import feather_of, repeated_shapes

    first, shapes = repeated_shapes(groom.feathers)
    report = measured(groom)
    lengths = [feather.kind.length for feather in groom.feathers]
    used = Counter(shapes)
    points = [
        len(feather_of(groom.feathers[k], quality.rows, quality.columns).surface.row) for k in first
    ]
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


def _bake_cost(shot: Shot, jobs: int) -> dict[str, Any]:
    """What the frames of a shot will take, by those of a few of its feathers."""
    from featherfx.baking import entries_of
    from featherfx.shot.share import share_of
    from featherfx.shot.simulate import simulate
    from featherfx.usd.poses import posed_feathers
    from featherfx.usd.space import StageSpace

    total = len(shot.groom.feathers)
    part = share_of(shot, 1, max(1, total // TRIED_FEATHERS))
    count = len(part.groom.feathers)
    last = min(shot.last_frame, shot.first_frame + TRIED_FRAMES)
    simulation = simulate(part, 1, (shot.first_frame, last))
    seconds = _frame_seconds(simulation)
    frames = shot.last_frame - shot.first_frame + 1
    each = median(seconds) / count if seconds else 0.0
    entries = entries_of(part.groom, simulation.feathers, static=False, skin=part.skin)
    posed = posed_feathers(entries, StageSpace())
    sample = sum(feather.bytes_per_sample for feather in posed) / count * total
    unknowns = [_unknowns(resolution) for resolution in simulation.resolutions]
    return {
        "frames": frames,
        "tried_feathers": count,
        "tried_frames": len(seconds),
        "unknowns": round(sum(unknowns) / count * total),
        "seconds_of_a_feather_and_frame": each,
        "processor_seconds": each * total * frames,
        "wall_seconds": each * total * frames / jobs,
        "jobs": jobs,
        "bytes_of_a_frame": round(sample),
        "bytes_of_the_cache": round(sample * frames),
    }


def _frame_seconds(simulation: Any) -> list[float]:
    """Processor time of every frame after the first, which settles; one may compile, too."""
    seconds, before = [], time.process_time()
    for number, _ in enumerate(simulation):
        now = time.process_time()
        if number:
            seconds.append(now - before)
        before = now
    return seconds


def _unknowns(resolution: Any) -> int:
    """Of one feather: six a row, and two directions of coefficients for its two barbs."""
    if resolution.level in ("guided", "rigid"):
        return 0
    return int(resolution.rows * (6 + 4 * resolution.coefficients))
