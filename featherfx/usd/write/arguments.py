"""The arguments of a cache, checked before anything is written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from featherfx.errors import Problem
from featherfx.usd.types import DIAGNOSTICS, FeatherEntry, OutputError
from featherfx.usd.write.options import UP_AXES, WriteOptions


def check_arguments(
    path: Path,
    feathers: Sequence[FeatherEntry],
    frames: tuple[int, int] | None,
    frames_per_second: float,
    options: WriteOptions,
) -> None:
    """Raise OutputError with every problem."""
    wrong: list[tuple[str, str]] = []
    if not feathers:
        wrong.append(("feathers", "none given; a cache holds at least one"))
    seen: set[str] = set()
    for entry in feathers:
        if entry.id in seen:
            wrong.append(("feathers", f"id '{entry.id}' is used twice; ids are unique"))
        seen.add(entry.id)
        expected = entry.feather.points.shape
        if np.shape(entry.rest_points) != expected:
            shape = np.shape(entry.rest_points)
            wrong.append(("feathers", f"'{entry.id}': rest points {shape}, not {expected}"))
    if frames is not None and frames[0] > frames[1]:
        wrong.append(("frames", f"first frame {frames[0]} is after the last, {frames[1]}"))
    values = {"frames_per_second": frames_per_second, "meters_per_unit": options.meters_per_unit}
    for key, value in {**values, "chunk": options.chunk, "subframes": options.subframes}.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            wrong.append((key, f"{value} is not a finite number above 0"))
    if options.up_axis not in (None, *UP_AXES):
        wrong.append(("up_axis", f"'{options.up_axis}' is not one of {', '.join(UP_AXES)}"))
    wrong += [
        ("diagnostics", f"'{name}' is not one of {', '.join(DIAGNOSTICS)}")
        for name in options.diagnostics
        if name not in DIAGNOSTICS
    ]
    if wrong:
        raise OutputError(*(Problem(str(path), key, message) for key, message in wrong))
