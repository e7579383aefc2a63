"""Frames of a cache, drawn and saved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from featherfx.errors import InputError, Problem, require
from featherfx.files.atomic_write import standing
from featherfx.phases import ReportDone, phase
from featherfx.render.camera import (
    Eye,
    axes_of,
    carried,
    fit_camera_path,
    framing,
    still_path,
    tile_size,
    travels,
    turntable,
    whole,
)
from featherfx.render.colour import Bar, Legend
from featherfx.render.image_files import Picture, add_key, beside, contact_sheet, label, save
from featherfx.render.options import SHEET_FRAMES, PictureOptions, check_pixels
from featherfx.render.subject import Subject, open_subject
from featherfx.render.tracer import ROWS_AT_ONCE, Tracer
from featherfx.usd.read.scenes import find_camera
from featherfx.usd.write.output import find_file_problems


@dataclass(frozen=True)
class Exposure:
    """One picture to draw. time: code, None for the rest pose. name: of its label. number: of its
    file. floor: m, height of a floor, None for none."""

    time: float | None
    eye: Eye
    name: str
    number: str
    floor: float | None = None


def draw(path: Path, output: Path, options: PictureOptions, jobs: int) -> list[Path]:
    """As featherfx.render.picture.render, of arguments that are right."""
    with phase("reading"):
        subjects = [open_subject(path, options)]
        if options.against is not None:
            subjects.append(open_subject(Path(options.against), options))
        times = _times(path, subjects[0], options, output)
        shots = _shots(path, subjects, times, options)
        if options.floor:
            shots = _on_floor(shots, subjects)
        files = _files(output, shots, options)
        problems = find_file_problems(files, options.overwrite) + check_pixels(len(shots), options)
        require(*problems)
        before = {file: standing(file) for file in files}
        every = [shot.time for shot in shots]
        keys = [subject.colour(shots[0].eye, every, options.colour) for subject in subjects]
    pictures = _pictures(subjects, shots, options, jobs)
    finished = list(_finished(pictures, subjects, shots, options, keys[0]))
    with phase("finishing"):
        save(finished, before, subjects[0].cache.frames_per_second)
    return files


def _finished(
    pictures: Iterator[list[Picture]],
    subjects: Sequence[Subject],
    shots: Sequence[Exposure],
    options: PictureOptions,
    key: Bar | Legend | None,
) -> Iterator[Picture]:
    """Pictures with labels and key, as they go to files."""
    tiles = []
    for shot, sides in zip(shots, pictures, strict=True):
        if len(sides) > 1:
            sides = [
                label(side, subject.name) for side, subject in zip(sides, subjects, strict=True)
            ]
        picture = beside(sides)
        if options.sheet:
            tiles.append(label(picture, shot.name, below=len(sides) > 1))
        else:
            yield add_key(picture, key)
    if tiles:
        yield add_key(contact_sheet(tiles), key)


def _pictures(
    subjects: Sequence[Subject], shots: Sequence[Exposure], options: PictureOptions, jobs: int
) -> Iterator[list[Picture]]:
    """The pictures of every shot, one of each subject; the next is prepared while one is drawn."""
    work = [(subject, shot) for shot in shots for subject in subjects]
    strips = len(range(0, shots[0].eye.size[1], ROWS_AT_ONCE))

    def prepared(subject: Subject, shot: Exposure) -> Tracer:
        geometry = subject.geometry(shot.time)
        return Tracer(geometry, shot.eye, options.samples, not options.is_look, shot.floor)

    drawers, preparer = ThreadPoolExecutor(jobs), ThreadPoolExecutor(1)
    try:
        with phase("drawing", len(work) * strips) as done:
            following: Future[Tracer] = preparer.submit(prepared, *work[0])
            sides: list[Picture] = []
            for index in range(len(work)):
                tracer = following.result()
                if index + 1 < len(work):
                    following = preparer.submit(prepared, *work[index + 1])
                first = index * strips
                sides.append(_drawn(tracer, drawers, lambda k, first=first: done(first + k)))
                if len(sides) == len(subjects):
                    yield sides
                    sides = []
    finally:
        drawers.shutdown(cancel_futures=True)
        preparer.shutdown(cancel_futures=True)


def _drawn(tracer: Tracer, drawers: ThreadPoolExecutor, done: ReportDone) -> Picture:
    """One picture, by threads that share its rows; done: called with the strips that are."""
    lens = tracer.lens
    picture = np.zeros((lens.rows, lens.columns, 3), np.uint8)
    tops = range(0, lens.rows, ROWS_AT_ONCE)
    traced = [drawers.submit(tracer.trace, top) for top in tops]
    for number, strip in enumerate(as_completed(traced), 1):
        strip.result()
        done(number)
    for top, rows in zip(tops, drawers.map(tracer.rows, tops), strict=True):
        picture[top : top + ROWS_AT_ONCE] = rows
    return picture


def _shots(
    path: Path, subjects: Sequence[Subject], times: Sequence[float | None], options: PictureOptions
) -> list[Exposure]:
    """List the images to draw, with their cameras."""
    named = [(time, _name(time), _number(time)) for time in times]
    if options.camera is not None:
        seen = find_camera(path, options.camera, subjects[0].cache)
        eyes = [whole(seen(time), options.pixels) for time in times]
        return [
            Exposure(time, eye, name, number)
            for (time, name, number), eye in zip(named, eyes, strict=True)
        ]
    kept = times if options.framed == "drawn" else None
    reaches = [subject.reach(kept) if kept else subject.whole_reach for subject in subjects]
    reach = [each for found in reaches for each in found]
    way = fit_camera_path(reach)
    if options.framing not in (None, "follow") or not (options.framing or travels(way, reach)):
        way = still_path()
    points = np.concatenate([hull - way(code) for code, hull in reach])
    heading = subjects[0].cache.heading
    right, up = axes_of(options.view, *subjects[0].shape(kept), options.floor, heading)
    is_shaped = options.sheet and options.size is None
    pixels = tile_size(right, up, points) if is_shaped else options.pixels
    if options.turntable:
        count = options.turntable
        angles = [2 * math.pi * k / count for k in range(count)]
        eyes = turntable(right, up, points, pixels, angles)
        named = [named[k * len(named) // count] for k in range(count)]
        turns = [(f"{360 * k / count:g} degrees", f"{k + 1:04d}") for k in range(count)]
        named = [(time, *turn) for (time, _, _), turn in zip(named, turns, strict=True)]
    else:
        eyes = [framing(right, up, points, pixels)] * len(named)
    if options.f_stop:
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        eyes = [eye.focused(options.f_stop, middle) for eye in eyes]
    return [
        Exposure(time, carried(eye, way(time)), name, number)
        for (time, name, number), eye in zip(named, eyes, strict=True)
    ]


def _on_floor(shots: Sequence[Exposure], subjects: Sequence[Subject]) -> list[Exposure]:
    """With a floor as high as the lowest point of all frames, where they are seen from above it."""
    hulls = [hull for subject in subjects for _, hull in subject.whole_reach]
    height = min(float(hull[:, 2].min()) for hull in hulls)
    return [
        replace(shot, floor=height) if shot.eye.view.eye[2] > height else shot for shot in shots
    ]


def _files(output: Path, shots: Sequence[Exposure], options: PictureOptions) -> list[Path]:
    if len(shots) == 1 or options.sheet or output.suffix.lower() != ".png":
        return [output]
    return [output.with_suffix(f".{shot.number}{output.suffix}") for shot in shots]


def _times(
    path: Path, subject: Subject, options: PictureOptions, output: Path
) -> list[float | None]:
    """The time codes to draw; None stands for the rest pose of a file without time."""
    cache, frames = subject.cache, options.frames
    first, last = cache.frames
    if not cache.has_frames:
        if frames:
            message = "the file has no frames, only a rest pose. Leave out --frame and --frames"
            raise InputError(Problem(str(path), "frame", message))
        return [None]
    if frames is None:
        if options.sheet and not options.turntable:
            steps = int(last - first)
            chosen = np.unique(np.round(np.linspace(0, steps, min(SHEET_FRAMES, steps + 1))))
            return [float(first + step) for step in chosen]
        if output.suffix.lower() != ".png" and not options.turntable:
            return list(cache.whole_frames())
        return [first]
    if not len(frames):
        raise InputError(Problem(str(path), "frame", "no frame was chosen. Give a frame"))
    problems = [
        Problem(str(path), "frame", f"{code:g} is out of range. Give {first:g} to {last:g}")
        for code in frames
        if not first <= code <= last
    ]
    require(*problems)
    return [float(code) for code in frames]


def _name(time: float | None) -> str:
    return "rest" if time is None else f"frame {time:g}"


def _number(time: float | None) -> str:
    if time is None:
        return "rest"
    return f"{int(time):04d}" if time == int(time) else f"{time:08.3f}"
