"""How USD is written, as the commands and the functions take it; importable without USD.

An option is declared once: its name, type, default and what it may be. The command line derives its
own options from these fields, and errors name them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from featherfx.errors import InputError, Problem

LAYOUTS = ("auto", "flat", "payload", "clips")
UP_AXES = ("Y", "Z")


def option(default: Any, text: str, **limits: Any) -> Any:
    """A field of a class of options.

    text: its meaning with unit, for help. limits: least, above: what a number is at least, or more
    than; allowed: names; form: of two numbers in one text, "A-B" or "I/N"; metavar: in help.
    """
    return field(default=default, metadata={"text": text, **limits})


@dataclass(frozen=True)
class StageOptions:
    """How a USD stage is written."""

    meters_per_unit: float | None = option(
        None,
        "Unit of length in the USD file; 0.01 for centimetres. Points are scaled."
        "  [default: that of the skin's or groom's stage, else 1]",
        above=0.0,
    )
    up_axis: str | None = option(
        None,
        "Axis that points up in the USD file. Points are turned."
        "  [default: that of the skin's or groom's stage, else Z]",
        allowed=UP_AXES,
    )
    layout: str = option(
        "auto",
        "One file; a root that loads topology and animation as a payload; or the same"
        " with the animation as value clips. auto: flat up to 256 MB of samples, else clips.",
        allowed=LAYOUTS,
    )
    overwrite: bool = option(False, "Replace the output if it exists.")


@dataclass(frozen=True)
class WriteOptions(StageOptions):
    """How a cache is written, and which samples."""

    chunk: int = option(
        24, "Frames that are written, and can be resumed after, at a time.", least=1
    )
    subframes: int = option(1, "Samples a frame, for motion blur.", least=1)
    accelerations: bool = option(False, "Write accelerations beside velocities.")
    diagnostics: Sequence[str] = option(
        (),
        "Write strain, energy or strain,energy of the vanes, per face and sample.",
        allowed=("strain", "energy"),
    )
    resume: bool = option(
        False, "Continue after the frames that an earlier bake of this shot left, killed or not."
    )


def check_least(options: StageOptions, source: str) -> None:
    """Raise InputError for every number that is too small. source: what the problems are of."""
    problems = [
        Problem(source, each.name, f"{value}; allowed: at least {least}")
        for each in fields(options)
        if (least := each.metadata.get("least")) is not None
        and (value := getattr(options, each.name)) is not None
        and value < least
    ]
    if problems:
        raise InputError(*problems)
