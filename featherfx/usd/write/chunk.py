"""A run of frames on its way to a file of its own.

One layer with the attributes of every feather is made once and used for all chunks: its samples
are taken out again after each, which costs far less than making the prims anew, and their arrays
take the samples of the next, which saves the system from finding the memory again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from featherfx.files.whole import WrittenFile
from featherfx.shot.types import Frame
from featherfx.usd.arrays import Floats
from featherfx.usd.write.parts import ChunkRecord, checksum
from featherfx.usd.write.poses import Key, WrittenPose
from featherfx.usd.write.publish import export_beside, output_errors
from featherfx.usd.write.samples import AnimatedPrims
from featherfx.usd.write.stage import StageInfo, new_layer


@dataclass
class _Run:
    """Poses of the chunk at hand.

    moving: (N,) who has left the first pose. first: that pose, None for static feathers. codes:
    of all poses. kept: per feather, poses that the layer refers to.
    """

    moving: NDArray[np.bool_]
    first: list[WrittenPose | None]
    kept: list[list[WrittenPose]]
    codes: list[float] = field(default_factory=list)
    low: Floats = field(default_factory=lambda: np.full(3, np.inf, np.float32))
    high: Floats = field(default_factory=lambda: np.full(3, -np.inf, np.float32))


@dataclass(frozen=True)
class WrittenChunk:
    """A chunk that stands beside its target; finish makes it count as written."""

    file: WrittenFile
    codes: tuple[float, ...]
    constant: str
    first: tuple[str, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def finish(self) -> ChunkRecord:
        """Force the file to disk, name it, and return its record. Raises OutputError."""
        with output_errors():
            self.file.flush()
            size, crc = checksum(self.file.temporary)
            self.file.publish()
        return ChunkRecord(self.codes, size, crc, self.constant, self.first, self.low, self.high)


class Samples(Protocol):
    """Poses that were written before."""

    def fill(self, paths: Mapping[Key, Any], code: float, pose: WrittenPose) -> None:
        """Write to a pose what the attributes at these paths hold at a time code."""


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
        self._sampled = np.flatnonzero(~np.array(static, dtype=np.bool_)).tolist()
        self._layer = new_layer(info)
        with Sdf.ChangeBlock():
            self._attributes = [
                prims.create(self._layer, index, key)
                for index in self._sampled
                for key in prims.paths[index]
            ]
        self._spare: list[list[WrittenPose]] = [[] for _ in static]
        self._place = {index: index for index in range(len(static))}
        self._taken: dict[int, Samples] = {}
        self._run = self._new_run()

    @property
    def count(self) -> int:
        """Poses collected so far."""
        return len(self._run.codes)

    def take_over(self, earlier: Samples, feathers: Sequence[int]) -> None:
        """Have the poses of some feathers read instead of evaluated; frames come without these."""
        self._taken |= dict.fromkeys(feathers, earlier)
        left = [index for index in range(len(self._spare)) if index not in self._taken]
        self._place = {index: place for place, index in enumerate(left)}

    def add(self, code: float, frame: Frame) -> list[int]:
        """Add the pose at the next time code; returns feathers with values that are not finite.

        After such feathers the chunk is of no use.
        """
        run, poses = self._run, {}
        for index in self._sampled:
            pose = poses[index] = self._room(index)
            if (earlier := self._taken.get(index)) is not None:
                earlier.fill(self._prims.paths[index], code, pose)
                continue
            self._prims.feathers[index].evaluate(pose, frame.poses[self._place[index]])
        bad = [index for index, pose in poses.items() if not pose.finite]
        if not bad:
            with Sdf.ChangeBlock():
                for index, pose in poses.items():
                    self._author(index, code, pose)
            run.codes.append(code)
            corners = [corner for pose in poses.values() for corner in pose.corners()]
            if corners:
                run.low = np.minimum(run.low, np.min(corners, axis=0)[0])
                run.high = np.maximum(run.high, np.max(corners, axis=0)[1])
        return bad

    def write(self, path: Path) -> WrittenChunk:
        """Write the chunk beside its path, read back, and start the next one."""
        run, prims, layer = self._run, self._prims, self._layer
        constant = [not moving for moving in run.moving]
        digests = ["" for _ in constant]
        with Sdf.ChangeBlock():
            for index, first in enumerate(run.first):
                if constant[index] and first is not None:
                    prims.author_sample(layer, index, run.codes, first)
                    digests[index] = prims.digest(index, first)
        layer.startTimeCode, layer.endTimeCode = run.codes[0], run.codes[-1]
        file = export_beside(layer, path)
        self._run = self._new_run()
        return WrittenChunk(
            file=file,
            codes=tuple(run.codes),
            constant="".join("01"[same] for same in constant),
            first=tuple(digests),
            low=tuple(run.low.tolist()),
            high=tuple(run.high.tolist()),
        )

    def _author(self, index: int, code: float, pose: WrittenPose) -> None:
        run, prims = self._run, self._prims
        first = run.first[index]
        if first is None:
            run.first[index] = first = pose
            run.kept[index].append(pose)
        if not run.moving[index]:
            if not prims.feathers[index].changed(pose, first, self._seconds):
                if pose is not first:
                    self._spare[index].append(pose)
                return
            run.moving[index] = True
            prims.author_sample(self._layer, index, run.codes, first)
        if pose is not first:
            run.kept[index].append(pose)
        prims.author_sample(self._layer, index, (code,), pose)

    def _room(self, index: int) -> WrittenPose:
        spare = self._spare[index]
        return spare.pop() if spare else self._prims.feathers[index].new_pose()

    def _new_run(self) -> _Run:
        with Sdf.ChangeBlock():
            for attribute in self._attributes:
                attribute.ClearInfo("timeSamples")
        if hasattr(self, "_run"):
            for spare, kept in zip(self._spare, self._run.kept, strict=True):
                spare += kept
        count = len(self._spare)
        return _Run(np.zeros(count, dtype=np.bool_), [None] * count, [[] for _ in range(count)])


def open_chunk(path: Path) -> Any:
    """A chunk's layer, values read when asked for."""
    return Sdf.Layer.OpenAsAnonymous(str(path))
