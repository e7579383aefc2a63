"""Frames of a cache, drawn, labelled and saved: sheets, sequences and films (PNG, GIF, MP4)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from featherfx.errors import InputError, Problem, require
from featherfx.files.atomic_write import Standing, standing, write_all
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
from featherfx.render.options import SHEET_FRAMES, PictureOptions, check_pixels
from featherfx.render.subject import Bar, Legend, Subject, open_subject, ramp_colours
from featherfx.render.tracer import ROWS_AT_ONCE, Tracer
from featherfx.usd.read.scenes import find_camera
from featherfx.usd.write.output import find_file_problems

_INK = (40, 40, 44)
_SCREEN = 16 / 9  # width over height
_EMPTY = 0.3  # what a place without a picture counts, against the logarithm of a sheet's shape


def label(picture: Picture, text: str, below: bool = False) -> Picture:
    """The picture with a text in its upper left corner, or the lower left one."""
    image, draw = _canvas(picture)
    size = max(12, min(picture.shape[:2]) // 22)
    top = picture.shape[0] - 1.9 * size if below else 0.7 * size
    draw.text((size, top), text, fill=_INK, font=_font(size))
    return np.asarray(image)


def beside(pictures: Sequence[Picture]) -> Picture:
    """Pictures of one height in a row."""
    gap = np.full((pictures[0].shape[0], 2, 3), 255, np.uint8)
    row = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(row[1:], axis=1)


def contact_sheet(pictures: Sequence[Picture]) -> Picture:
    """Pictures of one size side by side in rows, as many as fill a sheet of the shape of a
    screen."""
    height, width = pictures[0].shape[:2]
    count = len(pictures)

    def unlike(columns: int) -> float:
        rows = math.ceil(count / columns)
        shape = abs(math.log(columns * width / (rows * height) / _SCREEN))
        return shape + _EMPTY * (rows * columns - count)

    columns = min(range(1, count + 1), key=unlike)
    rows = math.ceil(count / columns)
    gap = 2
    whole = np.full((rows * (height + gap) - gap, columns * (width + gap) - gap, 3), 255, np.uint8)
    for index, picture in enumerate(pictures):
        top, left = (index // columns) * (height + gap), (index % columns) * (width + gap)
        whole[top : top + height, left : left + width] = picture
    return whole


def add_key(picture: Picture, key: Bar | Legend | None) -> Picture:
    """The picture with a strip below it that explains the colours."""
    if key is None:
        return picture
    size = max(13, min(22, picture.shape[1] // 50))
    rows = (
        3.4
        if isinstance(key, Bar)
        else 2.0 + 1.4 * _legend_places(key, size, picture.shape[1])[-1][1]
    )
    strip = np.full((int(rows * size), picture.shape[1], 3), 250, np.uint8)
    image, draw = _canvas(strip)
    if isinstance(key, Bar):
        _draw_bar(image, draw, key, size)
    else:
        places = _legend_places(key, size, strip.shape[1])
        for (name, colour), (x, row) in zip(key.entries, places, strict=True):
            y = (0.4 + 1.4 * row) * size
            fill = tuple(round(255 * c) for c in colour)
            draw.rectangle((x, y + 0.1 * size, x + size, y + 1.1 * size), fill=fill)
            draw.text((x + 1.4 * size, y), name, fill=_INK, font=_font(size))
    return np.concatenate([picture, np.asarray(image)])


def _draw_bar(image: Any, draw: Any, key: Bar, size: int) -> None:
    width = image.width
    length, left = int(0.5 * width), int(0.25 * width)
    ramp = np.round(255 * ramp_colours(key.ramp, np.linspace(0, 1, length))).astype(np.uint8)
    bar = np.repeat(ramp[None], int(0.8 * size), axis=0)
    image.paste(Image.fromarray(bar), (left, int(1.6 * size)))
    font = _font(size)
    middle = 0.5 * (key.low + key.high)
    draw.text((left + length / 2, 0.25 * size), key.title, fill=_INK, font=font, anchor="ma")
    at = 1.55 * size
    digits = max(0, 2 - math.floor(math.log10(key.high - key.low)))
    low, high = (f"{value:.{digits}f}" for value in (key.low, key.high))
    draw.text((left - 0.4 * size, at), low, fill=_INK, font=font, anchor="ra")
    draw.text((left + length + 0.4 * size, at), high, fill=_INK, font=font, anchor="la")
    draw.text(
        (left + length / 2, 2.4 * size), f"{middle:.{digits}f}", fill=_INK, font=_font(0.8 * size),
        anchor="ma",
    )  # fmt: skip


def _legend_places(key: Legend, size: int, width: int) -> list[tuple[float, int]]:
    """Left edge and row of each entry, wrapped to the width."""
    font, x, row = _font(size), float(size), 0
    places = []
    for name, _ in key.entries:
        needed = 2.8 * size + font.getlength(name)
        if x + needed > width and x > size:
            x, row = float(size), row + 1
        places.append((x, row))
        x += needed
    return places


def _canvas(picture: Picture) -> tuple[Any, Any]:
    image = Image.fromarray(picture)
    return image, ImageDraw.Draw(image)


def _font(size: float) -> Any:
    return ImageFont.load_default(size)


Picture = NDArray[np.uint8]
# ordered dither of films with a palette, of 255: the 4 x 4 matrix of Bayer (1973)
_DITHER = (np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) - 7.5) * 0.4


def save(pictures: Sequence[Picture], before: Mapping[Path, Standing], rate: float) -> None:
    """Write files, all or none.

    before: what stood at each when the work began; one of them, unless it is as many PNG files as
    there are pictures. rate: pictures a second of a film. Raises InputError where the system
    refuses.
    """
    files = list(before)
    suffix = files[0].suffix.lower()
    if suffix == ".png":
        each = [(f, partial(_png, picture=p)) for f, p in zip(files, pictures, strict=True)]
    else:
        film = partial(_gif if suffix == ".gif" else _mp4, pictures=pictures, rate=rate)
        each = [(files[0], film)]
    try:
        write_all(each, before)
    except OSError as error:
        message = f"cannot be written: {error.strerror or error}"
        raise InputError(Problem(str(error.filename or files[0]), "", message)) from error


def _png(path: Path, picture: Picture) -> None:
    Image.fromarray(picture).save(path, format="PNG", optimize=True)


def _gif(path: Path, pictures: Sequence[Picture], rate: float) -> None:
    # one palette and one ordered dither for all, else colours flicker and nothing stays the same;
    # each colour counts once, else the background takes most of the palette; the 256th stands for
    # what stays as it was
    some = np.concatenate([pictures[0], pictures[len(pictures) // 2], pictures[-1]])
    colours = [colour for _, colour in Image.fromarray(some).getcolors(2**24) or ()]
    palette = Image.fromarray(np.array([colours], np.uint8)).quantize(255, dither=Image.Dither.NONE)
    height, width = pictures[0].shape[:2]
    repeats = (height // 4 + 1, width // 4 + 1, 1)
    offset = np.tile(_DITHER[:, :, None], repeats)[:height, :width]
    dithered = (np.clip(each + offset, 0.0, 255.0).astype(np.uint8) for each in pictures)
    images = [
        Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE)
        for each in dithered
    ]
    # GIF counts in hundredths of a second
    lasting = max(round(100 / rate), 2) * 10
    images[0].save(
        path, format="GIF", save_all=True, append_images=images[1:], duration=lasting, loop=0
    )


def _mp4(path: Path, pictures: Sequence[Picture], rate: float) -> None:
    import imageio_ffmpeg

    # the encoder takes even sides
    height, width = (side - side % 2 for side in pictures[0].shape[:2])
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=rate, codec="libx264", quality=8,
        macro_block_size=2, output_params=["-f", "mp4"], ffmpeg_log_level="error",
    )  # fmt: skip
    writer.send(None)
    try:
        for each in pictures:
            writer.send(np.ascontiguousarray(each[:height, :width]))
    finally:
        writer.close()


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
        subjects = [open_subject(Path(each), options) for each in (path, *options.others)]
        times = _times(path, subjects[0], options, output)
        shots = _shots(path, subjects, times, options)
        if options.floor:
            # as high as the lowest point of all frames, where they are seen from above it
            hulls = [hull for subject in subjects for _, hull in subject.whole_reach]
            height = min(float(hull[:, 2].min()) for hull in hulls)
            shots = [
                replace(shot, floor=height) if shot.eye.view.eye[2] > height else shot
                for shot in shots
            ]
        files = _files(output, shots, options)
        problems = find_file_problems(files, options.overwrite) + check_pixels(len(shots), options)
        require(*problems)
        before = {file: standing(file) for file in files}
        every = [shot.time for shot in shots]
        keys = [subject.colour(shots[0].eye, every, options.colour) for subject in subjects]
    pictures = _pictures(subjects, shots, options, jobs)
    finished = list(_finished(pictures, subjects, shots, options, keys[0]))
    with phase("finishing"):
        save(finished, before, options.rate or subjects[0].cache.frames_per_second)
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
