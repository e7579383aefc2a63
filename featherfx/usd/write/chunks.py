"""Chunks of a cache: poses become samples, chunks become files, and finished chunks the cache.

A chunk is a run of frames in a file of its own. Poses are written to it as they come
(usd/write/crate.py), and then the attributes of every feather, of a layer that is made once.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf

from featherfx.algebra.types import Flags, Floats
from featherfx.files.atomic_write import Standing, Store, WrittenFile, begin_beside
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.arrays import limit_to_half
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    DETAIL_ATTRIBUTE,
    HALF_VELOCITIES,
    ORIENT_PRIMVAR,
    PER_FACE_PRIMVARS,
    RATES,
)
from featherfx.usd.write.crate import CrateFile, CrateLayer
from featherfx.usd.write.layers import (
    SCOPES,
    CacheLayers,
    StageInfo,
    ValueClips,
    check_samples,
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
    HALF_VELOCITIES: Sdf.ValueTypeNames.Vector3hArray,
    ORIENT_PRIMVAR: Sdf.ValueTypeNames.QuathArray,
    DETAIL_ATTRIBUTE: Sdf.ValueTypeNames.IntArray,
    **dict.fromkeys(BARB_NODE_PRIMVARS, Sdf.ValueTypeNames.Point3fArray),
}
_TYPES |= {
    name: Sdf.ValueTypeNames.FloatArray for name in PER_FACE_PRIMVARS if name != BARB_DIRECTION
}
_INTERPOLATION = dict.fromkeys(
    ("normals", ORIENT_PRIMVAR, HALF_VELOCITIES, *BARB_NODE_PRIMVARS), "vertex"
)
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
                (part, name): own[part].AppendProperty(
                    HALF_VELOCITIES if name == "velocities" and form.half else name
                )
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

    def numbers(self, index: int, key: AttributeKey, pose: WrittenPose) -> NDArray[Any]:
        """Return the numbers of an attribute of a pose of a group, as they are written."""
        found = pose.values[key].numbers
        return limit_to_half(found) if self.paths[index][key].name == HALF_VELOCITIES else found


@dataclass
class _ChunkPoses:
    """Poses of the current chunk, of each group of feathers that is sampled, by its number.

    file, crate: that they are written to. moved: (M,) which feathers have left their first pose.
    codes: of all poses. values: of each pose, what stands for its attributes in the file.
    """

    file: WrittenFile
    stream: BinaryIO
    crate: CrateFile
    moved: dict[int, Flags]
    values: dict[int, list[list[int]]]
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
    """Writer of chunks, pose by pose.

    seconds: between two samples. Within a chunk every group of feathers that is not static has
    samples at every code. A group that repeats its first pose has the same value at all of them,
    which is stored once.
    """

    def __init__(self, info: StageInfo, prims: AnimatedPrims, seconds: float) -> None:
        self._prims, self._seconds, groups = prims, seconds, prims.groups
        self._sampled = [k for k, group in enumerate(groups) if not group.is_static]
        self._layer = new_layer(info)
        with Sdf.ChangeBlock():
            for index in self._sampled:
                for key in prims.paths[index]:
                    prims.create(self._layer, index, key)
        self._paths = [path for index in self._sampled for path in prims.paths[index].values()]
        self._crate = CrateLayer(self._layer, self._paths)
        # of each group, the first pose of a chunk, and the last one
        self._first: dict[int, WrittenPose] = {}
        self._later: dict[int, WrittenPose] = {}
        self._place = {number: number for group in groups for number in group.members}
        self._taken: dict[int, WrittenSamples] = {}
        self._run: _ChunkPoses | None = None

    def take_over(self, earlier: WrittenSamples, feathers: Sequence[int]) -> None:
        """Read the poses of some feathers from an earlier cache; frames come without these."""
        self._taken |= dict.fromkeys(feathers, earlier)
        left = [number for number in sorted(self._place) if number not in self._taken]
        self._place |= {number: place for place, number in enumerate(left)}

    def add(self, code: float, frame: Frame, path: Path) -> list[int]:
        """Add the pose at the next time code; return feathers with values that are not finite.

        path: of the chunk, which is invalid after such feathers. Raises OutputError.
        """
        groups, is_first = self._prims.groups, self._run is None
        poses = {index: self._room(index, is_first) for index in self._sampled}
        for index, pose in poses.items():
            self._evaluate(index, pose, code, frame)
        bad = [k for index, pose in poses.items() for k in groups[index].not_finite(pose)]
        if bad:
            return bad
        with output_errors():
            run = self._run = self._run or self._begin(path)
            with run.file.filling():
                for index, pose in poses.items():
                    self._write_pose(run, index, pose)
        run.codes.append(code)
        return []

    def _room(self, index: int, is_first: bool) -> WrittenPose:
        """Return memory for a pose of a group."""
        known = self._first if is_first else self._later
        if index not in known:
            known[index] = self._prims.groups[index].new_pose(compared=is_first)
        return known[index]

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

    def _begin(self, path: Path) -> _ChunkPoses:
        """Begin a chunk."""
        file = begin_beside(path)
        with file.filling():
            stream = file.temporary.open("wb")
            groups = {index: self._prims.groups[index] for index in self._sampled}
            moved = {k: np.zeros(len(own.members), dtype=np.bool_) for k, own in groups.items()}
            return _ChunkPoses(
                file, stream, CrateFile(stream, self._crate), moved, {k: [] for k in groups}
            )

    def _write_pose(self, run: _ChunkPoses, index: int, pose: WrittenPose) -> None:
        prims, group, moved = self._prims, self._prims.groups[index], run.moved[index]
        values = run.values[index]
        group.hold(pose, self._first[index], moved, self._seconds)
        group.bound(pose)
        corners = pose.corners()
        run.low = np.minimum(run.low, np.min(corners, axis=0)[0])
        run.high = np.maximum(run.high, np.max(corners, axis=0)[1])
        if values and not moved.any():
            values.append(values[0])
        else:
            numbers = (prims.numbers(index, key, pose) for key in prims.paths[index])
            values.append([run.crate.add(each) for each in numbers])

    def write(self) -> WrittenChunk:
        """Complete the chunk, read it back, and start the next one. Raises OutputError."""
        run, prims = self._run, self._prims
        assert run is not None
        constant, digests = "", []
        for index, group in enumerate(prims.groups):
            stays, digest = index not in run.moved or not run.moved[index].any(), ""
            if stays and index in run.moved:
                first = self._first[index]
                stays, digest = group.is_at_rest(first), group.digest(first)
            constant += "01"[stays]
            digests.append(digest)
        samples = [each for k in self._sampled for each in zip(*run.values[k], strict=True)]
        with output_errors(), run.file.filling():
            run.crate.finish(run.codes, samples)
            run.stream.close()
        check_samples(run.file, self._layer, run.codes, self._last_numbers(run))
        self._run = None
        return WrittenChunk(
            file=run.file,
            codes=tuple(run.codes),
            constant=constant,
            first=tuple(digests),
            low=tuple(run.low.tolist()),
            high=tuple(run.high.tolist()),
        )

    def _last_numbers(self, run: _ChunkPoses) -> dict[Any, Callable[[], NDArray[Any]]]:
        """Return what gives the numbers of the last pose of each attribute, by its path."""
        prims = self._prims
        found: dict[Any, Callable[[], NDArray[Any]]] = {}
        for index in self._sampled:
            later = len(run.codes) > 1 and run.moved[index].any()
            pose = (self._later if later else self._first)[index]
            for key, path in prims.paths[index].items():
                found[path] = partial(prims.numbers, index, key, pose)
        return found

    def discard(self) -> None:
        """Remove the chunk that is not complete."""
        if self._run is not None:
            self._run.stream.close()
            self._run.file.discard()


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
