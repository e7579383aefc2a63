"""Options of images, and their limits; importable without USD."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from featherfx.errors import Problem, require
from featherfx.limits import MAX_FILM_RATE, MAX_PIXELS, MAX_SHEET, MAX_SIDE, option

_COLOURS = ("shaded", "barb", "region", "strain", "hooked")
_VIEWS = ("auto", "top", "side", "front")
_FRAMINGS = ("all", "drawn", "follow")
_SAMPLES = (1, 4, 16, 64)
_SUFFIXES = (".png", ".gif", ".mp4")
SHEET_FRAMES = 9  # of a sheet, where nothing else is said


@dataclass(frozen=True)
class PictureOptions:
    """Options of images of a cache.

    frames: time codes; None: the first frame, on a sheet up to nine spread over the range, of a
    film all whole frames. sheet: all frames on one picture. turntable: number of views around the
    upright axis, 0 for none. f_stop: of the lens, sharp at the middle of what is framed; 0: all is
    sharp. overwrite: whether files that exist are replaced. The others are those of the command.
    """

    frames: Sequence[float] | None = None
    size: tuple[int, int] | None = option(None, "Pixels of one picture.", form="WxH")
    colour: str = option(
        "shaded",
        "Shaded vanes, barb angle, region, strain across the barbs, or hooks that hold.",
        allowed=_COLOURS,
        flag="--colour --color",
    )
    sheet: bool = False
    view: str = option(
        "auto", "Where the camera stands; auto looks onto the vanes.", allowed=_VIEWS
    )
    framing: str | None = option(
        None,
        "Keep in view what all frames of FILE show, or those drawn, or go along with it."
        "  [default: all; drawn with --feather or --region; follow where it goes far]",
        allowed=_FRAMINGS,
    )
    camera: str | None = option(
        None,
        "Prim path of a USD camera in FILE, or of another file as cameras.usda:/path.",
        metavar="PATH",
    )
    feathers: Sequence[str] = option(
        (), "Only these, close up; * and ? too.", several=True, metavar="ID", flag="--feather"
    )
    regions: Sequence[str] = option(
        (), "Only these, close up; * and ? too.", several=True, metavar="NAME", flag="--region"
    )
    surroundings: bool = option(False, "With --feather or --region: the others, too.")
    against: str | Path | Sequence[str | Path] = option(
        (),
        "A cache to draw beside this one; several, too.",
        several=True,
        reads=True,
        metavar="FILE",
    )
    scenery: Sequence[str | Path] = option(
        (),
        "USD file whose meshes are drawn, too. Skin and colliders of the shot always are.",
        several=True,
        reads=True,
        metavar="FILE",
    )
    bare: bool = option(False, "Leave out skin and colliders.")
    samples: int = option(16, "Rays a pixel.", allowed=_SAMPLES)
    turntable: int = 0
    floor: bool = option(False, "A floor under what is drawn, which takes its shadow.")
    f_stop: float = 0.0
    rate: float | None = option(
        None, "Pictures a second of a film.  [default: the file's]", least=1, most=MAX_FILM_RATE
    )
    overwrite: bool = False

    @property
    def others(self) -> tuple[str | Path, ...]:
        """Files of against."""
        return (self.against,) if isinstance(self.against, str | Path) else tuple(self.against)

    @property
    def pixels(self) -> tuple[int, int]:
        """Size of one frame."""
        return self.size or ((480, 320) if self.sheet else (1280, 720))

    @property
    def framed(self) -> str:
        """One of _FRAMINGS."""
        return self.framing or ("drawn" if self.feathers or self.regions else "all")

    @property
    def is_look(self) -> bool:
        """True for lit images; else colours stand for values."""
        return self.colour in ("shaded", "region")


def check_pixels(count: int, options: PictureOptions) -> list[Problem]:
    """Find problems of the number of pixels of so many images."""
    width, height = options.pixels
    sides = 1 + len(options.others)
    total = count * sides * width * height
    if total <= MAX_PIXELS:
        return []
    pixels = f"{count * sides} pictures of {total / 1e6:.4g} million pixels in all"
    most = f"more than {MAX_PIXELS / 1e6:g} million. Draw fewer frames at a time, or smaller"
    return [Problem("preview", "size", f"{pixels}, {most}")]


def check_options(path: Path, output: Path, options: PictureOptions) -> None:
    problems = find_missing_libraries("preview", output)
    for each in fields(options):
        value, allowed = getattr(options, each.name), each.metadata.get("allowed")
        if allowed and value not in (*allowed, each.default):
            told = ", ".join(map(str, allowed))
            problems.append(Problem("preview", each.name, f"'{value}' is not one of {told}"))
    problems += _number_problems(options)
    if output.suffix.lower() not in _SUFFIXES:
        told = f"suffix '{output.suffix}' is not one of {', '.join(_SUFFIXES)}"
        problems.append(Problem(str(output), "", told))
    elif options.sheet and output.suffix.lower() != ".png":
        problems.append(Problem(str(output), "", "a sheet is one image. Name a .png file"))
    if options.others and not options.is_look:
        told = f"'{options.colour}' would have a scale for each file. Give shaded or region"
        problems.append(Problem("preview", "colour", told))
    if options.floor and not options.is_look:
        problems.append(Problem("preview", "floor", f"'{options.colour}' has no shadows to take"))
    if not os.path.isdir(output.parent):
        problems.append(Problem(str(output.parent), "", "folder does not exist. Make it first"))
    for file in (path, *options.others, *options.scenery):
        if not Path(file).is_file():
            problems.append(Problem(str(file), "", "there is no such file. Check the path"))
    require(*problems)


def _number_problems(options: PictureOptions) -> list[Problem]:
    width, height = options.pixels
    problems = []
    if not all(16 <= side <= MAX_SIDE for side in (width, height)):
        message = f"{width} x {height} is not allowed. Give 16 to {MAX_SIDE} pixels a side"
        problems.append(Problem("preview", "size", message))
    else:
        problems += check_pixels(1 if options.frames is None else len(options.frames), options)
    if not (options.f_stop == 0.0 or 0.1 <= options.f_stop <= 1000.0):
        message = f"{options.f_stop:g} is not allowed. Give 0.1 to 1000, or 0 where all is sharp"
        problems.append(Problem("preview", "f_stop", message))
    if options.rate is not None and not 1.0 <= options.rate <= MAX_FILM_RATE:
        message = f"{options.rate:g} is not allowed. Give 1 to {MAX_FILM_RATE} pictures a second"
        problems.append(Problem("preview", "rate", message))
    if not 0 <= options.turntable <= MAX_SHEET:
        message = f"{options.turntable} is not allowed. Give 0 to {MAX_SHEET}"
        problems.append(Problem("preview", "turntable", message))
    return problems


def find_missing_libraries(command: str, output: Path | None) -> list[Problem]:
    """Find problems of libraries that rays need, and an output file, where there is one."""
    needed = [("embreex", "Embree, which casts rays,", "preview")]
    if output is not None:
        needed.append(("PIL", "Pillow, which writes pictures,", "preview"))
        if output.suffix.lower() == ".mp4":
            needed.append(("imageio_ffmpeg", "imageio-ffmpeg, which writes films,", "film"))
    return [
        Problem(command, "", f'{name} is not installed. Run pip install "featherfx[{extra}]"')
        for module, name, extra in needed
        if importlib.util.find_spec(module) is None
    ]
