"""Frames of a cache, drawn and saved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from featherfx.errors import InputError, Problem
from featherfx.files.whole import Standing, standing, write_all
from featherfx.render.annotate import add_key, contact_sheet, label
from featherfx.render.camera import choose_camera
from featherfx.render.colour import face_colours
from featherfx.render.picture import SHEET_FRAMES
from featherfx.render.scene import load_pose, load_scene
from featherfx.render.trace import Tracer
from featherfx.usd.read.read import Cache
from featherfx.usd.write.output import file_problems


def draw(
    path: Path,
    output: Path,
    frames: Sequence[float] | None,
    size: tuple[int, int],
    colour: str,
    sheet: bool,
    view: str,
    overwrite: bool,
) -> list[Path]:
    """As featherfx.render.picture.render, of arguments that are right."""
    cache = Cache(path)
    times = _times(path, cache, frames, sheet)
    files = [output]
    if len(times) > 1 and not sheet:
        files = [output.with_suffix(f".{_number(time)}{output.suffix}") for time in times]
    problems = file_problems(files, overwrite)
    if problems:
        raise InputError(*problems)
    before = {file: standing(file) for file in files}
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
        pictures = [contact_sheet(labelled)]
    _save([add_key(picture, key) for picture in pictures], before)
    return files


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
        steps = int(last - first)
        chosen = np.unique(np.round(np.linspace(0, steps, min(SHEET_FRAMES, steps + 1))))
        return [float(first + step) for step in chosen]
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


def _save(pictures: Sequence[Any], before: Mapping[Path, Standing]) -> None:
    """Write PNG files, all or none. before: what stood at each when the work began."""

    def store(path: Path, picture: Any) -> None:
        Image.fromarray(picture).save(path, format="PNG", optimize=True)

    each = zip(before, pictures, strict=True)
    try:
        write_all(((file, partial(store, picture=picture)) for file, picture in each), before)
    except OSError as error:
        message = f"cannot be written: {error.strerror}"
        raise InputError(Problem(str(error.filename), "", message)) from error
