"""Values and options that several commands share."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import click

from featherfx.files.folders import SHIPPED_PRESETS
from featherfx.limits import MAX_JOBS, MAX_SHARES, MAX_SIDE

_MAX_DIGITS = 8  # of a frame, a share or a side: with sign, more than any may have
Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Parsed(click.ParamType):
    """A value that is read out of text. name: in help. read: of a text; raises ValueError that
    says what is wrong with it. once: whether an option of it may be given only once (Command)."""

    def __init__(self, name: str, read: Callable[[str], Any], once: bool = False) -> None:
        self.name, self._read, self.once = name, read, once

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return self._read(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


def _as_number(convert: Callable[..., Any], kind: Any, text: Any, *place: Any) -> Any:
    """Convert a text to a number; a failure says what is allowed."""
    try:
        return convert(text, *place)
    except click.BadParameter as error:
        if "is not a valid" not in error.message:
            raise
        told = f"'{text}' is not a {kind.name}. Give {kind._describe_range()}"
        raise click.BadParameter(told) from error


class WholeNumber(click.IntRange):
    """A whole number within bounds."""

    name = "whole number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return _as_number(super().convert, self, value, param, ctx)


class RealNumber(click.FloatRange):
    """A number within bounds."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return _as_number(super().convert, self, value, param, ctx)


def _frames(text: str) -> tuple[int, int]:
    """First and last frame, inclusive; or one frame."""
    match = re.fullmatch(r"(-?\d+)(?:-(-?\d+))?", text.strip())
    if not match:
        raise ValueError(f"'{text}' is not a range of frames such as 1-24 or 12")
    if max(map(len, match.groups(""))) > _MAX_DIGITS:
        raise ValueError("frames lie within -1000000 and 1000000")
    first, last = int(match[1]), int(match[2] or match[1])
    if last < first:
        raise ValueError(f"'{text}' ends before it starts")
    return first, last


def _shares(text: str) -> list[tuple[int, int]]:
    """The i-th of n shares; or some of them one after the other."""
    match = re.fullmatch(r"(\d+)(?:-(\d+))?/(\d+)", text.strip())
    if match and (len(match[3]) > _MAX_DIGITS or int(match[3]) > MAX_SHARES):
        raise ValueError(f"'{text}' is out of range, at most {MAX_SHARES} shares")
    if match and max(map(len, match.groups(""))) <= _MAX_DIGITS:
        first, last, count = int(match[1]), int(match[2] or match[1]), int(match[3])
        if 1 <= first <= last <= count:
            return [(share, count) for share in range(first, last + 1)]
    raise ValueError(f"'{text}' is not a share such as 1/4, or some such as 1-3/4")


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text.strip().lower())
    if not match:
        raise ValueError(f"'{text}' is not a size such as 1280x720")
    if max(map(len, match.groups())) > _MAX_DIGITS:
        raise ValueError(f"a side has 16 to {MAX_SIDE} pixels")
    return int(match[1]), int(match[2])


def _numbers(text: str) -> list[float]:
    try:
        return [float(each) for each in text.split(",")]
    except ValueError:
        raise ValueError(f"'{text}' is no list of numbers such as 0.1,0.01") from None


FRAMES, _SHARES = Parsed("A-B", _frames, once=True), Parsed("I/N", _shares, once=True)
_FORMS = {"A-B": FRAMES, "I/N": _SHARES, "WxH": Parsed("WxH", _size)}
NUMBERS = Parsed("NUMBERS", _numbers)


def pairs(name: str, within: str, between: str | None, of: str, example: str) -> Parsed:
    """Pairs of numbers. name: in help. within, between: what stands within a pair and between two,
    None: spaces. of: what they are, and example, for messages."""

    def read(text: str) -> list[tuple[float, float]]:
        try:
            found = [map(float, each.split(within)) for each in text.split(between)]
            return [(first, second) for first, second in found]
        except ValueError:
            raise ValueError(f"'{text}' is no list of {of} such as {example}") from None

    return Parsed(name, read)


def names(*allowed: str) -> Parsed:
    """Some of the allowed names, with commas between."""

    def read(text: str) -> list[str]:
        found = [name.strip() for name in text.split(",") if name.strip()]
        for name in found:
            if name not in allowed:
                raise ValueError(f"'{name}' is not one of {', '.join(allowed)}")
        return sorted(set(found))

    return Parsed("NAMES", read)


def readable_path() -> click.Path:
    """A path that the command reads; whether it can is told with the other problems."""
    return click.Path(path_type=Path, readable=False)


def output_option(
    told: str, required: bool = True, metavar: str | None = None, **path: bool
) -> Callable[[Decorated], Decorated]:
    """-o of a command. path: what click.Path takes besides."""
    kind = click.Path(path_type=Path, **path)
    return click.option("-o", "--output", required=required, type=kind, metavar=metavar, help=told)


def overwrite_option(told: str = "Replace files that exist.") -> Callable[[Decorated], Decorated]:
    return click.option("--overwrite", is_flag=True, help=told)


def json_option(told: str = "One JSON object.") -> Callable[[Decorated], Decorated]:
    # eager: known where --progress is looked at
    return click.option("--json", "as_json", is_flag=True, is_eager=True, help=told)


def jobs_option(meaning: str = "Threads to use.") -> Callable[[Decorated], Decorated]:
    """--jobs of a command; None where it is not given."""
    told = f"{meaning}  [default: all cores]"
    return click.option("--jobs", type=WholeNumber(1, MAX_JOBS), help=told)


def options_of(options: type, *names: str) -> Callable[[Decorated], Decorated]:
    """The options of a command for fields of a class of options, in this order.

    Name, type, range, default and help are those of the field (option of featherfx/limits.py).
    """
    hints, known = get_type_hints(options), {each.name: each for each in fields(options)}

    def decorate(command: Decorated) -> Decorated:
        for name in reversed(names):
            command = _option(known[name], hints[name])(command)
        return command

    return decorate


def _option(declared: Field[Any], hint: Any) -> Callable[[Decorated], Decorated]:
    told, default = declared.metadata, declared.default
    if default is not None and "allowed" in told and default != ():
        default = str(default)  # one of the texts that may be chosen
    flag = told.get("flag", "--" + declared.name.replace("_", "-"))
    if hint is bool:
        return click.option(flag, declared.name, is_flag=True, help=told["text"])
    if hint == bool | None:
        return click.option(f"{flag}/--no-{flag[2:]}", default=None, help=told["text"])
    return click.option(
        *flag.split(),
        declared.name,
        type=_click_type(told, hint),
        multiple=told.get("several", False),
        default="" if default == () and "several" not in told else default,
        show_default=default not in (None, ()),
        metavar=told.get("metavar"),
        help=told["text"],
    )


def _click_type(told: Mapping[str, Any], hint: Any) -> click.ParamType | None:
    """Return the click type of a field."""
    if "form" in told:
        return _FORMS[told["form"]]
    if "allowed" in told:
        if get_origin(hint) is Sequence:
            return names(*told["allowed"])
        return click.Choice([*map(str, told["allowed"])], case_sensitive=False)
    if "reads" in told:
        return readable_path()
    if "there" in told:
        return click.Path(path_type=Path, exists=True, dir_okay=False)
    if "least" in told:
        if float in get_args(hint):
            return RealNumber(min=told["least"], max=told.get("most"))
        return WholeNumber(min=told["least"], max=told.get("most"))
    if "above" in told:
        return RealNumber(min=told["above"], min_open=True)
    return click.Path(path_type=Path) if Path in get_args(hint) else None


def default_jobs() -> int:
    """As many jobs as there are cores."""
    return min(os.cpu_count() or 1, MAX_JOBS)


def serving_options(command: Decorated) -> Decorated:
    """--port and --no-browser, of a page that is served."""
    port = WholeNumber(1, 65535)
    quiet = click.option("--no-browser", is_flag=True, help="Only print the address.")
    told = "Port of the local server.  [default: a free one]"
    return click.option("--port", type=port, help=told)(quiet(command))


def quality_option(text: str) -> Callable[[Decorated], Decorated]:
    return click.option("--quality", metavar="NAME", help=text)


class PresetFolder(click.Path):
    """A folder that is there, or SHIPPED."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False, exists=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == SHIPPED_PRESETS:
            return value
        folder = Path(str(super().convert(value, param, ctx)))
        # click takes a pipe or device for a folder
        if not folder.is_dir():
            self.fail(f"'{folder}' is not a folder.", param, ctx)
        return folder


def presets_option(command: Decorated) -> Decorated:
    return click.option(
        "--presets",
        "preset_folders",
        type=PresetFolder(),
        multiple=True,
        metavar="FOLDER",
        help="Search this folder for presets before those of FEATHERFX_PRESETS, your own and the"
        f" shipped ones. '{SHIPPED_PRESETS}' stands for the shipped ones. Repeatable; the first"
        " wins.",
    )(command)


def _one_on_stdout(ctx: click.Context, param: click.Parameter, style: str) -> str:
    if style == "openjd" and ctx.params.get("as_json"):
        raise click.UsageError("--json and --progress openjd both write to stdout. Ask for one")
    return style


def progress_option(command: Decorated) -> Decorated:
    return click.option(
        "--progress",
        "style",
        type=click.Choice(["auto", "json", "openjd"]),
        default="auto",
        show_default=True,
        callback=_one_on_stdout,
        help="json: one JSON object a line, on stderr; openjd: lines of Open Job Description, on"
        " stdout.",
    )(command)
