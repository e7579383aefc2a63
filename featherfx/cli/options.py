"""Values and options that several commands share."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class FrameRange(click.ParamType):
    """A-B, first and last frame, inclusive; or one frame."""

    name = "A-B"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(-?\d+)(?:-(-?\d+))?", value.strip())
        if not match:
            self.fail(f"'{value}' is not a range of frames such as 1-24 or 12", param, ctx)
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            self.fail(f"'{value}' ends before it starts", param, ctx)
        return first, last


class Names(click.ParamType):
    """Some of the allowed names, with commas between."""

    name = "NAMES"

    def __init__(self, *allowed: str) -> None:
        self._allowed = allowed

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[str]:
        if isinstance(value, list):
            return value
        found = [name.strip() for name in value.split(",") if name.strip()]
        for name in found:
            if name not in self._allowed:
                self.fail(f"'{name}' is not one of {', '.join(self._allowed)}", param, ctx)
        return sorted(set(found))


class Share(click.ParamType):
    """i/n, the i-th of n shares."""

    name = "I/N"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(\d+)/(\d+)", value.strip())
        if not match or not 1 <= int(match[1]) <= int(match[2]):
            self.fail(f"'{value}' is not a share such as 1/4 or 4/4", param, ctx)
        return int(match[1]), int(match[2])


class Size(click.ParamType):
    """WxH in pixels."""

    name = "WxH"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(\d+)x(\d+)", value.strip().lower())
        if not match:
            self.fail(f"'{value}' is not a size such as 1280x720", param, ctx)
        return int(match[1]), int(match[2])


def readable_path() -> click.Path:
    """A path that the command reads; whether it can is told with the other problems."""
    return click.Path(path_type=Path, readable=False)


def stage_options(command: Decorated) -> Decorated:
    """Options of the commands that write USD."""
    options = (
        click.option(
            "--meters-per-unit",
            type=click.FloatRange(min=0.0, min_open=True),
            help="Unit of length in the USD file; 0.01 for centimetres. Points are scaled."
            "  [default: that of the skin's or groom's stage, else 1]",
        ),
        click.option(
            "--up-axis",
            type=click.Choice(["Y", "Z"], case_sensitive=False),
            help="Axis that points up in the USD file. Points are turned."
            "  [default: that of the skin's or groom's stage, else Z]",
        ),
        click.option(
            "--layout",
            type=click.Choice(["auto", "flat", "payload", "clips"]),
            default="auto",
            show_default=True,
            help="One file; a root that loads topology and animation as a payload; or the same"
            " with the animation as value clips. auto: flat up to 256 MB of samples, else clips.",
        ),
        click.option("--overwrite", is_flag=True, help="Replace the output if it exists."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def drawn_options(command: Decorated) -> Decorated:
    """What is drawn of the feathers, independent of what is simulated."""
    options = (
        click.option(
            "--render-rows",
            type=click.IntRange(min=3),
            help="Rachis rows of the meshes.  [default: as simulated]",
        ),
        click.option(
            "--render-columns",
            type=click.IntRange(min=1),
            help="Barb columns a side of the meshes.  [default: as simulated]",
        ),
        click.option(
            "--barbs",
            type=click.IntRange(min=1),
            metavar="N",
            help="Write N barbs along each vane as curves, too: variant barbs of the root prim.",
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def quality_option(text: str) -> Callable[[Decorated], Decorated]:
    return click.option("--quality", metavar="NAME", help=text)


def presets_option(command: Decorated) -> Decorated:
    return click.option(
        "--presets",
        "preset_folders",
        type=click.Path(path_type=Path, file_okay=False, exists=True),
        multiple=True,
        metavar="FOLDER",
        help="Folder of presets that win over the shipped ones. Repeatable.",
    )(command)
