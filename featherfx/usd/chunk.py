"""A run of frames on its way to a file of its own.

One layer with the attributes of every feather is made once and used for all chunks: its samples
are taken out again after each, which costs far less than making the prims anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf

from featherfx.usd.atomic import publish
from featherfx.usd.parts import ChunkRecord, file_digest
from featherfx.usd.samples import AnimatedPrims
from featherfx.usd.stage import StageInfo, new_layer
from featherfx.usd.surfaces import SurfaceFrame


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
        self._clear()

    @property
    def count(self) -> int:
        """Poses collected so far."""
        return len(self._codes)

    def add(self, code: float, frame: SurfaceFrame) -> None:
        """Add the pose at the next time code; frame is kept until the chunk is written."""
        if self._first is None:
            self._first = frame
        moving = self._prims.surfaces.changed(frame, self._first, self._seconds)
        moving &= ~self._static
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(moving & ~self._moving):
                self._prims.author_sample(self._layer, int(index), self._codes, self._first)
            self._moving |= moving
            for index in np.flatnonzero(self._moving):
                self._prims.author_sample(self._layer, int(index), (code,), frame)
        self._codes.append(code)
        self._low = np.minimum(self._low, frame.extent[:, 0].min(axis=0))
        self._high = np.maximum(self._high, frame.extent[:, 1].max(axis=0))

    def write(self, path: Path) -> ChunkRecord:
        """Write the chunk, whole and read back, and start the next one."""
        assert self._first is not None
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(~self._moving & ~self._static):
                self._prims.author_sample(self._layer, int(index), self._codes, self._first)
        self._layer.startTimeCode, self._layer.endTimeCode = self._codes[0], self._codes[-1]
        publish([(self._layer, path)])
        size, digest = file_digest(path)
        record = ChunkRecord(
            codes=tuple(self._codes),
            bytes=size,
            sha256=digest,
            constant="".join("01"[not moving] for moving in self._moving),
            first=tuple(self._prims.digest(k, self._first) for k in range(len(self._static))),
            low=tuple(self._low.tolist()),
            high=tuple(self._high.tolist()),
        )
        self._clear()
        return record

    def _clear(self) -> None:
        self._codes: list[float] = []
        self._first: SurfaceFrame | None = None
        self._moving = np.zeros(len(self._static), dtype=np.bool_)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(~self._static):
                for path in self._prims.paths[index].values():
                    self._layer.GetAttributeAtPath(path).ClearInfo("timeSamples")


def open_chunk(path: Path) -> Any:
    """A chunk's layer, values read when asked for."""
    return Sdf.Layer.OpenAsAnonymous(str(path))
