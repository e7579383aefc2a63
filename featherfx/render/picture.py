"""Pictures of a cache: frames, contact sheets, sequences and films. Importable without USD."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from featherfx.limits import MAX_JOBS
from featherfx.render.options import PictureOptions, check_options


def render(
    path: str | Path, output: str | Path, *, jobs: int | None = None, **options: Any
) -> list[Path]:
    """Draw frames of a USD file and return the files written.

    output: .png, or .gif and .mp4 for films. Several frames without sheet give OUTPUT.0001.png and
    so on; all files appear, or none. options: fields of PictureOptions. jobs: threads, all cores by
    default; the picture does not depend on them. Raises InputError with every problem: missing
    libraries, unknown options, a frame out of range, a feather, region or camera that is not there,
    an unreadable file, an output that exists.
    """
    path, output, chosen = Path(path), Path(output), PictureOptions(**options)
    threads = jobs or min(os.cpu_count() or 1, MAX_JOBS)
    check_options(path, output, chosen)
    # what it imports is checked
    from featherfx.render.draw import draw

    return draw(path, output, chosen, threads)
