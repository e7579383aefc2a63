"""Meshes of other files beside a cache, in the cache's time."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from featherfx.algebra.types import Array
from featherfx.errors import InputWarning
from featherfx.usd.read.opening import located
from featherfx.usd.read.read import Cache


class Scene(NamedTuple):
    """Meshes of a file. chosen: numbers of those. start, first: time code of the file at a time
    code of the cache; rate: time codes of the file in one of the cache. rest: time code of the file
    at rest; None: its rest pose. role: what a cache names it as."""

    cache: Cache
    chosen: Sequence[int]
    start: float = 0.0
    first: float = 0.0
    rate: float = 1.0
    rest: float | None = None
    role: str = ""

    def code(self, time: float | None) -> float | None:
        """Of the file at a time code of the cache; None: at rest."""
        return self.rest if time is None else self.start + self.rate * (time - self.first)

    def points(self, time: float | None) -> list[Array]:
        """(V, 3) m, of each mesh at a time code of the cache; None: at rest."""
        unit = self.cache.meters_per_unit
        return [unit * each for each in self.cache.points_of(self.chosen, self.code(time))]


def named_by(cache: Cache, path: Path, roles: Sequence[str], done: str) -> Iterator[Scene]:
    """What a cache at a path names in some roles, "skin" and "collider"; a warning tells what is
    not there. done: what would be done with it, in words."""
    for entry in cache.scenery:
        if entry["role"] not in roles:
            continue
        file, prim, told = located(path.parent, entry["file"]), entry["prim"], "is not there and"
        if file.is_file():
            other = Cache(file)
            chosen = [k for k, each in enumerate(other.feathers) if each.path == prim]
            if chosen:
                rate = other.frames_per_second / cache.frames_per_second
                times = entry["start"], entry["first"], rate, entry.get("rest")
                yield Scene(other, chosen, *times, entry["role"])
                continue
            told = f"has no {prim} and is"
        message = f"{path}: its {entry['role']} {file} {told} not {done}"
        warnings.warn(message, InputWarning, stacklevel=2)
