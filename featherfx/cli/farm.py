"""`featherfx bake --engine dask`: many shots as one job."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from featherfx.cli.log import tell
from featherfx.cli.options import default_jobs
from featherfx.cli.progress import Progress


class _Lines(logging.Handler):
    """What a job says of shots, shares and workers, beside its bar."""

    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self._progress = progress

    def emit(self, record: logging.LogRecord) -> None:
        warning = "warning: " if record.levelno >= logging.WARNING else ""
        self._progress.say(f"featherfx: {warning}{record.getMessage()}")


def bake_many(
    shots: Sequence[Path], style: str, options: dict[str, Any], farm: dict[str, Any]
) -> None:
    """Bake shots as one job and say what came of it."""
    # an extra, which takes its time to load
    from featherfx.farm.bake_many import bake_many as bake

    if options["jobs"] is None:
        local = default_jobs() // (farm["workers"] or default_jobs())
        options["jobs"] = 1 if farm["scheduler"] else max(local, 1)
    output = options.pop("output") or Path(".")
    log = logging.getLogger("featherfx.farm")
    with Progress("frames", style) as progress:
        lines = _Lines(progress)
        log.addHandler(lines)
        log.setLevel(logging.INFO)
        try:
            result = bake(shots, output, on_frame=progress, **farm, **options)
        finally:
            log.removeHandler(lines)
    for each in result["shots"]:
        told = f"{each['feathers']} feathers, {each['frames']} frames"
        tell(f"{each['output']}: {told}")
    tell(f"{result['workers']} workers, {result['wall_seconds']:.1f} s")
