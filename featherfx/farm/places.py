"""Paths of a job: an output for every shot, and its shares until they are merged.

FOLDER/wing.usdc                       an output
FOLDER/.wing.usdc.shares/              until it is there
  shares.json                          how many
  wing.2of4.usdc, wing.2of4.clips/ ... a cache for each share (usd/write/layers.py)
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from featherfx.baking.task import part_path
from featherfx.errors import InputError, Problem, require
from featherfx.files.atomic_write import write_text
from featherfx.groom.read.toml_file import load_toml
from featherfx.usd.write.output import USD_SUFFIXES
from featherfx.usd.write.unfinished_cache import remove_cache

# of a worker: FROM=TO for paths of the machine that gives the work, with os.pathsep between
_PATHS_VARIABLE = "FEATHERFX_PATHS"
_RECORD = "shares.json"


def outputs_of(shots: Sequence[Path], where: Path) -> list[Path]:
    """An output for each shot, in its order: a folder's files are named after the shots' files,
    and where several have one name, after the shots themselves.

    where: a folder, or for one shot also a USD file. Raises InputError where two outputs would be
    one.
    """
    if where.suffix in USD_SUFFIXES and not where.is_dir():
        if len(shots) == 1:
            return [where]
        message = f"is a file. Name a folder for {len(shots)} shots"
        raise InputError(Problem(str(where), "output", message))
    taken = Counter(shot.stem for shot in shots)
    names = [shot.stem if taken[shot.stem] == 1 else _name_of(shot) for shot in shots]
    problems = []
    for k, (shot, name) in enumerate(zip(shots, names, strict=True)):
        if name in names[:k]:
            other = shots[names.index(name)]
            problems.append(Problem(str(shot), "", f"would be {name}.usdc, as {other} is"))
    require(*problems)
    return [where / f"{name}.usdc" for name in names]


def _name_of(shot: Path) -> str:
    """The name that a shot file gives itself; wrong files are told of when they are read."""
    name = shot.stem
    with contextlib.suppress(InputError):
        name = str(load_toml(shot).get("name", name))
    return re.sub(r"[^\w.-]+", "_", name)


class Shares:
    """The shares of one output while they are baked. output: of the whole."""

    def __init__(self, output: Path) -> None:
        self._output = output
        self.folder = output.with_name(f".{output.name}.shares")

    def files(self, count: int) -> list[Path]:
        """The cache of each of so many shares."""
        return [part_path(self.target, (k, count)) for k in range(1, count + 1)]

    @property
    def target(self) -> Path:
        """Path that a share's bake takes for the output of the whole."""
        return self.folder / self._output.name

    def piece(self, place: tuple[int, int]) -> Path:
        """Return the path of a run of chunks of the whole, the i-th of n, until all are there:
        those of an unfinished cache at this path."""
        name = "{}.piece{}of{}{}".format(self._output.stem, *place, self._output.suffix)
        return self.folder / name

    def begun(self) -> int:
        """Number of shares that an earlier job has begun; 0: none."""
        try:
            found = json.loads((self.folder / _RECORD).read_text(encoding="utf-8"))
            return int(found["shares"])
        except (OSError, ValueError, TypeError, KeyError):
            return 0

    def begin(self, count: int) -> None:
        """Make room. Raises OSError where the system refuses."""
        self.folder.mkdir(exist_ok=True)
        write_text(self.folder / _RECORD, json.dumps({"shares": count}) + "\n")

    def remove(self) -> None:
        """Remove what a job has left here; links are not followed, and all else stays."""
        count = self.begun()
        if not count or self.folder.is_symlink():
            return
        pieces = self.folder.glob(f"{self._output.stem}.piece*.clips")
        for file in (
            *self.files(count),
            *(each.with_suffix(self._output.suffix) for each in pieces),
        ):
            remove_cache(file)
        with contextlib.suppress(OSError):
            (self.folder / _RECORD).unlink()
            self.folder.rmdir()


def mapped(path: str) -> str:
    """A path of the machine that gives the work, as this worker has it."""
    pairs = os.environ.get(_PATHS_VARIABLE, "").split(os.pathsep)
    for given, _, own in (pair.partition("=") for pair in pairs if "=" in pair):
        if path == given or path.startswith(given.rstrip("/\\") + "/"):
            return own + path[len(given) :]
    return path
