"""Can this output be written? Asked before any work is done; needs no USD."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from featherfx.errors import Problem
from featherfx.usd.types import OutputError

SUFFIXES = (".usd", ".usda", ".usdc")
LAYOUTS = ("flat", "payload")


def output_files(path: Path, layout: str) -> list[Path]:
    """Every file of an output, in the order in which they are published: the root is last.

    "flat": the one file. "payload": animation, topology (the payload), root.
    """
    if layout == "flat":
        return [path]
    return [
        path.with_name(f"{path.stem}.animation.usdc"),
        path.with_name(f"{path.stem}.payload.usdc"),
        path,
    ]


def check_output(path: str | Path, overwrite: bool = False, layout: str = "flat") -> Path:
    """Return path as a Path if a cache can be written there.

    Raises OutputError with every problem: unknown suffix or layout, missing folder, folder that
    cannot be written to, a file that exists (unless overwrite) or a folder in its place.
    """
    path = Path(path)
    source = str(path)
    problems = []
    if path.suffix not in SUFFIXES:
        problems.append(
            Problem(source, "", f"suffix '{path.suffix}' is not one of {', '.join(SUFFIXES)}")
        )
    if layout not in LAYOUTS:
        problems.append(Problem(source, "layout", f"'{layout}' is not one of {', '.join(LAYOUTS)}"))
    for file in output_files(path, layout if layout in LAYOUTS else "flat"):
        problems += _file_problems(file, overwrite)
    problems += _folder_problems(path)
    if problems:
        raise OutputError(*problems)
    return path


def _file_problems(file: Path, overwrite: bool) -> list[Problem]:
    # os.path.* answer False where a Path method would raise (a parent that is a file).
    if os.path.isdir(file):
        return [Problem(str(file), "", "is a folder; give the name of a file")]
    if os.path.lexists(file) and not overwrite:
        return [Problem(str(file), "", "exists already; choose another name or --overwrite")]
    return []


def _folder_problems(path: Path) -> list[Problem]:
    folder = path.parent
    if not os.path.isdir(folder):
        exists = os.path.lexists(folder)
        return [Problem(str(folder), "", "is not a folder" if exists else "folder does not exist")]
    try:
        # Only an attempt tells: permission bits say nothing about mounts, quotas or root.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return [Problem(str(folder), "", f"cannot write to this folder: {error.strerror}")]
    return []
