"""A feather preset from a picture: shaft, outlines and barb angles, and how well it fits.

The picture shows a feather lying flat. What it cannot tell (thickness, camber, materials) is that
of a base preset, and so are barb angles where no barbs show.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

from featherfx.algebra.types import Array, Flags
from featherfx.errors import InputError, Problem, require
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.files.atomic_write import into, into_text, standing, write_all
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import kind_of
from featherfx.groom.presets.library import Library
from featherfx.groom.read.toml_text import toml_of
from featherfx.groom.types import FeatherKind, VaneShape
from featherfx.trace.feather_lines import (
    LEFT,
    RIGHT,
    ShaftLine,
    barb_angles,
    calamus_of,
    drawn_shaft,
    shaft_of,
    simplified,
    straightened,
    widths,
)
from featherfx.trace.silhouette import AlignedPicture, Photo, laid_out, read_photo, silhouette
from featherfx.usd.write.output import find_file_problems

Guides = list[tuple[float, float, float]]

# shares of the length: what an outline may be simplified by, and a shaft be off an arc
_SIMPLER, _ARC = 0.0015, 0.003
# vanes begin with barbs that grow to the outline over one of these fractions: the best is taken
_BASES = (0.0, 0.05, 0.1, 0.2)
_ROWS, _COLUMNS = 101, 16
# times that outlines are moved by what is left between the feather and its silhouette
_ROUNDS = 2
# shares of the length: a fit that is good, and by how much one with simpler guides must be better
_GOOD, _WORTH = 0.01, 0.005
# hairs and notches narrower than this share of the length are no silhouette
_HAIR = 0.006


@dataclass(frozen=True)
class TraceOptions:
    """Options of a trace.

    base: feather preset for what the picture cannot tell. length: m, None: the base's. threshold:
    of the silhouette, None: found. turned: whether the thicker end is the base. shaft: columns and
    rows of the picture from base to tip; empty: found. leading: "left" or "right" of one who looks
    from base to tip; None: the narrower vane.
    """

    base: str = "primary"
    length: float | None = None
    threshold: float | None = None
    turned: bool = False
    shaft: Sequence[tuple[float, float]] = ()
    leading: str | None = None


@dataclass(frozen=True)
class Traced:
    """A feather out of a picture. text: the preset as TOML. deviation: percent of the length, the
    greatest distance of its outline from the silhouette's. seen: guides read from the picture, on
    the leading and the trailing vane."""

    text: str
    deviation: float
    seen: tuple[int, int]


class _Try(NamedTuple):
    """A preset and how far its feather is off the silhouette, in lengths."""

    off: float
    rounded: float
    text: str
    feather: Feather


class _Outlines:
    """Measured outlines of both vanes, leading first. edges: fractions and widths, widened by what
    the feather that was built lacks. straight: whether guides follow a line."""

    def __init__(self, laid: AlignedPicture, line: ShaftLine, leading: str | None) -> None:
        self.laid, self.line = laid, line
        fractions, left = widths(laid, line, LEFT)
        _, right = widths(laid, line, RIGHT)
        self.calamus, self.bare = calamus_of(fractions, left, right)
        is_left = left.sum() <= right.sum() if leading is None else leading == "left"
        self.first = LEFT if is_left else RIGHT
        self.heading, self.sweep, self.course = _turnings(line, self.first)
        self.fractions, self.wanted = fractions, (left, right) if is_left else (right, left)
        self.edges = [each.copy() for each in self.wanted]
        self.straight = False
        self.guides: list[Guides] = [
            barb_angles(laid, line, side, (self.calamus, self.bare), (fractions, width))
            for side, width in zip((self.first, -self.first), self.wanted, strict=True)
        ]

    def simpler_guides(self) -> bool:
        """Take angles that follow a line for those that were seen, then, called again, none, so
        that they are the base's; False where there are none any more."""
        seen, self.guides = self.guides, [[], []]
        if not self.straight:
            self.straight = True
            self.guides = [straightened(each) if len(each) > 1 else [] for each in seen]
        return any(seen)

    def outline(self, k: int) -> list[tuple[float, float]]:
        """Points of a vane's outline as a preset has them."""
        fractions, width = self.fractions, self.edges[k]
        last = np.flatnonzero(self.wanted[k] > 0.0)[-1]
        chosen = (fractions >= self.calamus) & (np.arange(len(fractions)) <= last)
        along = (fractions[chosen] - self.calamus) / (1.0 - self.calamus)
        points = np.stack([along, width[chosen]], axis=1)
        points[0, 1] = 0.0
        if width[last] < 0.004:
            points[-1, 1] = 0.0
        return [(float(x), float(y)) for x, y in simplified(points, _SIMPLER)]

    def table(self, base: FeatherKind, length: float, rounded_base: float) -> dict[str, Any]:
        """The preset without its base."""
        vanes = [
            {
                "outline": self.outline(k),
                "guides": _guides(self.guides[k], own.guides),
                "rounded_base": rounded_base,
            }
            for k, own in enumerate((base.leading, base.trailing))
        ]
        thick = 2.0 * self.bare * length
        rachis = {
            "sweep": self.sweep,
            **({"course": self.course} if self.course else {}),
            "diameter_base": thick,
            "diameter_tip": min(base.rachis.diameter_tip, thick),
        }
        return {
            "length": length,
            "calamus": self.calamus,
            "rachis": rachis,
            "leading": vanes[0],
            "trailing": vanes[1],
        }


def _turnings(line: ShaftLine, first: float) -> tuple[float, float, list[list[float]]]:
    """Heading at the base (rad, to the left), sweep and course (degrees) of a line; an arc that
    fits has no course."""
    fractions = np.linspace(0.0, 1.0, len(line.heading))
    rate, begin = np.polyfit(fractions, line.heading, 1)
    # to the trailing side
    sweep = -first * float(np.degrees(rate))
    if _apart(line, begin + rate * fractions) < _ARC:
        return float(begin), sweep, []
    places = np.linspace(0.0, 1.0, 13)
    smooth = ndimage.uniform_filter1d(line.heading, len(fractions) // 30, mode="nearest")
    turned = -first * np.degrees(np.interp(places, fractions, smooth - smooth[0]))
    rest = turned - sweep * places
    course = [[float(s), 0.0, float(r), 0.0] for s, r in zip(places, rest, strict=True)]
    return float(smooth[0]), sweep, course


def _apart(line: ShaftLine, heading: Array) -> float:
    """Return the deviation of a line of other headings, in lengths."""
    steps = np.exp(1j * heading) - np.exp(1j * line.heading)
    return float(np.abs(np.cumsum(steps)).max()) / len(steps)


def _guides(seen: Guides, own: Sequence[Any]) -> list[dict[str, float]]:
    """Guides as seen, with the camber of the base's; those of the base where too few are."""
    if len(seen) < 2:
        return [dict(vars(each)) for each in own]
    places = [each.position for each in own]
    camber = np.interp([p for p, *_ in seen], places, [each.camber for each in own])
    return [
        {"position": p, "angle": a, "curl": c, "camber": float(b)}
        for (p, a, c), b in zip(seen, camber, strict=True)
    ]


def trace(photo_path: str | Path, options: TraceOptions = TraceOptions()) -> tuple[Traced, Any]:
    """The preset of the feather in a picture, and the picture with it drawn over.

    Raises InputError: no picture, no silhouette, no shaft that shows, an outline that no barbs
    fill, and a base that is not there.
    """
    base = kind_of_text(f'base = "{options.base}"\n')
    photo = read_photo(Path(photo_path))
    mask = silhouette(photo, options.threshold)
    laid = laid_out(photo, mask, options.turned)
    source = str(photo_path)
    points = [(x / photo.shrunk, y / photo.shrunk) for x, y in options.shaft]
    line = drawn_shaft(laid, points, source) if points else shaft_of(laid, source)
    length = options.length or base.length
    found = _Outlines(laid, line, options.leading)

    def built(rounded: float) -> _Try:
        text = _text(found.table(base, length, rounded), options.base, Path(photo_path).name)
        try:
            feather = build_feather(flattened(kind_of_text(text)), _ROWS, _COLUMNS)
        except InputError as error:
            told = f"what was found is no feather that can be built: {error.problems[0].message}"
            raise InputError(
                Problem(source, "", f"{told}. --shaft or --threshold may help")
            ) from error
        return _Try(_deviation(found, feather), rounded, text, feather)

    best, seen = _best_fit(found, built)
    off, _, text, feather = best
    return Traced(text, 100.0 * off, seen), _drawn_over(photo, found, feather)


def _best_fit(found: _Outlines, built: Callable[[float], _Try]) -> tuple[_Try, tuple[int, int]]:
    """The feather that fits best, and the guides it has of the picture: those that were seen where
    they do within _GOOD, else simpler ones, which have to be better by _WORTH each time.

    Raises InputError where none can be built.
    """
    tries: list[tuple[float, _Try, tuple[int, int]]] = []
    worth, told = 0.0, InputError()
    while not tries or tries[-1][1].off > _GOOD:
        try:
            best = _grown_to_fit(found, built)
            tries.append((best.off + worth, best, (len(found.guides[0]), len(found.guides[1]))))
        except InputError as error:
            told = error
        worth += _WORTH
        if not found.simpler_guides():
            break
    if not tries:
        raise told
    _, best, seen = min(tries, key=lambda each: each[0])
    return best, seen


def _grown_to_fit(found: _Outlines, built: Callable[[float], _Try]) -> _Try:
    """The best of all bases, outlines widened by what it lacks. Raises InputError of the last base
    where none can be built."""
    found.edges = [each.copy() for each in found.wanted]
    tries, told = list[_Try](), InputError()
    for rounded in _BASES:
        try:
            tries.append(built(rounded))
        except InputError as error:
            told = error
    if not tries:
        raise told
    best = now = min(tries, key=lambda each: each.off)
    for _ in range(_ROUNDS):
        _grow(found, now.feather)
        try:
            now = built(best.rounded)
        except InputError:
            break
        best = min(best, now, key=lambda each: each.off)
    return best


def _text(table: dict[str, Any], base: str, photo: str) -> str:
    """The preset's file."""
    lines = [f"# Traced from {photo}; what it does not show is that of {base}.", f'base = "{base}"']
    for key, value in table.items():
        if isinstance(value, dict):
            lines += ["", f"[{key}]", *(f"{k} = {_rounded(v)}" for k, v in value.items())]
        else:
            lines.append(f"{key} = {_rounded(value)}")
    return "\n".join(lines) + "\n"


def _rounded(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_rounded(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_rounded, value)) + "]"
    return toml_of(value)


def kind_of_text(text: str) -> FeatherKind:
    """The kind that a preset's text describes. Raises InputError."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "traced.toml"
        path.write_text(text, encoding="utf-8")
        library = Library((), Problems())
        place = Place("traced", "", library.problems)
        finished = library.finish("feather", library.load_file("feather", path), place)
        return kind_of("traced", finished, place)


def flattened(kind: FeatherKind) -> FeatherKind:
    """The kind as it lies in a picture."""

    def flat(vane: VaneShape) -> VaneShape:
        return replace(vane, guides=tuple(replace(each, camber=0.0) for each in vane.guides))

    rachis = replace(kind.rachis, camber=0.0, twist=0.0)
    return replace(kind, rachis=rachis, leading=flat(kind.leading), trailing=flat(kind.trailing))


def _places(found: _Outlines, points: Array, length: float) -> Array:
    """(K, 2) places in AlignedPicture of points (K, 3) m of a flat feather."""
    line = found.line
    start, heading = line.places[0], found.heading
    flat = points[:, :2] * [1.0, found.first] * (line.length / length)
    c, s = np.cos(heading), np.sin(heading)
    return np.asarray(start + flat @ np.array([[c, s], [-s, c]]))


def _drawn(found: _Outlines, feather: Feather) -> Flags:
    """(U, V) which places a flat feather covers."""
    places = _places(found, feather.surface.points(feather.rest), float(feather.station[-1]))
    size = found.laid.mask.shape
    image = Image.new("1", size)
    draw = ImageDraw.Draw(image)
    for corners in places[feather.surface.triangles]:
        draw.polygon([tuple(each) for each in corners.tolist()], fill=1, outline=1)
    return np.asarray(image).T


def _clean(mask: Flags, line: ShaftLine, calamus: float) -> Flags:
    """Without hairs, notches, and the calamus, a fraction of the length."""
    reach = max(1, round(0.5 * _HAIR * line.length))
    begin = max(0, math.floor(line.places[0][0] + calamus * line.length))
    mask = np.concatenate([np.zeros_like(mask[:begin]), mask[begin:]])
    grown = ndimage.binary_closing(np.pad(mask, reach + 1), iterations=reach)
    return ndimage.binary_opening(grown, iterations=reach)[
        reach + 1 : -reach - 1, reach + 1 : -reach - 1
    ]


def _deviation(found: _Outlines, feather: Feather) -> float:
    """Greatest distance between the feather's edge and the silhouette's, in lengths."""
    masks = _drawn(found, feather), found.laid.mask
    own, wanted = (_clean(each, found.line, found.calamus) for each in masks)
    if not own.any():
        return np.inf
    worst = 0.0
    for one, other in ((own, wanted), (wanted, own)):
        edge = one & ~ndimage.binary_erosion(one)
        border = other & ~ndimage.binary_erosion(other)
        worst = max(worst, float(ndimage.distance_transform_edt(~border)[edge].max()))
    return worst / found.line.length


def _grow(found: _Outlines, feather: Feather) -> None:
    """Widen the outlines by what the feather lacks of its silhouette, where it lacks it."""
    covered = replace(found.laid, mask=_drawn(found, feather))
    for k, side in enumerate((found.first, -found.first)):
        _, width = widths(covered, found.line, side)
        lack = ndimage.uniform_filter1d(found.wanted[k] - width, 15)
        there = found.wanted[k] > 0.0
        found.edges[k] = np.where(there, np.maximum(found.edges[k] + 0.7 * lack, 0.0), 0.0)


def _drawn_over(photo: Photo, found: _Outlines, feather: Feather) -> Any:
    """The photo with the feather's edge, shaft and every tenth barb."""
    image = Image.fromarray(np.round(255.0 * photo.colours).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    length = float(feather.station[-1])

    def line(points: Array, colour: tuple[int, int, int], width: int) -> None:
        pixels = found.laid.in_photo(_places(found, points, length))
        draw.line([tuple(each) for each in pixels.tolist()], fill=colour, width=width)

    nodes, columns = feather.rest.nodes, feather.columns
    for k in range(2):
        side = slice(1 + k * columns, 1 + (k + 1) * columns)
        grown = np.flatnonzero(feather.barb_length[k] > 0.0)
        for row in grown[::10]:
            line(np.concatenate([nodes[row, :1], nodes[row, side]]), (40, 120, 255), 1)
        if len(grown):
            ends = nodes[grown, (k + 1) * columns]
            line(np.concatenate([nodes[grown[:1], 0], ends, nodes[-1:, 0]]), (255, 60, 40), 2)
    line(nodes[:, 0], (255, 190, 0), 2)
    return image


def write_traced(
    traced: Traced, picture: Any, output: Path, overlay: Path | None, overwrite: bool
) -> None:
    """Write the preset, and the picture where one is wanted; both appear, or none.

    Raises InputError where a file exists that may not be replaced, or cannot be written.
    """
    files = [output, *([overlay] if overlay else [])]
    problems = [fault for each in files for fault in find_file_problems([each], overwrite)]
    if output.suffix != ".toml":
        problems.append(Problem(str(output), "", f"suffix '{output.suffix}' is not .toml"))
    if overlay is not None and overlay.suffix.lower() not in (".png", ".jpg"):
        problems.append(Problem(str(overlay), "", f"suffix '{overlay.suffix}' is not .png or .jpg"))
    require(*problems)
    writers = [(output, into_text(traced.text))]
    if overlay is not None:
        kind = "PNG" if overlay.suffix.lower() == ".png" else "JPEG"
        writers.append((overlay, into(lambda file: picture.save(file, kind))))
    try:
        write_all(writers, {each: standing(each) for each in files})
    except OSError as error:
        message = f"not written: {error.strerror or error}"
        raise InputError(Problem(str(error.filename or output), "", message)) from error
