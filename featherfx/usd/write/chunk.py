"""A run of frames on its way to a file of its own.

One layer with the attributes of every feather is made once and used for all chunks: its samples
are taken out again after each, which costs far less than making the prims anew, and their arrays
take the samples of the next, which saves the system from finding the memory again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pxr import Sdf

from featherfx.algebra.types import Flags, Floats
from featherfx.files.atomic_write import WrittenFile
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.write.layout import StageInfo, new_layer
from featherfx.usd.write.parts import ChunkRecord, checksum
from featherfx.usd.write.posed_groups import WrittenPose
from featherfx.usd.write.poses import Written
from featherfx.usd.write.publish import export_beside, output_errors
from featherfx.usd.write.samples import AnimatedPrims


@dataclass
class _Run:
    """Poses of the chunk at hand, of each group of feathers.

    moved: (M,) which of its feathers have left their first pose. first: that pose, None for static
    groups. codes: of all poses. kept: other poses that the layer refers to.
    """

    moved: list[Flags]
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

    def fill(self, feather: str, code: float, out: Written) -> None:
        """Write what is there of a feather, by its id, at a time code."""


class ChunkWriter:
    """Collects the poses of a chunk, then writes them.

    seconds: between two samples. Within a chunk every group of feathers that is not static has
    samples at every code; one that keeps its first pose has the same value at all of them, which
    a crate file stores once.
    """

    def __init__(self, info: StageInfo, prims: AnimatedPrims, seconds: float) -> None:
        self._prims, self._seconds, groups = prims, seconds, prims.groups
        self._sampled = [k for k, group in enumerate(groups) if not group.is_static]
        self._layer = new_layer(info)
        with Sdf.ChangeBlock():
            self._attributes = [
                prims.create(self._layer, index, key)
                for index in self._sampled
                for key in prims.paths[index]
            ]
        self._spare: list[list[WrittenPose]] = [[] for _ in groups]
        self._first: dict[int, WrittenPose] = {}
        self._place = {number: number for group in groups for number in group.members}
        self._taken: dict[int, Samples] = {}
        self._run = self._new_run()

    @property
    def count(self) -> int:
        """Poses collected so far."""
        return len(self._run.codes)

    def take_over(self, earlier: Samples, feathers: Sequence[int]) -> None:
        """Have the poses of some feathers read instead of evaluated; frames come without these."""
        self._taken |= dict.fromkeys(feathers, earlier)
        left = [number for number in sorted(self._place) if number not in self._taken]
        self._place |= {number: place for place, number in enumerate(left)}

    def add(self, code: float, frame: Frame) -> list[int]:
        """Add the pose at the next time code; returns feathers with values that are not finite.

        After such feathers the chunk is of no use.
        """
        run, groups = self._run, self._prims.groups
        poses = {index: self._room(index) for index in self._sampled}
        for index, pose in poses.items():
            self._evaluate(index, pose, code, frame)
        bad = [k for index, pose in poses.items() for k in groups[index].not_finite(pose)]
        if bad:
            return bad
        with Sdf.ChangeBlock():
            for index, pose in poses.items():
                self._author(index, code, pose)
        run.codes.append(code)
        return []

    def _evaluate(self, index: int, pose: WrittenPose, code: float, frame: Frame) -> None:
        """Write to a pose what a frame, or an earlier cache, has of the feathers of a group."""
        group = self._prims.groups[index]
        given: list[FeatherPose | None] = []
        for k, number in enumerate(group.members):
            earlier = self._taken.get(number)
            if earlier is not None and not group.static[k]:
                earlier.fill(group.feathers[k].id, code, group.own(pose, k))
            given.append(None if earlier is not None else frame.poses[self._place[number]])
        group.evaluate(pose, given)

    def write(self, path: Path) -> WrittenChunk:
        """Write the chunk beside its path, read back, and start the next one."""
        run, prims, layer = self._run, self._prims, self._layer
        constant, digests = "", []
        with Sdf.ChangeBlock():
            for index, first in enumerate(run.first):
                stays, digest = not run.moved[index].any(), ""
                if stays and first is not None:
                    prims.author_sample(layer, index, run.codes, first)
                    group = prims.groups[index]
                    stays, digest = group.is_at_rest(first), group.digest(first)
                constant += "01"[stays]
                digests.append(digest)
        layer.startTimeCode, layer.endTimeCode = run.codes[0], run.codes[-1]
        file = export_beside(layer, path)
        self._run = self._new_run()
        return WrittenChunk(
            file=file,
            codes=tuple(run.codes),
            constant=constant,
            first=tuple(digests),
            low=tuple(run.low.tolist()),
            high=tuple(run.high.tolist()),
        )

    def _author(self, index: int, code: float, pose: WrittenPose) -> None:
        run, prims, group = self._run, self._prims, self._prims.groups[index]
        first, moved = run.first[index], run.moved[index]
        had_moved = moved.any()
        if first is None:
            run.first[index] = first = pose
        group.hold(pose, first, moved, self._seconds)
        group.bound(pose)
        corners = pose.corners()
        run.low = np.minimum(run.low, np.min(corners, axis=0)[0])
        run.high = np.maximum(run.high, np.max(corners, axis=0)[1])
        if not moved.any():
            if pose is not first:
                self._spare[index].append(pose)
            return
        if not had_moved:
            prims.author_sample(self._layer, index, run.codes, first)
        if pose is not first:
            run.kept[index].append(pose)
        prims.author_sample(self._layer, index, (code,), pose)

    def _room(self, index: int) -> WrittenPose:
        group, spare = self._prims.groups[index], self._spare[index]
        if self._run.first[index] is None:
            if index not in self._first:
                self._first[index] = group.new_pose()
            return self._first[index]
        return spare.pop() if spare else group.new_pose(compared=False)

    def _new_run(self) -> _Run:
        with Sdf.ChangeBlock():
            for attribute in self._attributes:
                attribute.ClearInfo("timeSamples")
        if hasattr(self, "_run"):
            for spare, kept in zip(self._spare, self._run.kept, strict=True):
                spare += kept
        groups = self._prims.groups
        moved = [np.zeros(len(group.members), dtype=np.bool_) for group in groups]
        return _Run(moved, [None] * len(groups), [[] for _ in groups])


def open_chunk(path: Path) -> Any:
    """A chunk's layer, values read when asked for."""
    return Sdf.Layer.OpenAsAnonymous(str(path))
