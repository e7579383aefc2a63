"""Pictures of a cache: one frame, several frames, or a contact sheet."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import InputError, Problem
from featherfx.files.whole import write_all

_MOST_PIXELS = 8192


def render(
    path: str | Path,
    output: str | Path,
    frames: Sequence[float] | None = None,
    size: tuple[int, int] | None = None,
    colour: str = "shaded",
    sheet: bool = False,
    view: str = "auto",
) -> list[Path]:
    """Draw frames of a USD file to PNG and return the files written.

    frames: time codes; None: the first frame, or for a sheet up to nine spread over the range.
    size: (width, height) in pixels of one frame, 1280 x 720 or 480 x 320 on a sheet. colour:
    "shaded", "barb" (barb angle), "region" or "strain" (across the barbs). view: "auto" (three
    quarters onto the broad side), "top", "side" or "front". Several frames without sheet give
    files OUTPUT.0001.png and so on. One camera frames all chosen frames. Raises InputError with
    every problem: missing libraries, unknown options, a frame out of range, an unreadable file.
    """
    path, output = Path(path), Path(output)
    size = size or ((480, 320) if sheet else (1280, 720))
    _check(path, output, size, colour, view)
    from featherfx.render.annotate import add_key, label
    from featherfx.render.annotate import sheet as contact_sheet
    from featherfx.render.camera import choose_camera
    from featherfx.render.colour import face_colours
    from featherfx.render.scene import load_pose, load_scene
    from featherfx.render.trace import Tracer
    from featherfx.usd.read.read import Cache

    cache = Cache(path)
    times = _times(path, cache, frames, sheet)
    scene = load_scene(cache)
    poses = [load_pose(cache, scene.triangles, time) for time in times]
    camera = choose_camera(scene, poses, view, cache.up_axis, size)
    colours, key = face_colours(scene, poses, colour)
    tracer = Tracer(scene, camera, size)
    pictures = [
        tracer.picture(pose, base, stripes=colour in ("shaded", "region"))
        for pose, base in zip(poses, colours, strict=True)
    ]
    if sheet:
        labelled = [label(p, _name(t)) for p, t in zip(pictures, times, strict=True)]
        return [_save(add_key(contact_sheet(labelled), key), output)]
    if len(times) == 1:
        return [_save(add_key(pictures[0], key), output)]
    return [
        _save(add_key(picture, key), output.with_suffix(f".{_number(time)}{output.suffix}"))
        for picture, time in zip(pictures, times, strict=True)
    ]


def _check(path: Path, output: Path, size: tuple[int, int], colour: str, view: str) -> None:
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
    if not all(16 <= side <= _MOST_PIXELS for side in size):
        message = f"{size[0]} x {size[1]}; allowed 16 to {_MOST_PIXELS} pixels a side"
        problems.append(Problem("preview", "size", message))
    if output.suffix.lower() != ".png":
        problems.append(Problem(str(output), "", f"suffix '{output.suffix}' is not .png"))
    if not os.path.isdir(output.parent):
        problems.append(Problem(str(output.parent), "", "folder does not exist"))
    if not path.is_file():
        problems.append(Problem(str(path), "", "file does not exist"))
    if problems:
        raise InputError(*problems)


def _times(
    path: Path, cache: Any, frames: Sequence[float] | None, sheet: bool
) -> list[float | None]:
    """The time codes to draw; None stands for the rest pose of a file without time."""
    first, last = cache.frames
    if not cache.has_frames:
        if frames:
            raise InputError(
                Problem(str(path), "frame", "the file has no frames, only a rest pose")
            )
        return [None]
    if frames is None:
        if not sheet:
            return [first]
        whole = np.arange(first, last + 1)
        chosen = np.unique(np.round(np.linspace(0, len(whole) - 1, min(9, len(whole)))).astype(int))
        return [float(code) for code in whole[chosen]]
    if not len(frames):
        raise InputError(Problem(str(path), "frame", "no frame was chosen"))
    outside = [code for code in frames if not first <= code <= last]
    if outside:
        raise InputError(
            *(
                Problem(
                    str(path), "frame", f"{code:g} is out of range; allowed {first:g} to {last:g}"
                )
                for code in outside
            )
        )
    return [float(code) for code in frames]


def _name(time: float | None) -> str:
    return "rest" if time is None else f"frame {time:g}"


def _number(time: float | None) -> str:
    if time is None:
        return "rest"
    return f"{int(time):04d}" if time == int(time) else f"{time:08.3f}"


def _save(picture: Any, output: Path) -> Path:
    """Write a PNG in one piece."""
    from PIL import Image

    def store(path: Path) -> None:
        Image.fromarray(picture).save(path, format="PNG", optimize=True)

    try:
        write_all([(output, store)])
    except OSError as error:
        message = f"cannot be written: {error.strerror}"
        raise InputError(Problem(str(output), "", message)) from error
    return output


COLOURS = ("shaded", "barb", "region", "strain")
VIEWS = ("auto", "top", "side", "front")
