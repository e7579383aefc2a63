"""Export to mesh files: a file per frame, or one animated glTF file for the web.

The animated file is a mesh whose morph targets are its frames. The mesh is the first frame; target
k is the difference of frame k + 1, and the weights change linearly from one to the next. There are
no normals, which morph targets would double, so that faces are shaded flat.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import trimesh
from numpy.typing import NDArray

from featherfx._version import __version__
from featherfx.algebra.types import Floats, Indices
from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import into, standing, write_all
from featherfx.phases import counted
from featherfx.usd.read.cache import Cache
from featherfx.usd.types import OutputError, StageSpace
from featherfx.usd.write.layers import output_errors
from featherfx.usd.write.output import USD_SUFFIXES, find_file_problems

MESH_SUFFIXES = (".glb", ".obj", ".ply", ".stl")


# of exported meshes, red, green, blue, opacity of 255
_BASE_COLOUR = (230, 220, 200, 255)


def mesh_sequence(
    path: str | Path,
    output: str | Path,
    frames: Sequence[float] | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write one file per frame with one mesh per feather, and return the files.

    output: .glb, .obj, .ply or .stl; wing.glb gives wing.0001.glb and so on; a cache without time
    gives the one file. frames: time codes; default: every whole one. glTF is in metres with y up;
    the others keep the stage's units and axes. All files appear, or none. Raises InputError.
    """
    cache, output = Cache(path), Path(output)
    codes = choose_time_codes(cache, frames)
    files = [_numbered(output, code) for code in codes]
    problems = find_file_problems(files or [output], overwrite)
    if output.suffix not in MESH_SUFFIXES:
        known = ", ".join((*USD_SUFFIXES, ".abc", *MESH_SUFFIXES))
        message = f"suffix '{output.suffix}' is not one of {known}"
        problems.append(Problem(str(output), "", message))
    if problems:
        raise OutputError(*problems)
    before = {file: standing(file) for file in files}

    def put(file: BinaryIO, code: float | None) -> None:
        content = _scene(cache, code, output.suffix == ".glb").export(file_type=output.suffix[1:])
        file.write(content.encode() if isinstance(content, str) else content)

    with output_errors():
        each = counted("writing", zip(files, codes, strict=True), len(files))
        write_all(((file, into(partial(put, code=code))) for file, code in each), before)
    return files


def choose_time_codes(cache: Cache, frames: Sequence[float] | None) -> list[float | None]:
    """Return time codes of a sequence; [None] for a cache without time. Raises InputError."""
    if not cache.has_frames:
        return [None]
    first, last = cache.frames
    if frames is None:
        whole = cache.whole_frames()
        if not whole:
            message = f"is {last:g}, no whole frame lies between it and startTimeCode, {first:g}"
            raise InputError(Problem(str(cache.path), "endTimeCode", message))
        return [*whole]
    outside = [code for code in frames if not first <= code <= last]
    if outside:
        given = f"{frames[0]:g} to {frames[-1]:g}"
        message = f"{given} is out of range. Give frames from {first:g} to {last:g}"
        raise InputError(Problem("frames", "", message))
    return [float(code) for code in frames]


def _numbered(output: Path, code: float | None) -> Path:
    if code is None:
        return output
    whole, part = divmod(code, 1.0)
    number = f"{int(whole):04d}" + (f"_{round(1000 * part):03d}" if part else "")
    return output.with_name(f"{output.stem}.{number}{output.suffix}")


def _scene(cache: Cache, code: float | None, as_gltf: bool) -> Any:
    matrix = gltf_matrix(cache) if as_gltf else np.eye(3)
    rotation, scene = matrix / np.cbrt(np.linalg.det(matrix)), trimesh.Scene()
    for index, feather in enumerate(cache.feathers):
        pose = cache.pose(index, code)
        normals = None if pose.normals is None else pose.normals @ rotation.T
        # unprocessed: merging points would give another mesh in every frame
        mesh = trimesh.Trimesh(
            pose.points @ matrix.T, feather.triangles, vertex_normals=normals, process=False
        )
        if feather.st is not None:
            # a material of its own, because trimesh's default one needs Pillow
            material = trimesh.visual.material.PBRMaterial(baseColorFactor=_BASE_COLOUR)
            mesh.visual = trimesh.visual.TextureVisuals(uv=feather.st, material=material)
        scene.add_geometry(mesh, node_name=feather.name, geom_name=feather.name)
    return scene


def gltf_matrix(cache: Cache) -> Any:
    """Return the (3, 3) matrix from the stage to glTF: metres, y up."""
    y_up = StageSpace(1.0, "Y").to_world if cache.up_axis == "Z" else np.eye(3)
    return y_up * cache.meters_per_unit


# of the points of all frames; players hold them in memory
_MAX_MORPH_BYTES = 1_000_000_000
# glTF's own numbers: float32 and uint32 values, arrays of points, and of indices
_FLOAT, _WHOLE = 5126, 5125
_POINTS, _INDICES = 34962, 34963


def export_morph(
    path: str | Path,
    output: str | Path,
    frames: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the meshes of a cache as one .glb file; it appears complete or not at all.

    frames: first and last, by default all; two at least. Metres, y up. Raises InputError where the
    cache cannot be read, has too few frames or too many points, or the file cannot be written.
    """
    cache, output = Cache(path), Path(output)
    codes = choose_time_codes(cache, range(frames[0], frames[1] + 1) if frames else None)
    problems = find_file_problems([output], overwrite)
    counts = [len(points) for points in cache.points_of(range(len(cache.feathers)), codes[0])]
    if len(codes) < 2:
        problems.append(
            Problem(str(path), "frames", f"{len(codes)} is too few. Morph targets need 2 at least")
        )
    elif (size := 12 * len(codes) * sum(counts)) > _MAX_MORPH_BYTES:
        told = (
            f"{len(codes)} of {sum(counts)} points are {size / 1e9:.2g} GB, more than 1. Take fewer"
        )
        problems.append(Problem(str(path), "frames", told))
    if problems:
        raise OutputError(*problems)
    before = {output: standing(output)}
    content = _gltf_content(cache, [float(code) for code in codes if code is not None], counts)
    with output_errors():
        write_all([(output, into(lambda file: file.writelines(content)))], before)
    return output


class _GltfBuffer:
    """The binary part of a glTF file, and the records that describe it."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(self, values: NDArray[Any], kind: str, target: int | None = None) -> int:
        """Add an array and return its accessor's number. kind: SCALAR or VEC3."""
        content = values.tobytes()  # of 4-byte numbers, so that all begin at multiples of 4
        view = {"buffer": 0, "byteOffset": self.size, "byteLength": len(content)}
        self.views.append(view if target is None else view | {"target": target})
        self.parts.append(content)
        self.size += len(content)
        rows = values.reshape(len(values), -1)
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": _FLOAT if values.dtype == np.float32 else _WHOLE,
                "count": len(values),
                "type": kind,
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1


def _gltf_content(cache: Cache, codes: list[float], counts: list[int]) -> list[bytes]:
    arrays, starts = _GltfBuffer(), np.cumsum([0, *counts])
    primitive = _primitive(arrays, cache, codes, starts)
    coloured = "COLOR_0" in primitive["attributes"]
    plain = [1.0] * 4 if coloured else [each / 255 for each in _BASE_COLOUR]
    finish = {"baseColorFactor": plain, "metallicFactor": 0.0, "roughnessFactor": 0.65}
    told = [
        {"id": f.id, "kind": f.kind, "region": f.region, "first": int(k), "points": n}
        for f, k, n in zip(cache.feathers, starts, counts, strict=False)
    ]
    head = {
        "asset": {"version": "2.0", "generator": f"featherfx {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "feathers", "extras": {"feathers": told}}],
        "meshes": [{"primitives": [primitive], "weights": [0.0] * (len(codes) - 1)}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": finish}],
        "animations": [_animation(arrays, codes, cache.frames_per_second)],
        "accessors": arrays.accessors,
        "bufferViews": arrays.views,
        "buffers": [{"byteLength": arrays.size}],
    }
    text = json.dumps(head, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return [
        struct.pack("<4sII", b"glTF", 2, 28 + len(text) + arrays.size),
        struct.pack("<I4s", len(text), b"JSON"),
        text,
        struct.pack("<I4s", arrays.size, b"BIN\0"),
        *arrays.parts,
    ]


def _primitive(
    arrays: _GltfBuffer, cache: Cache, codes: list[float], starts: Indices
) -> dict[str, Any]:
    """Return all feathers at the first code, with the displacements at the others as targets."""
    turn, every = gltf_matrix(cache).T, range(len(starts) - 1)

    def points(code: float) -> Floats:
        return (np.concatenate(cache.points_of(every, code)) @ turn).astype(np.float32)

    first = points(codes[0])
    corners = [f.triangles + k for f, k in zip(cache.feathers, starts, strict=False)]
    indices = np.concatenate(corners).astype(np.uint32).ravel()
    attributes = {"POSITION": arrays.add(first, "VEC3", _POINTS)}
    colours = [f.colour for f in cache.feathers]
    known = [np.asarray(each, dtype=np.float32) for each in colours if each is not None]
    if len(known) == len(colours):
        attributes["COLOR_0"] = arrays.add(np.concatenate(known), "VEC3", _POINTS)
    return {
        "attributes": attributes,
        "indices": arrays.add(indices, "SCALAR", _INDICES),
        "material": 0,
        "targets": [
            {"POSITION": arrays.add(points(code) - first, "VEC3", _POINTS)} for code in codes[1:]
        ],
    }


def _animation(arrays: _GltfBuffer, codes: list[float], frames_per_second: float) -> dict[str, Any]:
    """Return the animation that shows each code's target at its time, linear in between."""
    times = (np.array(codes) - codes[0]) / frames_per_second
    weights = np.eye(len(codes), dtype=np.float32)[:, 1:].ravel()
    sampler = {
        "input": arrays.add(times.astype(np.float32), "SCALAR"),
        "output": arrays.add(weights, "SCALAR"),
        "interpolation": "LINEAR",
    }
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    return {"samplers": [sampler], "channels": [channel]}
