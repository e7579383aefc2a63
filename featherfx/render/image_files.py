"""Finished images: labels, keys, contact sheets, and files (PNG, GIF, MP4)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import Standing, write_all
from featherfx.render.colour import Bar, Legend, ramp_colours

_INK = (40, 40, 44)
_SCREEN = 16 / 9  # width over height
_EMPTY = 0.3  # what a place without a picture counts, against the logarithm of a sheet's shape


def label(picture: Picture, text: str, below: bool = False) -> Picture:
    """The picture with a text in its upper left corner, or the lower left one."""
    image, draw = _canvas(picture)
    size = _text_size(min(picture.shape[:2]))
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
        _draw_legend(draw, key, size, strip.shape[1])
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


def _draw_legend(draw: Any, key: Legend, size: int, width: int) -> None:
    places = _legend_places(key, size, width)
    for (name, colour), (x, row) in zip(key.entries, places, strict=True):
        y = (0.4 + 1.4 * row) * size
        fill = tuple(round(255 * c) for c in colour)
        draw.rectangle((x, y + 0.1 * size, x + size, y + 1.1 * size), fill=fill)
        draw.text((x + 1.4 * size, y), name, fill=_INK, font=_font(size))


def _canvas(picture: Picture) -> tuple[Any, Any]:
    image = Image.fromarray(picture)
    return image, ImageDraw.Draw(image)


def _text_size(height: int) -> int:
    return max(12, height // 22)


def _font(size: float) -> Any:
    return ImageFont.load_default(size)


Picture = NDArray[np.uint8]


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
    # one palette for all, else colours flicker
    middle = Image.fromarray(pictures[len(pictures) // 2])
    palette = middle.quantize(256, dither=Image.Dither.NONE)
    images = [Image.fromarray(each).quantize(palette=palette) for each in pictures]
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
