"""Textures: images of the colours.

A chart holds both vanes of one feather by its texture coordinates: the trailing one left of its
middle, the leading one right of it, the root below. Every feather has its own, whatever it shares
with others, so that it can be painted over. The border of a chart repeats its edge. Charts stand in
square tiles, UDIM where there are several.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Indices
from featherfx.errors import Problem
from featherfx.feather.colours import brightness, charted
from featherfx.files.atomic_write import Store
from featherfx.groom.looks import VANE_COLOUR, displayed
from featherfx.usd.types import FeatherEntry, OutputError

_MAX_TILE_SIDE = 4096  # pixels of a tile
_BORDER = 2
_TILES_ACROSS, _FIRST_TILE = (
    10,
    1001,
)  # tiles of a row, and the number of the first, as UDIM has them
_SIGNED = "featherfx"
_MAX_CHARTS = 64  # charts in memory that other feathers may have as well


@dataclass(frozen=True)
class Atlas:
    """Places of the charts. feathers: their number.

    pixels: of a chart along the feather; it is half as wide.
    """

    feathers: int
    pixels: int

    @property
    def side(self) -> int:
        """Return the pixels of a tile's side, a power of two."""
        side = 1 << (self.pixels - 1).bit_length()
        while side < _MAX_TILE_SIDE and np.prod(self._grid(side)) < self.feathers:
            side *= 2
        return side

    def _grid(self, side: int) -> tuple[int, int]:
        """Return charts across a tile, and up."""
        return side // (self.pixels // 2), side // self.pixels

    def _places(self) -> tuple[Indices, ...]:
        """Return (N,) tile, column and row of each feather."""
        across, up = self._grid(self.side)
        tile, place = np.divmod(np.arange(self.feathers), across * up)
        return tile, *np.divmod(place, across)[::-1]

    @property
    def charts(self) -> Array:
        """Return (N, 4) u, v of each chart's corner, and its size du, dv.

        Texture coordinates s, t of a feather are at u + s du, v + t dv.
        """
        tile, column, row = self._places()
        size = np.array([self.pixels // 2, self.pixels])
        corner = np.stack([column, row], axis=1) * size + _BORDER
        begin = corner / self.side + np.stack([tile % _TILES_ACROSS, tile // _TILES_ACROSS], axis=1)
        return np.hstack([begin, np.broadcast_to((size - 2 * _BORDER) / self.side, begin.shape)])

    def given_to(self, entries: Sequence[FeatherEntry]) -> tuple[FeatherEntry, ...]:
        """Return each entry with its chart."""
        charts = zip(entries, self.charts, strict=True)
        return tuple(replace(entry, chart=chart) for entry, chart in charts)

    def files(self, path: Path) -> list[Path]:
        """Return the images of a cache, in the order of their tiles."""
        last = int(self._places()[0][-1])
        return [
            path.with_name(f"{path.stem}.colour.{_FIRST_TILE + k}.png") for k in range(last + 1)
        ]

    def asset(self, path: Path) -> str:
        """Return the asset path of the images in the cache."""
        name = "<UDIM>" if len(self.files(path)) > 1 else _FIRST_TILE
        return f"./{path.stem}.colour.{name}.png"

    def stored(self, path: Path, entries: Sequence[FeatherEntry]) -> Iterator[tuple[Path, Store]]:
        """Yield the images with the function that writes each, as write_all takes them."""
        for file, image in zip(self.files(path), self._images(entries), strict=True):
            yield file, partial(_save, image)

    def _images(self, entries: Sequence[FeatherEntry]) -> Iterator[NDArray[np.uint8]]:
        tiles, columns, rows = self._places()
        width, height, side = self.pixels // 2, self.pixels, self.side
        known: dict[Any, Array] = {}
        for tile in range(int(tiles[-1]) + 1):
            image = np.empty((side, side, 3), np.uint8)
            image[...] = np.round(255.0 * displayed(np.array(VANE_COLOUR)))
            for k in np.flatnonzero(tiles == tile).tolist():
                left, low = columns[k] * width, side - (rows[k] + 1) * height
                shades = np.round(255.0 * displayed(self._chart(entries[k], known)))
                image[low : low + height, left : left + width] = shades[::-1]
            yield image

    def _chart(self, entry: FeatherEntry, known: dict[Any, Array]) -> Array:
        """Return (H, W, 3) linear colours of a feather, the root first."""
        if entry.shape is None:
            return np.array(VANE_COLOUR)[None, None]
        kind, mirrored, _ = entry.shape
        if (id(kind), mirrored) not in known:
            if len(known) >= _MAX_CHARTS:
                known.clear()
            sizes = self.pixels // 2, self.pixels
            ways = [
                np.clip((np.arange(n) + 0.5 - _BORDER) / (n - 2 * _BORDER), 0.0, 1.0) for n in sizes
            ]
            known[id(kind), mirrored] = charted(kind, entry.feather, *ways)
        return brightness(kind.colour, entry.id) * known[id(kind), mirrored]


def refuse_textures(files: Sequence[Path], overwrite: bool) -> None:
    """Raise OutputError where images cannot be written, or were painted over."""
    problems = []
    if importlib.util.find_spec("PIL") is None:
        told = 'Pillow is not installed. Run pip install "featherfx[preview]"'
        problems.append(Problem("bake", "textures", told))
    elif not overwrite:
        told = "is not as featherfx wrote it. Move it elsewhere, or --overwrite"
        problems = [Problem(str(f), "", told) for f in files if f.exists() and not _is_unchanged(f)]
    if problems:
        raise OutputError(*problems)


def _is_unchanged(file: Path) -> bool:
    """Return whether an image has the colours that it was written with."""
    from PIL import Image

    try:
        with Image.open(file) as image:
            text = getattr(image, "text", {}).get(_SIGNED)
            return bool(text == _signature(np.asarray(image)))
    except (OSError, ValueError, SyntaxError):
        return False


def _signature(image: NDArray[np.uint8]) -> str:
    return hashlib.blake2b(np.ascontiguousarray(image).tobytes(), digest_size=16).hexdigest()


def _save(image: NDArray[np.uint8], path: Path) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    told = PngInfo()
    told.add_text(_SIGNED, _signature(image))
    Image.fromarray(image).save(path, pnginfo=told)
