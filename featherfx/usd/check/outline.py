"""Holes in the outline of a plumage, and how far its points move from frame to frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.raster import nodes_within
from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem
from featherfx.usd.check.crossings import chosen_frames, scenes_of
from featherfx.usd.read.read import Cache

VIEWS = {"top": (0, 1), "side": (0, 2), "front": (1, 2)}  # axes of a picture, z up
_Y_UP = (0, 2, 1)  # where x forward, y left and z up stand in a stage whose y is up
_PIXEL = 1e-4  # m
_MOST_PIXELS = 6000  # along the longer side of an outline


def measure_holes(
    path: str | Path,
    view: str,
    frames: tuple[int, int] | None = None,
    *,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[dict[str, Any]]:
    """Holes in the outline of all that a file draws, its skin too, seen from far off.

    A hole is enclosed; gaps that open to the outside, as between the tips of primaries, are none.
    view: of VIEWS. Of each frame: `holes` wider than a pixel, the `widest` (m), the largest circle
    that fits into any, and `place` (2,) m of its middle in the picture. Widths are exact to a
    `pixel` (m). Raises InputError as count_crossings does.
    """
    cache = Cache(path)
    scenes = scenes_of(cache, Path(path))
    chosen = [k if cache.up_axis == "Z" else _Y_UP[k] for k in VIEWS[view]]
    codes = chosen_frames(cache, str(path), frames)
    on_frame(0, len(codes))
    for done, code in enumerate(codes, 1):
        corners = [
            points[scene.cache.feathers[index].triangles][:, :, chosen]
            for scene in scenes
            for index, points in zip(scene.chosen, scene.points(code), strict=True)
        ]
        found = _holes(np.concatenate(corners))
        on_frame(done, len(codes))
        yield {"frame": code, **found}


def _holes(corners: Array) -> dict[str, Any]:
    """corners: (T, 3, 2) m."""
    from scipy import ndimage  # heavy, and only for this

    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    pixel = max(_PIXEL, float((high - low).max()) / _MOST_PIXELS)
    rows, columns = (np.ceil((high - low) / pixel).astype(int) + 3).tolist()
    covered = np.zeros((rows, columns), dtype=np.bool_)
    for found in nodes_within((corners - low) / pixel + 1.0, (rows, columns)):
        covered[found.i, found.j] = True
    parts, count = ndimage.label(~covered)
    # from the nearest covered node, as far as the middle between it and the one before
    depth = np.where(parts == parts[0, 0], 0.0, ndimage.distance_transform_edt(~covered))
    at = np.array(np.unravel_index(depth.argmax(), depth.shape))
    widest = pixel * max(2.0 * float(depth.max()) - 1.0, 0.0)
    place = (low + pixel * (at - 1.0)).tolist()
    wide = int((ndimage.maximum(depth, parts, np.arange(1, count + 1)) > 1.0).sum())
    return {"holes": wide, "widest": widest, "place": place, "pixel": pixel}


def measure_moves(
    path: str | Path,
    frames: tuple[int, int] | None = None,
    *,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[dict[str, Any]]:
    """How far points of feathers move from each whole frame to the next.

    Of each frame but the first: `largest`, in lengths of its feather from the first point of its
    mesh to the farthest at rest, `feather`, whose that is, and `middle`, the median over feathers
    of the largest of each. Raises InputError for files without two frames, or without feathers.
    """
    cache = Cache(path)
    chosen = [k for k, feather in enumerate(cache.feathers) if feather.is_feather]
    codes = chosen_frames(cache, str(path), frames)
    if not chosen or len(codes) < 2 or codes[0] is None:
        raise InputError(Problem(str(path), "", "holds no feathers that move over two frames"))
    rest = cache.points_of(chosen, codes[0])
    sizes = np.array([np.linalg.norm(each - each[:1], axis=1).max() for each in rest])
    first = np.cumsum([0, *(len(each) for each in rest[:-1])])
    before = np.concatenate(rest)
    on_frame(1, len(codes))
    for done, code in enumerate(codes[1:], 2):
        points = np.concatenate(cache.points_of(chosen, code))
        ways = np.linalg.norm(points - before, axis=1)
        fractions = np.maximum.reduceat(ways, first) / np.maximum(sizes, 1e-12)
        worst = int(fractions.argmax())
        before = points
        on_frame(done, len(codes))
        yield {
            "frame": code,
            "largest": float(fractions[worst]),
            "feather": cache.feathers[chosen[worst]].id,
            "middle": float(np.median(fractions)),
        }
