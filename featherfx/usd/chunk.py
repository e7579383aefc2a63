"""A run of frames on its way to a file of its own.

One layer with the attributes of every feather is made once and used for all chunks: its samples
are taken out again after each, which costs far less than making the prims anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from featherfx.usd.atomic import publish
from featherfx.usd.parts import ChunkRecord, file_digest
from featherfx.usd.samples import AnimatedPrims
from featherfx.usd.stage import StageInfo, new_layer
from featherfx.usd.surfaces import Floats, SurfaceFrame


@dataclass
class _Run:
    """Poses of the chunk at hand: their codes, the first, (N,) who has left it, corners of all."""

    moving: NDArray[np.bool_]
    codes: list[float] = field(default_factory=list)
    first: SurfaceFrame | None = None
    low: Floats = field(default_factory=lambda: np.full(3, np.inf, np.float32))
    high: Floats = field(default_factory=lambda: np.full(3, -np.inf, np.float32))


class ChunkWriter:
    """Collects the poses of a chunk, then writes them.

    static: (N,) per feather, whether it never has samples. seconds: between two samples. Within
    a chunk every other feather has samples at every code; one that keeps its first pose has the
    same value at all of them, which a crate file stores once.
    """

    def __init__(
        self, info: StageInfo, prims: AnimatedPrims, static: Sequence[bool], seconds: float
    ) -> None:
        self._prims, self._seconds = prims, seconds
        self._static = np.array(static, dtype=np.bool_)
        self._layer = new_layer(info)
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(~self._static):
                for key in prims.paths[index]:
                    prims.create(self._layer, int(index), key)
        self._run = self._new_run()

    @property
    def count(self) -> int:
        """Poses collected so far."""
        return len(self._run.codes)

    def add(self, code: float, frame: SurfaceFrame) -> None:
        """Add the pose at the next time code; frame is kept until the chunk is written."""
        run, prims, layer = self._run, self._prims, self._layer
        run.first = first = run.first or frame
        moving = prims.surfaces.changed(frame, first, self._seconds) & ~self._static
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(moving & ~run.moving):
                prims.author_sample(layer, int(index), run.codes, first)
            run.moving |= moving
            for index in np.flatnonzero(run.moving):
                prims.author_sample(layer, int(index), (code,), frame)
        run.codes.append(code)
        low, high = frame.corners()
        run.low, run.high = np.minimum(run.low, low), np.maximum(run.high, high)

    def write(self, path: Path) -> ChunkRecord:
        """Write the chunk, whole and read back, and start the next one."""
        run, prims, layer = self._run, self._prims, self._layer
        assert run.first is not None
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(~run.moving & ~self._static):
                prims.author_sample(layer, int(index), run.codes, run.first)
        layer.startTimeCode, layer.endTimeCode = run.codes[0], run.codes[-1]
        publish([(layer, path)])
        size, digest = file_digest(path)
        self._run = self._new_run()
        return ChunkRecord(
            codes=tuple(run.codes),
            bytes=size,
            sha256=digest,
            constant="".join("01"[not moving] for moving in run.moving),
            first=tuple(prims.digest(k, run.first) for k in range(len(self._static))),
            low=tuple(run.low.tolist()),
            high=tuple(run.high.tolist()),
        )

    def _new_run(self) -> _Run:
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(~self._static):
                for path in self._prims.paths[index].values():
                    self._layer.GetAttributeAtPath(path).ClearInfo("timeSamples")
        return _Run(np.zeros(len(self._static), dtype=np.bool_))


def open_chunk(path: Path) -> Any:
    """A chunk's layer, values read when asked for."""
    return Sdf.Layer.OpenAsAnonymous(str(path))
