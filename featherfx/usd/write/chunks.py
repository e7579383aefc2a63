"""Chunks of a cache: poses become samples, chunks become files, and finished chunks the cache.

A chunk is a run of frames in a file of its own. One layer with the attributes of every feather is
made once and used for all chunks: its samples are removed after each, which costs far less than
making the prims anew, and their arrays hold the samples of the next.

Samples are authored at Sdf level, without a composed stage: one call per attribute and frame.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pxr import Sdf, Tf

from featherfx.algebra.types import Flags, Floats
from featherfx.files.atomic_write import Standing, Store, WrittenFile
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    DETAIL_ATTRIBUTE,
    ORIENT_PRIMVAR,
    PER_FACE_PRIMVARS,
    RATES,
)
from featherfx.usd.write.layers import (
    SCOPES,
    CacheLayers,
    StageInfo,
    ValueClips,
    export_beside,
    finish_layers,
    new_layer,
    output_errors,
    publish,
)
from featherfx.usd.write.output import AttributeKey, CacheForm, prim_name, unique_prim_names
from featherfx.usd.write.posed_groups import PosedGroup, WrittenPose
from featherfx.usd.write.poses import Written
from featherfx.usd.write.unfinished_cache import (
    MANIFEST,
    ChunkRecord,
    Parts,
    chunk_error,
    compute_checksum,
)

_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    BARB_DIRECTION: Sdf.ValueTypeNames.Vector3fArray,
    ACCELERATIONS: Sdf.ValueTypeNames.Vector3fArray,
    ORIENT_PRIMVAR: Sdf.ValueTypeNames.QuathArray,
    DETAIL_ATTRIBUTE: Sdf.ValueTypeNames.IntArray,
    **dict.fromkeys(BARB_NODE_PRIMVARS, Sdf.ValueTypeNames.Point3fArray),
}
_TYPES |= {
    name: Sdf.ValueTypeNames.FloatArray for name in PER_FACE_PRIMVARS if name != BARB_DIRECTION
}
_INTERPOLATION = dict.fromkeys(("normals", ORIENT_PRIMVAR, *BARB_NODE_PRIMVARS), "vertex")
_INTERPOLATION |= dict.fromkeys(PER_FACE_PRIMVARS, "uniform")


class AnimatedPrims:
    """The animated prims of a cache, and how a pose becomes their values.

    groups: the feathers of each mesh, or of curves where there is none. prims: per group, the path
    of each drawn part. form: written attributes. paths: per group, paths of these.
    """

    def __init__(
        self,
        groups: Sequence[PosedGroup],
        prims: Sequence[Mapping[str, Any]],
        form: CacheForm = CacheForm(),
    ) -> None:
        self.groups, self.prims, self.form = groups, prims, form
        self.paths: list[dict[AttributeKey, Any]] = [
            {
                (part, name): own[part].AppendProperty(name)
                for part, name in group.keys
                if part in own and form.writes((part, name))
            }
            for group, own in zip(groups, prims, strict=True)
        ]

    @staticmethod
    def of_cache(groups: Sequence[PosedGroup], root: Any, form: CacheForm) -> AnimatedPrims:
        """Return the prims of a cache. root: path of the prim above all."""
        prims: list[dict[str, Any]] = [{} for _ in groups]
        for part, (scope, end) in SCOPES.items():
            names = unique_prim_names([group.name + end for group in groups])
            for group, own, name in zip(groups, prims, names, strict=True):
                if part in group.parts and part in form.parts:
                    own[part] = root.AppendPath(f"{scope}/{name}")
        return AnimatedPrims(groups, prims, form)

    def create(self, layer: Any, index: int, key: AttributeKey) -> Any:
        """Return the attribute in a layer, as an over where the layer does not define the prim."""
        path = self.paths[index][key]
        name = path.name
        attribute = layer.GetAttributeAtPath(path)
        if attribute:
            return attribute
        Sdf.JustCreatePrimAttributeInLayer(layer, path, _TYPES[name])
        attribute = layer.GetAttributeAtPath(path)
        if name in _INTERPOLATION:
            attribute.SetInfo("interpolation", _INTERPOLATION[name])
        if name in BARB_NODE_PRIMVARS:
            attribute.SetInfo("elementSize", self.groups[index].columns)
        return attribute

    def author_defaults(self, layer: Any, index: int, pose: WrittenPose) -> None:
        """Author one pose of a group as default values, without rates."""
        for key in self.paths[index]:
            if key[1] not in RATES:
                self.create(layer, index, key).default = pose.values[key].value

    def author_sample(
        self, layer: Any, index: int, codes: Sequence[float], pose: WrittenPose
    ) -> None:
        """Author one pose of a group at time codes, in a layer that has the attributes."""
        paths, store = self.paths[index], layer.SetTimeSample
        for key, path in paths.items():
            array = pose.values[key].value
            for code in codes:
                store(path, code, array)


@dataclass
class _ChunkPoses:
    """Poses of the current chunk, of each group of feathers.

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
    """A chunk beside its target; finish makes it count as written."""

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
            size, crc = compute_checksum(self.file.temporary)
            self.file.publish()
        return ChunkRecord(self.codes, size, crc, self.constant, self.first, self.low, self.high)


class WrittenSamples(Protocol):
    """Samples of an earlier cache."""

    def fill(self, feather: str, code: float, out: Written) -> None:
        """Write the values of a feather, by its id, at a time code."""


class ChunkWriter:
    """Writer of chunks: collects poses, then writes them.

    seconds: between two samples. Within a chunk every group of feathers that is not static has
    samples at every code. A group that repeats its first pose has the same value at all of them,
    which a crate file stores once.
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
        self._taken: dict[int, WrittenSamples] = {}
        self._run = self._new_run()

    @property
    def count(self) -> int:
        """Return the poses collected so far."""
        return len(self._run.codes)

    def take_over(self, earlier: WrittenSamples, feathers: Sequence[int]) -> None:
        """Read the poses of some feathers from an earlier cache; frames come without these."""
        self._taken |= dict.fromkeys(feathers, earlier)
        left = [number for number in sorted(self._place) if number not in self._taken]
        self._place |= {number: place for place, number in enumerate(left)}

    def add(self, code: float, frame: Frame) -> list[int]:
        """Add the pose at the next time code; return feathers with values that are not finite.

        The chunk is invalid after such feathers.
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
        """Write the values of a frame, or of an earlier cache, to the pose of a group."""
        group = self._prims.groups[index]
        given: list[FeatherPose | None] = []
        for k, number in enumerate(group.members):
            earlier = self._taken.get(number)
            if earlier is not None and not group.static[k]:
                earlier.fill(group.feathers[k].id, code, group.own(pose, k))
            given.append(None if earlier is not None else frame.poses[self._place[number]])
        group.evaluate(pose, given)

    def write(self, path: Path) -> WrittenChunk:
        """Write the chunk beside its path, read it back, and start the next one."""
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

    def _new_run(self) -> _ChunkPoses:
        with Sdf.ChangeBlock():
            for attribute in self._attributes:
                attribute.ClearInfo("timeSamples")
        if hasattr(self, "_run"):
            for spare, kept in zip(self._spare, self._run.kept, strict=True):
                spare += kept
        groups = self._prims.groups
        moved = [np.zeros(len(group.members), dtype=np.bool_) for group in groups]
        return _ChunkPoses(moved, [None] * len(groups), [[] for _ in groups])


def assemble_cache(
    layers: CacheLayers,
    info: StageInfo,
    prims: AnimatedPrims,
    path: Path,
    parts: Parts | None,
    before: Mapping[Path, Standing],
    pictures: Iterable[tuple[Path, Store]],
) -> None:
    """Complete the layers from the chunks and publish the cache; the root is written last.

    pictures: files beside the layers, as of write_all. parts: None for a cache without time.
    before: state of the cache's files when the work began; nothing else is replaced. The rest pose
    becomes the default of all attributes. A group that keeps one other pose throughout has that
    pose as its default and no samples. Raises OutputError where a chunk is damaged, or a file
    cannot be written.
    """
    clips, chunks = None, []
    records = parts.records if parts else []
    static = np.array([group.is_static for group in prims.groups], dtype=np.bool_)
    # groups with more than one pose over all chunks have samples
    moving = np.zeros(len(static), dtype=np.bool_)
    for record in records:
        moving |= np.array([flag == "0" for flag in record.constant])
        moving |= np.array(record.first) != np.array(records[0].first)
    moving &= ~static
    corners: list[Floats] = []
    with Sdf.ChangeBlock():
        for index, group in enumerate(prims.groups):
            layer = layers.animation if moving[index] else layers.topology
            rest = group.rest()
            prims.author_defaults(layer, index, rest)
            corners += rest.corners()
    low, high = np.min(corners, axis=0)[0], np.max(corners, axis=0)[1]
    if parts:
        low = np.minimum(low, np.min([record.low for record in records], axis=0))
        high = np.maximum(high, np.max([record.high for record in records], axis=0))
        _author_still_poses(layers.topology, prims, ~moving & ~static, parts)
        if layers.layout == "clips":
            clips = _prepare_clips(path.stem, info, prims, moving, parts)
        else:
            chunks = _copy_samples(layers.animation, prims, moving, parts)
    publish(finish_layers(layers, info, path, (low, high), clips), before, pictures)
    if chunks:
        layers.animation.Clear()  # before the chunks are closed


def _author_still_poses(layer: Any, prims: AnimatedPrims, still: Any, parts: Parts) -> None:
    chunk, code = _open_checked(parts, 0), parts.records[0].codes[0]
    with Sdf.ChangeBlock():
        for index in np.flatnonzero(still):
            for key, path in prims.paths[index].items():
                if key[1] not in RATES:
                    value = chunk.QueryTimeSample(path, code)
                    prims.create(layer, int(index), key).default = value


def _copy_samples(layer: Any, prims: AnimatedPrims, moving: Any, parts: Parts) -> list[Any]:
    """Copy samples of all chunks; return the open chunks.

    While they are open their values are pages of their files, which the system can reclaim. Closed,
    all values would be copied.
    """
    chunks = []
    for index in np.flatnonzero(moving):
        for key in prims.paths[index]:
            prims.create(layer, int(index), key)
    for number, record in enumerate(parts.records):
        chunks.append(chunk := _open_checked(parts, number))
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(moving):
                for path in prims.paths[index].values():
                    for code in record.codes:
                        layer.SetTimeSample(path, code, chunk.QueryTimeSample(path, code))
    return chunks


def _prepare_clips(
    name: str, info: StageInfo, prims: AnimatedPrims, moving: Any, parts: Parts
) -> ValueClips | None:
    """Return the checked chunks as clips; None where nothing moves."""
    if not moving.any():
        return None
    for number in range(len(parts.records)):
        _open_checked(parts, number)
    manifest, path = new_layer(info), parts.folder / MANIFEST
    for index in np.flatnonzero(moving):
        for key in prims.paths[index]:
            prims.create(manifest, int(index), key)
    publish([(manifest, path)])
    moved = (each for index in np.flatnonzero(moving) for each in prims.paths[index].values())
    scopes = sorted({each.GetPrefixes()[1] for each in moved})
    codes = [record.codes for record in parts.records]
    return ValueClips(
        name=prim_name(name),
        manifest=path,
        files=[parts.chunk(number) for number in range(len(codes))],
        starts=[each[0] for each in codes],
        end=codes[-1][-1],
        scopes=scopes,
    )


def _open_checked(parts: Parts, number: int) -> Any:
    """Return a chunk's layer after a check of its size and time codes."""
    path, record = parts.chunk(number), parts.records[number]
    chunk = None
    with contextlib.suppress(OSError, Tf.ErrorException):
        if path.stat().st_size == record.bytes:
            chunk = Sdf.Layer.OpenAsAnonymous(str(path))  # values are read on demand
    ends = record.codes[0], record.codes[-1]
    if chunk is None or (chunk.startTimeCode, chunk.endTimeCode) != ends:
        raise chunk_error(path)
    return chunk
