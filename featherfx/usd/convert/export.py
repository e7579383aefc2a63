"""A cache as mesh sequences, for a quick look."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import trimesh

from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import into, standing, write_all
from featherfx.phases import counted
from featherfx.usd.read.read import Cache
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import file_problems

MESH_SUFFIXES = (".glb", ".obj", ".ply", ".stl")


# of exported meshes, red, green, blue, opacity of 255
COLOUR = (230, 220, 200, 255)


def mesh_sequence(
    path: str | Path,
    output: str | Path,
    frames: Sequence[float] | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write a file per frame for a quick look, with one mesh per feather, and return the files.

    output: .glb, .obj, .ply or .stl; wing.glb gives wing.0001.glb and so on; a cache without time
    gives the one file. frames: time codes, by default every whole one. glTF is in metres with y
    up, as it has to be; the others keep the stage's units and axes. All files appear, or none.
    Raises InputError.
    """
    cache, output = Cache(path), Path(output)
    codes = codes_of(cache, frames)
    files = [_numbered(output, code) for code in codes]
    problems = file_problems(files or [output], overwrite)
    if output.suffix not in MESH_SUFFIXES:
        message = f"suffix '{output.suffix}' is not one of .abc, {', '.join(MESH_SUFFIXES)}"
        problems.append(Problem(str(output), "", message))
    if problems:
        raise OutputError(*problems)
    before = {file: standing(file) for file in files}

    def put(file: BinaryIO, code: float | None) -> None:
        content = _scene(cache, code, output.suffix == ".glb").export(file_type=output.suffix[1:])
        file.write(content.encode() if isinstance(content, str) else content)

    try:
        each = counted("writing", zip(files, codes, strict=True), len(files))
        write_all(((file, into(partial(put, code=code))) for file, code in each), before)
    except OSError as error:
        message = f"not written: {error.strerror or error}"
        raise OutputError(Problem(str(error.filename), "", message)) from error
    return files


def codes_of(cache: Cache, frames: Sequence[float] | None) -> list[float | None]:
    """Time codes of a sequence; None for a cache without time. Raises InputError."""
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
        message = f"{outside[0]:g} is out of range; allowed {first:g} to {last:g}"
        raise InputError(Problem("frames", "", message))
    return [float(code) for code in frames]


def _numbered(output: Path, code: float | None) -> Path:
    if code is None:
        return output
    whole, part = divmod(code, 1.0)
    number = f"{int(whole):04d}" + (f"_{round(1000 * part):03d}" if part else "")
    return output.with_name(f"{output.stem}.{number}{output.suffix}")


def _scene(cache: Cache, code: float | None, as_gltf: bool) -> Any:
    matrix = to_gltf(cache) if as_gltf else np.eye(3)
    scene = trimesh.Scene()
    for index, feather in enumerate(cache.feathers):
        pose = cache.pose(index, code)
        normals = None if pose.normals is None else pose.normals @ _rotation(matrix).T
        # unprocessed: merging points would give another mesh in every frame
        mesh = trimesh.Trimesh(
            pose.points @ matrix.T, feather.triangles, vertex_normals=normals, process=False
        )
        if feather.st is not None:
            # a material of its own, because trimesh's default one needs Pillow
            material = trimesh.visual.material.PBRMaterial(baseColorFactor=COLOUR)
            mesh.visual = trimesh.visual.TextureVisuals(uv=feather.st, material=material)
        scene.add_geometry(mesh, node_name=feather.name, geom_name=feather.name)
    return scene


def to_gltf(cache: Cache) -> Any:
    """(3, 3) stage to glTF: metres, y up."""
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) if cache.up_axis == "Z" else np.eye(3)
    return turn * cache.meters_per_unit


def _rotation(matrix: Any) -> Any:
    return matrix / np.cbrt(np.linalg.det(matrix))
