"""A calibration as a material preset that grooms can name."""

from __future__ import annotations

import os
import re
from pathlib import Path

from featherfx.errors import InputError, Problem
from featherfx.lab.vane.calibrate import NAMES, Calibration

BASE = "swan_vane"


def check_name(folder: Path, name: str) -> Path:
    """The file of a preset. Raises InputError for a name that is none or is taken."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        message = f"'{name}' is not allowed, must be small letters, digits and _"
        raise InputError(Problem("", "name", message))
    file = folder / "material" / "vane" / f"{name}.toml"
    if file.exists():
        raise InputError(Problem(str(file), "", "exists already; remove it or choose another name"))
    return file


def save_preset(folder: Path, name: str, found: Calibration, thickness: float) -> Path:
    """Write the preset and return its file; thickness: m.

    What traction does not tell (mass, bending, damping) is the swan's. Raises InputError as
    check_name.
    """
    file = check_name(folder, name)
    lines = [
        f"# Vane calibrated from {found.curves} traction tests with {found.points} points.",
        "# 95 % intervals behind the values. Mass, bending and damping are those of the base.",
        f'base = "{BASE}"',
        "",
    ]
    for key in NAMES:
        value = getattr(found.moduli, key)
        known = found.low is not None and found.high is not None
        told = (
            f"  # {getattr(found.low, key):.4g} to {getattr(found.high, key):.4g}" if known else ""
        )
        lines.append(f"{key} = {value:.6g}{told}")
    lines.append(f"thickness = {thickness:.6g}  # mean of the samples")
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(f".{os.getpid()}.part")
    part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    os.replace(part, file)
    return file
