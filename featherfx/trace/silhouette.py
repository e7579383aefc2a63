"""A feather's silhouette in a picture, laid out from base to tip.

The silhouette is what differs from the ground (or is opaque): the largest connected piece, holes
filled, beyond the border's own noise, and Otsu's threshold (1979) at most. The ground is the border
of the picture, carried on inwards as light falls off on paper, a polynomial of degree 2, and what
that misses of the ground around the feather.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

from featherfx.algebra.types import Array, Flags
from featherfx.errors import InputError, Problem

# pixels of a picture, and its longest side while it is looked at
_MAX_PIXELS = 200_000_000
_SIDE = 1600
# of the picture, what a silhouette covers at least and at most
_COVERS = (0.002, 0.9)
_SECOND = 0.2  # of the largest piece, up to which others are dirt; chosen by eye
# distance in colour that is none, and times the noise of the border that is; chosen by eye
_MIN_APART, _NOISE = 0.03, 2.0
# pixels that grain is evened out over, and half the width of what that blurs beside an edge
_GRAIN, _BLUR = 1.0, 2
# of the border's distances from the ground's fit, times the middle one that still belong to it
_OUTLYING, _FITS = 3.0, 4
# what the fit misses of the ground is evened out over shares of the picture's longer side, one
# after the other, at every fourth pixel; what counts as far from where it is known. Chosen by eye
_REACHES, _COARSER, _FAR = (0.12, 0.06, 0.03), 4, 0.01
# times as long as wide
_MIN_SLENDER = 1.5


@dataclass(frozen=True)
class Photo:
    """A picture. file: where it is. colours: (H, W, 3), 0 to 1. opaque: (H, W), or None. shrunk:
    pixels of the file in one of these."""

    file: Path
    colours: Array
    opaque: Flags | None
    shrunk: float


@dataclass(frozen=True)
class AlignedPicture:
    """The picture turned so that the feather lies along its first axis, base first.

    grey: (U, V), the surroundings filled with the nearest of the feather. mask: (U, V). origin,
    axes: (2,) and (2, 2), column and row of the picture's pixel at 0, 0 and steps along both axes;
    the second goes to the left of one who looks from base to tip.
    """

    grey: Array
    mask: Flags
    origin: Array
    axes: Array

    def in_photo(self, places: Array) -> Array:
        """(K, 2) columns and rows of the photo at (K, 2) places."""
        return np.asarray(self.origin + places @ self.axes)

    def from_photo(self, pixels: Array) -> Array:
        """(K, 2) places of (K, 2) columns and rows of the photo."""
        return np.asarray((pixels - self.origin) @ self.axes.T)


def read_photo(path: Path) -> Photo:
    """Read a picture, at most _SIDE pixels long. Raises InputError."""
    try:
        with Image.open(path) as image:
            if image.width * image.height > _MAX_PIXELS:
                told = f"has {image.width} x {image.height} pixels, at most {_MAX_PIXELS} are read"
                raise InputError(Problem(str(path), "", told))
            shrunk = max(1.0, max(image.size) / _SIDE)
            size = round(image.width / shrunk), round(image.height / shrunk)
            pixels = np.asarray(_as_rgba(image).resize(size), dtype=np.float64) / 255.0
    except FileNotFoundError:
        raise InputError(Problem(str(path), "", "there is no such file. Check the path")) from None
    except (OSError, Image.DecompressionBombError) as error:
        raise InputError(
            Problem(str(path), "", f"is no picture that can be read: {error}")
        ) from error
    alpha = pixels[..., 3]
    opaque = alpha > 0.5 if alpha.min() < 0.5 else None
    return Photo(path, pixels[..., :3], opaque, shrunk)


def _as_rgba(image: Image.Image) -> Image.Image:
    """The picture in 8 bits a channel; Pillow cuts off what is above 255 of 16 bits or floats."""
    if image.mode.startswith(("I", "F")):
        values = np.asarray(image, dtype=np.float64)
        low, high = float(values.min()), float(values.max())
        grey = 255.0 * (values - low) / max(high - low, 1e-12)
        image = Image.fromarray(np.round(grey).astype(np.uint8))
    return image.convert("RGBA")


def silhouette(photo: Photo, threshold: float | None) -> Flags:
    """(H, W) which pixels are the feather.

    threshold: distance in colour from the ground, 0 to 1; None: it is found. Raises InputError
    where nothing, or nearly all, would be, or two pieces.
    """
    found = photo.opaque
    if found is None:
        found = _apart(photo.colours, threshold)
        if threshold is None:
            found = _with_faint(found, photo.colours)
    found = ndimage.binary_fill_holes(ndimage.binary_opening(found, iterations=1))
    labels, count = ndimage.label(found)
    if count:
        sizes = np.bincount(labels.ravel())
        sizes[0] = 0
        found = labels == sizes.argmax()
        second, largest = np.sort(sizes)[-2:]  # of the ground 0
        if second > _SECOND * largest:
            message = (
                f"two pieces differ from the border, one {100.0 * second / largest:.0f} % as"
                " large as the other: where a shaft is as pale as the ground, a lower threshold"
                " joins them. Other feathers must be cut away"
            )
            raise InputError(Problem(str(photo.file), "", message))
    fraction = float(found.mean())
    if not count or not _COVERS[0] <= fraction <= _COVERS[1]:
        message = (
            f"no silhouette: {100.0 * fraction:.2g} % of the picture differ from its border."
            f" It may be {100.0 * _COVERS[0]:g} to {100.0 * _COVERS[1]:g} %. Use a plain background"
            " or give a threshold"
        )
        raise InputError(Problem(str(photo.file), "", message))
    return found


def _apart(colours: Array, threshold: float | None) -> Flags:
    """(H, W) which of the colours (H, W, 3) are farther from the ground than a threshold; None: the
    one that is found."""
    apart = np.linalg.norm(colours - _ground(colours), axis=-1) / np.sqrt(3.0)
    noise = apart[_border(apart.shape)]
    return np.asarray(apart > (_least_apart(apart, noise) if threshold is None else threshold))


def _with_faint(found: Flags, colours: Array) -> Flags:
    """With what grain hides, such as a calamus that is nearly as pale as the ground; the edge of
    what shows is not blurred."""
    faint = _apart(ndimage.gaussian_filter(colours, (_GRAIN, _GRAIN, 0.0)), None)
    found = ndimage.binary_opening(found)
    beyond = ndimage.binary_opening(faint & ~found, iterations=_BLUR)
    return np.asarray(found | beyond)


def _border(shape: tuple[int, ...]) -> Flags:
    """(H, W) which pixels are the picture's outermost."""
    border = np.ones(shape, dtype=np.bool_)
    border[1:-1, 1:-1] = False
    return border


def _ground(colours: Array) -> Array:
    """(H, W, 3) what colours (H, W, 3) were without a feather, from their border and, once that
    tells what is the feather, from all that is not."""
    even = _even_ground(colours)
    some = (slice(None, None, _COARSER),) * 2
    few = ndimage.gaussian_filter(colours - even, (0.5 * _COARSER, 0.5 * _COARSER, 0.0))[some]
    missed = np.zeros_like(few)
    for step, share in enumerate(_REACHES):
        apart = np.linalg.norm(few - missed, axis=-1) / np.sqrt(3.0)
        # first what is surely none of the ground, as the fit may be off by more than its noise
        least = _least_apart(apart, apart[_border(apart.shape)]) if step else _otsu(apart.round(6))
        reach = share * max(few.shape)
        beside = ~ndimage.binary_dilation(apart > least, iterations=max(round(0.1 * reach), 1))
        missed = missed + _spread(few - missed, beside, reach)
    rows, columns = (np.arange(count) / _COARSER for count in colours.shape[:2])
    at = np.meshgrid(rows, columns, indexing="ij")
    parts = [
        ndimage.map_coordinates(each, at, order=1, mode="nearest")
        for each in np.moveaxis(missed, -1, 0)
    ]
    return even + np.stack(parts, axis=-1)


def _spread(left: Array, beside: Flags, reach: float) -> Array:
    """(H, W, 3) what is left (H, W, 3) beside a feather, evened out over a reach in pixels and
    carried on beneath it; nothing far from what is known."""
    known = beside.astype(np.float64)
    weight = ndimage.gaussian_filter(known, reach) + _FAR
    sums = ndimage.gaussian_filter(known[..., None] * left, (reach, reach, 0.0))
    return np.asarray(sums / weight[..., None])


def _even_ground(colours: Array) -> Array:
    """(H, W, 3) a polynomial of degree 2 through the border of colours (H, W, 3).

    A quarter of the border may be something else, such as a feather that is cut: what is further
    off than three times the middle one is left out, and the rest is fitted again.
    """
    rows, columns = (np.linspace(-1.0, 1.0, count) for count in colours.shape[:2])
    y, x = np.meshgrid(rows, columns, indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * y, x**2, y**2], axis=-1)
    border = _border(x.shape)
    known, wanted = terms[border], colours[border]
    off = np.linalg.norm(wanted - np.median(wanted, axis=0), axis=-1)
    for _ in range(_FITS):
        kept = off <= max(_OUTLYING * float(np.median(off)), _MIN_APART)
        fit = np.linalg.lstsq(known[kept], wanted[kept], rcond=None)[0]
        off = np.linalg.norm(wanted - known @ fit, axis=-1)
    return np.asarray(terms @ fit)


def _least_apart(apart: Array, noise: Array) -> float:
    """Threshold of distances in colour; a pale calamus may be nearer to the ground than vanes."""
    # what is left of a plain ground is round-off
    return min(_otsu(apart.round(6)), max(_MIN_APART, _NOISE * float(np.quantile(noise, 0.995))))


def _otsu(values: Array) -> float:
    """The threshold between which and the rest the variance is greatest."""
    counts, edges = np.histogram(values, bins=256)
    middles = 0.5 * (edges[1:] + edges[:-1])
    below, sums = np.cumsum(counts), np.cumsum(counts * middles)
    above = below[-1] - below
    inside = (below > 0) & (above > 0)
    if not inside.any():
        return np.inf
    means = sums[inside] / below[inside], (sums[-1] - sums[inside]) / above[inside]
    between = below[inside] * above[inside] * (means[0] - means[1]) ** 2
    return float(middles[inside][np.argmax(between)])


def laid_out(photo: Photo, mask: Flags, turned: bool = False) -> AlignedPicture:
    """The feather along its longest axis, with its thinner end, the calamus, first.

    turned: whether its other end is the base. Raises InputError where it is about as wide as long.
    """
    rows, columns = np.nonzero(mask)
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    middle = pixels.mean(axis=0)
    _, spread, axes = np.linalg.svd(pixels - middle, full_matrices=False)
    if spread[0] < _MIN_SLENDER * spread[1]:
        message = "the silhouette is about as wide as long, expects a feather from base to tip"
        raise InputError(Problem(str(photo.file), "", message))
    along = (pixels - middle) @ axes[0]
    ends = np.quantile(along, [0.0, 1.0])
    tenth = 0.1 * (ends[1] - ends[0])
    thick = [np.count_nonzero(np.abs(along - end) < tenth) for end in ends]
    forward = axes[0] * (1.0 if (thick[0] < thick[1]) != turned else -1.0)
    # rows go down, so the left of one who looks along (c, r) is (r, -c)
    both = np.array([forward, [forward[1], -forward[0]]])
    places = (pixels - middle) @ both.T
    low = np.floor(places.min(axis=0)) - [2.0, 8.0]
    long, wide = np.ceil(places.max(axis=0) - low).astype(int)
    origin = middle + low @ both
    grid = np.moveaxis(np.indices((long + 3, wide + 9)), 0, -1) @ both + origin
    at = grid[..., 1], grid[..., 0]
    inside = ndimage.map_coordinates(mask.astype(np.float64), at, order=1) > 0.5
    grey = ndimage.map_coordinates(photo.colours.mean(axis=-1), at, order=1, mode="nearest")
    core = ndimage.binary_erosion(inside, iterations=2)
    nearest = ndimage.distance_transform_edt(~core, return_distances=False, return_indices=True)
    return AlignedPicture(grey[tuple(nearest)], inside, origin, both)
