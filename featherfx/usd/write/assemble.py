"""From finished chunks to a cache: defaults, samples or clips, then all files at once."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf

from featherfx.algebra.types import Flags, Floats
from featherfx.files.atomic_write import Standing, Store
from featherfx.usd.types import RATES
from featherfx.usd.write.chunk import open_chunk
from featherfx.usd.write.layout import CacheLayers, Clips, StageInfo, finish_layers, new_layer
from featherfx.usd.write.output import prim_name
from featherfx.usd.write.parts import MANIFEST, ChunkRecord, Parts, no_chunk
from featherfx.usd.write.publish import publish
from featherfx.usd.write.samples import AnimatedPrims


def assemble(
    layers: CacheLayers,
    info: StageInfo,
    prims: AnimatedPrims,
    path: Path,
    parts: Parts | None,
    before: Mapping[Path, Standing],
    pictures: Iterable[tuple[Path, Store]],
) -> None:
    """Complete the layers from the chunks and publish the cache; the root is written last.

    pictures: files beside the layers, as of write_all.
    parts: None for a cache without time. before: what stood at the cache's files when the work
    began; nothing else is replaced. The rest pose becomes the default of everything, but of a group
    of feathers that keeps one other pose throughout: it has that pose as its default and no
    samples. Raises OutputError where a chunk is not what was written, or a file cannot be.
    """
    clips, chunks = None, []
    records = parts.records if parts else []
    static = np.array([group.is_static for group in prims.groups], dtype=np.bool_)
    moving = _moving(records, static)
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
        _still_poses(layers.topology, prims, ~moving & ~static, parts)
        if layers.layout == "clips":
            clips = _clips(path.stem, info, prims, moving, parts)
        else:
            chunks = _copy_samples(layers.animation, prims, moving, parts)
    publish(finish_layers(layers, info, path, (low, high), clips), before, pictures)
    if chunks:
        layers.animation.Clear()  # before the chunks are closed


def _moving(records: Sequence[ChunkRecord], static: Flags) -> Flags:
    """(G,) which groups have samples: those with more than one pose over all chunks."""
    result = np.zeros(len(static), dtype=np.bool_)
    for record in records:
        result |= np.array([flag == "0" for flag in record.constant])
        result |= np.array(record.first) != np.array(records[0].first)
    return result & ~static


def _still_poses(layer: Any, prims: AnimatedPrims, still: Any, parts: Parts) -> None:
    chunk, code = _checked(parts, 0), parts.records[0].codes[0]
    with Sdf.ChangeBlock():
        for index in np.flatnonzero(still):
            for key, path in prims.paths[index].items():
                if key[1] not in RATES:
                    value = chunk.QueryTimeSample(path, code)
                    prims.create(layer, int(index), key).default = value


def _copy_samples(layer: Any, prims: AnimatedPrims, moving: Any, parts: Parts) -> list[Any]:
    """Returns the chunks: while they are open their values are pages of their files, which the
    system takes back when it needs them; closed, all values would be copied."""
    chunks = []
    for index in np.flatnonzero(moving):
        for key in prims.paths[index]:
            prims.create(layer, int(index), key)
    for number, record in enumerate(parts.records):
        chunks.append(chunk := _checked(parts, number))
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(moving):
                for path in prims.paths[index].values():
                    for code in record.codes:
                        layer.SetTimeSample(path, code, chunk.QueryTimeSample(path, code))
    return chunks


def _clips(
    name: str, info: StageInfo, prims: AnimatedPrims, moving: Any, parts: Parts
) -> Clips | None:
    """The chunks as clips; None where nothing moves. Each is looked at before the root names it."""
    if not moving.any():
        return None
    for number in range(len(parts.records)):
        _checked(parts, number)
    manifest, path = new_layer(info), parts.folder / MANIFEST
    for index in np.flatnonzero(moving):
        for key in prims.paths[index]:
            prims.create(manifest, int(index), key)
    publish([(manifest, path)])
    moved = (each for index in np.flatnonzero(moving) for each in prims.paths[index].values())
    scopes = sorted({each.GetPrefixes()[1] for each in moved})
    codes = [record.codes for record in parts.records]
    return Clips(
        name=prim_name(name),
        manifest=path,
        files=[parts.chunk(number) for number in range(len(codes))],
        starts=[each[0] for each in codes],
        end=codes[-1][-1],
        scopes=scopes,
    )


def _checked(parts: Parts, number: int) -> Any:
    """A chunk's layer, after a look at its size and time codes."""
    path, record = parts.chunk(number), parts.records[number]
    chunk = None
    with contextlib.suppress(OSError, Tf.ErrorException):
        if path.stat().st_size == record.bytes:
            chunk = open_chunk(path)
    ends = record.codes[0], record.codes[-1]
    if chunk is None or (chunk.startTimeCode, chunk.endTimeCode) != ends:
        raise no_chunk(path)
    return chunk
