"""Work against error of whole birds: each quality beside a fine reference, each in its own process.

    error    of every feather the largest distance of any point of its mesh, at any frame, from
             where the reference has it, over the feather's length; told are 99 % of the feathers

The reference is the quality `final` at half of its error, and a quarter of its tolerance where
feathers touch. All write meshes of one grid, so that their points can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import featherfx
from featherfx.algebra.types import Indices
from featherfx.errors import InputError, Problem
from featherfx.groom.keys.preset import Quality
from featherfx.groom.presets.presets import read_quality
from featherfx.lab.bench.report import ResultTable, Row
from featherfx.lab.measure.plumage import write_swan
from featherfx.shot.patterns import part_of
from featherfx.shot.types import Shot

_SAMPLES = Path(featherfx.__file__).parent.parent / "samples"
_GRID = {"render_rows": 9, "render_columns": 2}
# finer than `final` by
_FINER_ERROR, _FINER_CONTACT = 2.0, 4.0
_SWAN = "swan layered"
# names of scenes: shots below the samples, None: made here
SCENES = {
    "pigeon in contact": "pigeon/contact.toml",
    _SWAN: None,
    "owl in flight": "owl_flight/shot.toml",
}
_NOTE = """\
Each line bakes a bird in a process of its own, kernels compiled before. `error` is the percent of
their length within which 99 % of the feathers are of a reference, at all of their points and
frames. Of scenes that are cut short only feathers around the longest are baked.
"""


@dataclass(frozen=True)
class BirdExtent:
    """Extent of a run. frames: of each scene. feathers: of each, around one place; None: all.
    qualities: names of presets, or errors in percent. swan: feathers of the swan."""

    frames: int
    feathers: int | None
    qualities: Sequence[str | float]
    swan: int


QUICK_BIRDS = BirdExtent(4, 40, ("draft", "preview"), 600)
FULL_BIRDS = BirdExtent(24, None, ("draft", "preview", "final", 2.0, 1.0), 25_000)


def measure_birds(extent: BirdExtent, progress: Callable[[int, int], None]) -> list[Row]:
    """Bake each scene at each quality and at the reference; return a row for each.

    Raises InputError where the samples are not there.
    """
    for shot in filter(None, SCENES.values()):
        if not (_SAMPLES / shot).is_file():
            told = "is missing. Run it in a checkout, which holds the samples"
            raise InputError(Problem(str(_SAMPLES / shot), "", told))
    rows: list[Row] = []
    total = len(SCENES) * len(extent.qualities)
    for scene in SCENES:
        for row in _measure_scene(scene, extent):
            rows.append(row)
            progress(len(rows), total)
    return rows


def birds_table(extent: BirdExtent, progress: Callable[[int, int], None]) -> ResultTable:
    """The rows of measure_birds as a table."""
    return ResultTable("birds", "Birds", _NOTE, measure_birds(extent, progress))


def _measure_scene(scene: str, extent: BirdExtent) -> Iterator[Row]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        _alone(_bake_scene, scene, replace(extent, frames=1), "draft", folder / "warm.usdc")
        reference = folder / "reference.usdc"
        _alone(_bake_scene, scene, extent, None, reference)
        for number, quality in enumerate(extent.qualities):
            cache = folder / f"{number}.usdc"
            report = _alone(_bake_scene, scene, extent, quality, cache)
            yield {
                "scene": scene,
                "quality": quality if isinstance(quality, str) else f"{quality:g} %",
                "error": _alone(_error, cache, reference),
                "cpu_seconds": report["processor_seconds"],
                "wall_seconds": report["wall_seconds"],
                "peak_memory_bytes": report["peak_memory_bytes"],
            }


def _alone(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a process of its own, whose memory and time are its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def _bake_scene(
    scene: str, extent: BirdExtent, quality: str | float | None, output: Path
) -> dict[str, Any]:
    """Bake a scene at a quality, an error in percent, or finely; return the report."""
    shot = _open_scene(scene, extent)
    options: dict[str, Any] = {"jobs": 1, **_GRID}
    if quality is None:
        shot = replace(shot, quality=_reference_quality())
    elif isinstance(quality, str):
        options["quality"] = quality
    else:
        options["error"] = quality
    report = featherfx.bake(shot, output, **options).report
    assert report is not None
    return report


def _reference_quality() -> Quality:
    final = read_quality("final")
    assert final.error is not None
    assert final.contact_tolerance is not None
    return replace(
        final,
        error=final.error / _FINER_ERROR,
        contact_tolerance=final.contact_tolerance / _FINER_CONTACT,
    )


def _open_scene(scene: str, extent: BirdExtent) -> Shot:
    """Read a scene, and cut it to the extent."""
    file = SCENES[scene]
    with TemporaryDirectory() as folder:
        path = write_swan(Path(folder), extent.swan, extent.frames) if file is None else None
        shot = featherfx.read_shot(path or _SAMPLES / str(file))
        last = min(shot.last_frame, shot.first_frame + extent.frames - 1)
        shot = replace(shot, last_frame=last)
        return shot if extent.feathers is None else part_of(shot, _around(shot, extent.feathers))


def _around(shot: Shot, count: int) -> Indices:
    """Numbers of the feathers whose roots are nearest to that of the longest, in order.

    That one is simulated in every scene.
    """
    roots = np.array([each.position for each in shot.groom.feathers])
    longest = int(np.argmax([each.kind.length for each in shot.groom.feathers]))
    away = np.linalg.norm(roots - roots[longest], axis=1)
    return np.sort(np.argsort(away, kind="stable")[:count])


def _error(cache: Path, reference: Path) -> float:
    """Return percent of their length within which 99 % of the feathers are of the reference."""
    one, other = featherfx.open_cache(cache), featherfx.open_cache(reference)
    first, last = other.frames
    worst = []
    for name, exact in other.items():
        own, length = one[name], np.ptp(exact.points(), axis=0).max()
        off = [
            np.linalg.norm(own.points(frame) - exact.points(frame), axis=1).max()
            for frame in range(first, last + 1)
        ]
        worst.append(max(off) / length)
    return 100.0 * float(np.quantile(worst, 0.99))
