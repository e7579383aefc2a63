"""Bakes for programs: a shot in, an open cache out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from featherfx.baking import bake as baking
from featherfx.baking.options import BakeOptions, takes
from featherfx.errors import require_type
from featherfx.phases import Progress, listener_of
from featherfx.shot.types import Shot

if TYPE_CHECKING:
    from featherfx.usd.read.feather_cache import FeatherCache


@takes(BakeOptions)
def bake(
    shot: str | Path | Shot,
    output: str | Path | None = None,
    *,
    progress: Progress = False,
    **options: Any,
) -> FeatherCache:
    """Simulate a shot, write it to USD and open what was written.

    shot: its file, or a shot in memory. output: .usd, .usdc or .usda; None: the shot's name with
    .usdc, in the current folder. progress: True for lines on stderr, or a function that takes the
    samples that are done and their number. options: fields of
    featherfx.baking.options.BakeOptions; all that `featherfx bake` has. The result has the report.

    The cache appears complete or not at all; an interrupt ends the bake cleanly, and `resume=True`
    goes on after it. Raises InputError with every problem of shot, groom, presets and outputs
    before any work, SimulationError where a feather cannot be advanced.
    """
    from featherfx.usd.read.feather_cache import FeatherCache

    require_type("shot", shot, str | Path | Shot, "a Shot, or the path of a shot file")
    require_type("output", output, str | Path | None, "the path of a file")
    report = baking.bake(shot, output, on_frame=listener_of(progress, "frames"), **options)
    return FeatherCache(report["output"], report)
