"""Pictures of a cache: one frame, several frames, or a contact sheet."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path

from featherfx.errors import InputError, Problem
from featherfx.limits import MOST_PIXELS, MOST_SIDE

COLOURS = ("shaded", "barb", "region", "strain")
VIEWS = ("auto", "top", "side", "front")
SHEET_FRAMES = 9  # of a sheet, where nothing else is said


def render(
    path: str | Path,
    output: str | Path,
    frames: Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    colour: str = "shaded",
    sheet: bool = False,
    view: str = "auto",
    overwrite: bool = False,
) -> list[Path]:
    """Draw frames of a USD file to PNG and return the files written.

    frames: time codes; None: the first frame, or for a sheet up to nine spread over the range.
    size: (width, height) in pixels of one frame, 1280 x 720 or 480 x 320 on a sheet. colour:
    "shaded", "barb" (barb angle), "region" or "strain" (across the barbs). view: "auto" (three
    quarters onto the broad side), "top", "side" or "front". Several frames without sheet give
    files OUTPUT.0001.png and so on; all appear, or none. overwrite: whether files that exist are
    replaced. One camera frames all chosen frames. Raises InputError with every problem: missing
    libraries, unknown options, a frame out of range, an unreadable file, an output that exists.
    """
    path, output = Path(path), Path(output)
    size = size or ((480, 320) if sheet else (1280, 720))
    count = len(frames) if frames is not None else SHEET_FRAMES if sheet else 1
    _check(path, output, size, count, colour, view)
    # what it imports is checked
    from featherfx.render.draw import draw

    return draw(path, output, frames, size, colour, sheet, view, overwrite)


def _check(
    path: Path, output: Path, size: tuple[int, int], count: int, colour: str, view: str
) -> None:
    problems = [
        Problem("preview", "", f'{name} is not installed; pip install "featherfx[preview]"')
        for module, name in (("embreex", "Embree"), ("PIL", "Pillow"))
        if importlib.util.find_spec(module) is None
    ]
    for key, value, allowed in (("colour", colour, COLOURS), ("view", view, VIEWS)):
        if value not in allowed:
            problems.append(
                Problem("preview", key, f"'{value}' is not one of {', '.join(allowed)}")
            )
    if not all(16 <= side <= MOST_SIDE for side in size):
        message = f"{size[0]} x {size[1]}; allowed 16 to {MOST_SIDE} pixels a side"
        problems.append(Problem("preview", "size", message))
    elif count * size[0] * size[1] > MOST_PIXELS:
        pixels = f"{count * size[0] * size[1] / 1e6:.4g} million pixels"
        most = f"allowed {MOST_PIXELS / 1e6:g} million; draw fewer frames at a time"
        problems.append(Problem("preview", "size", f"{count} pictures of {pixels} in all, {most}"))
    if output.suffix.lower() != ".png":
        problems.append(Problem(str(output), "", f"suffix '{output.suffix}' is not .png"))
    if not os.path.isdir(output.parent):
        problems.append(Problem(str(output.parent), "", "folder does not exist"))
    if not path.is_file():
        problems.append(Problem(str(path), "", "file does not exist"))
    if problems:
        raise InputError(*problems)
