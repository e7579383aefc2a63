"""Caches for programs: a mapping of feather ids, opened, or baked from a shot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.baking.options import BakeOptions, takes
from featherfx.errors import InputError, Problem, require_type
from featherfx.groom.keys.problems import nearest
from featherfx.phases import Progress, listener_of
from featherfx.shot.types import Shot
from featherfx.usd.read.cache import Cache


@dataclass(frozen=True)
class FeatherTrack:
    """One feather of a cache through its frames; metres and seconds, on the axes of its stage."""

    id: str
    kind: str
    region: str
    _cache: Cache = field(repr=False)
    _index: int = field(repr=False)

    @property
    def triangles(self) -> Indices:
        """(T, 3) corners, numbers of its points."""
        return self._cache.feathers[self._index].triangles

    def points(self, frame: float | None = None) -> Array:
        """(V, 3) m at a frame; None: at rest. Between samples as USD interpolates them.

        Raises InputError for a frame that the cache does not have.
        """
        self._refuse(frame)
        return self._cache.points(self._index, frame) * self._cache.meters_per_unit

    def velocities(self, frame: float) -> Floats | None:
        """(V, 3) m/s at a frame; None where the cache has none. Raises InputError as points."""
        self._refuse(frame)
        found = self._cache.pose(self._index, frame).velocities
        return None if found is None else found * np.float32(self._cache.meters_per_unit)

    def _refuse(self, frame: float | None) -> None:
        require_type("frame", frame, Real | None, "a number, or None for the rest pose")
        first, last = self._cache.frames
        if frame is not None and not first <= frame <= last:
            message = f"{frame:g} is not in the cache. Give {first:g} to {last:g}"
            raise InputError(Problem(str(self._cache.path), "frame", message))


class FeatherCache(Mapping[str, FeatherTrack]):
    """A cache: feathers by id, in the order of the stage.

    path: of its file, which is opened when it is first looked into. report: of the bake that wrote
    it, None for one that was there. Raises InputError, when it is looked into, where the file
    cannot be opened or holds no feather.
    """

    def __init__(self, path: str | Path, report: dict[str, Any] | None = None) -> None:
        self.path, self.report = Path(path).absolute(), report

    @cached_property
    def _open(self) -> Cache:
        return Cache(self.path)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        found = enumerate(self._open.feathers)
        numbers = {each.id or each.name: number for number, each in found if each.is_feather}
        if not numbers:
            raise InputError(Problem(str(self.path), "", "holds no feather. Give a baked cache"))
        return numbers

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of its feathers."""
        return tuple(self._numbers)

    @property
    def frames(self) -> tuple[int, int]:
        """First and last frame."""
        first, last = self._open.frames
        return int(np.ceil(first)), int(np.floor(last))

    @property
    def frames_per_second(self) -> float:
        """Frames per second."""
        return float(self._open.frames_per_second)

    def __getitem__(self, name: str) -> FeatherTrack:
        require_type("id", name, str, f"an id, such as {next(iter(self._numbers))!r}")
        if name not in self._numbers:
            raise KeyError(f"no feather {name!r}, {nearest(str(name), self._numbers)}")
        feather = self._open.feathers[self._numbers[name]]
        return FeatherTrack(name, feather.kind, feather.region, self._open, self._numbers[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __repr__(self) -> str:
        return f"FeatherCache({str(self.path)!r})"


def open_cache(path: str | Path) -> FeatherCache:
    """Open a cache. Raises InputError where the file cannot be opened or holds no feather."""
    require_type("path", path, str | Path, "the path of a cache")
    cache = FeatherCache(path)
    len(cache)
    return cache


@takes(BakeOptions)
def bake(
    shot: str | Path | Shot,
    output: str | Path | None = None,
    *,
    progress: Progress = False,
    **options: Any,
) -> FeatherCache:
    """Simulate a shot, write it to USD and open what was written.

    shot: its file, or a shot in memory. output: .usd, .usdc or .usda; None: the shot's name with
    .usdc, in the current folder. progress: True for lines on stderr, or a function that takes the
    samples that are done and their number. options: fields of
    featherfx.baking.options.BakeOptions; all that `featherfx bake` has. The result has the report.

    The cache appears complete or not at all; an interrupt ends the bake cleanly, and `resume=True`
    goes on after it. Raises InputError with every problem of shot, groom, presets and outputs
    before any work, SimulationError where a feather cannot be advanced.
    """

    from featherfx.baking import bake as baking

    require_type("shot", shot, str | Path | Shot, "a Shot, or the path of a shot file")
    require_type("output", output, str | Path | None, "the path of a file")
    report = baking.bake(shot, output, on_frame=listener_of(progress, "frames"), **options)
    return FeatherCache(report["output"], report)
