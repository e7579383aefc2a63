"""The samples that come with featherfx, to copy and change."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from featherfx.errors import InputError, Problem
from featherfx.files.shipped import shipped


def sample_names() -> tuple[str, ...]:
    """Names of all samples."""
    folder = shipped("samples")
    return tuple(sorted(each.parent.name for each in folder.glob("*/shot.toml")))


def copy_sample(name: str, folder: str | Path) -> list[Path]:
    """Copy the files of a sample into a folder that is new or empty; returns them, sorted.

    The folder appears complete or not at all. Raises InputError for a name that there is none of
    and for a folder that holds something or is a file.
    """
    folder = Path(folder)
    if name not in sample_names():
        known = ", ".join(sample_names()) or "none, since this install has no samples"
        raise InputError(Problem("sample", "", f"'{name}' is not one of {known}"))
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(Problem(str(folder), "", "is not empty; name a new folder with -o"))
    if folder.exists() and not folder.is_dir():
        raise InputError(Problem(str(folder), "", "is a file; name a new folder with -o"))
    above = folder.absolute().parent
    above.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(dir=above, prefix=f".{folder.name}."))
    try:
        copy = shutil.copytree(
            shipped("samples") / name,
            beside / name,
            copy_function=shutil.copyfile,  # what is installed may be for reading only
            ignore=shutil.ignore_patterns("__pycache__"),
        )
        if folder.is_dir():
            folder.rmdir()  # it is empty; not everywhere does a rename replace one
        os.rename(copy, folder)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return sorted(each for each in folder.rglob("*") if each.is_file())
