"""Labels, keys and contact sheets, drawn on finished pictures with Pillow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from featherfx.render.colour import Bar, Legend, ramp_colours
from featherfx.render.files import Picture

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
