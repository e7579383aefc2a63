"""Files and prims of an output, and checks that they can be written; needs no USD.

The prims of a cache depend on its form:

    form        feathers (meshes)   rachises (curves)      barbs (curves, where N are asked for)
    mesh        yes                 yes                    yes
    curves                          yes                    yes
    condensed                       with barbs as arrays
    both        yes                 with barbs as arrays   yes

forms.py describes condensed feathers.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from featherfx.errors import CONTROL, Problem
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    BARB_PRIM,
    DETAIL_ATTRIBUTE,
    DIAGNOSTICS,
    HOOK_PRIMVARS,
    MESH_PRIM,
    ORIENT_PRIMVAR,
    RACHIS_PRIM,
    RATES,
    WET_PRIMVARS,
    FeatherEntry,
    OutputError,
)
from featherfx.usd.write.options import (
    AS_ONE,
    BOTH_FORMS,
    BY_FEATHER,
    BY_REGION,
    CONDENSED_FORM,
    CURVES_FORM,
    LAYOUTS,
    WriteOptions,
)

USD_SUFFIXES = (".usd", ".usda", ".usdc")
_INPUT_SUFFIXES = (*USD_SUFFIXES, ".usdz")
# of a file's name: file systems take 255, and those of parts beside it have up to 32 more
_MAX_NAME_BYTES = 220
# Samples beyond this many bytes go to clips where the layout is left to the writer.
_MAX_FLAT_BYTES = 256_000_000


def choose_layout(layout: str, sample_bytes: int) -> str:
    """Return the layout itself, or for "auto" the one that suits so many bytes of samples."""
    if layout != "auto":
        return layout
    return "clips" if sample_bytes > _MAX_FLAT_BYTES else "flat"


def output_files(path: Path, layout: str) -> list[Path]:
    """Return every file that is published at the end, in order; the root is last.

    "flat": the one file. "payload": animation, topology (the payload), root. "clips": topology and
    root; the clips stand in clips_folder.
    """
    topology = path.with_name(f"{path.stem}.payload.usdc")
    match layout:
        case "payload":
            return [path.with_name(f"{path.stem}.animation.usdc"), topology, path]
        case "clips":
            return [topology, path]
    return [path]


def clips_folder(path: Path) -> Path:
    """Return the folder of the clips of a cache."""
    return path.with_name(f"{path.stem}.clips")


def parts_folder(path: Path, layout: str) -> Path:
    """Return the folder of finished chunks while a cache is being written."""
    return clips_folder(path) if layout == "clips" else path.with_name(f".{path.name}.parts")


def check_output(path: str | Path, overwrite: bool = False, layout: str = "flat") -> Path:
    """Return path as a Path if a cache can be written there.

    Raises OutputError with every problem: unknown suffix or layout, missing folder, folder that
    cannot be written to, a file that exists (unless overwrite) or a folder in its place.
    """
    path = Path(path)
    source = str(path)
    if not path.name or CONTROL.search(path.name):
        raise OutputError(
            Problem(source, "", "is no name of a file. Give one with a suffix such as .usdc")
        )
    problems = []
    if path.suffix not in USD_SUFFIXES:
        problems.append(
            Problem(source, "", f"suffix '{path.suffix}' is not one of {', '.join(USD_SUFFIXES)}")
        )
    if layout not in LAYOUTS:
        problems.append(Problem(source, "layout", f"'{layout}' is not one of {', '.join(LAYOUTS)}"))
    try:
        os.path.abspath(path).encode()
    except UnicodeEncodeError:
        message = "has letters that this locale does not know. Set LC_ALL=C.UTF-8 or PYTHONUTF8=1"
        raise OutputError(*problems, Problem(ascii(source), "", message)) from None
    problems += find_file_problems(output_files(path, layout), overwrite)
    if problems:
        raise OutputError(*problems)
    return path


def find_file_problems(files: Sequence[Path], overwrite: bool) -> list[Problem]:
    """Return reasons why files of one folder cannot be written; empty if they can."""
    problems = []
    size = len(os.fsencode(files[-1].name))
    if size > _MAX_NAME_BYTES:
        message = f"its name takes {size} bytes. Give one of at most {_MAX_NAME_BYTES}"
        problems.append(Problem(f"{str(files[-1])[:60]}...", "", message))
    for file in files:
        # os.path.* answer False where a Path method would raise (a parent that is a file).
        if os.path.isdir(file):
            problems.append(Problem(str(file), "", "is a folder. Give the name of a file"))
        elif os.path.exists(file) and not os.path.isfile(file):
            message = "is no regular file, but a device, pipe or socket. Give another name"
            problems.append(Problem(str(file), "", message))
        elif "\\" in file.name:
            # USD takes it for a slash
            problems.append(Problem(str(file), "", "has a backslash in its name. Leave it out"))
        elif os.path.lexists(file) and not overwrite:
            message = "exists already. Choose another name or --overwrite"
            problems.append(Problem(str(file), "", message))
    return problems + _folder_problems(files[-1])


def refuse_inputs(outputs: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Raise OutputError for every output that is an input, or a layer that one is made of.

    inputs: files that are read, and folders of presets.
    """
    existing = [path for path in outputs if path.is_file()]
    if not existing:
        return
    files = [file for path in dict.fromkeys(inputs) for file in _files_of(path) if file.is_file()]
    problems = [
        Problem(str(path), "", "is an input of this work. Choose another name")
        for path in existing
        if any(os.path.samefile(path, file) for file in files)
    ]
    if problems:
        raise OutputError(*problems)


def _files_of(path: Path, known: frozenset[Path] = frozenset()) -> Iterator[Path]:
    """Yield a file and all that it names: layers at any depth, clips and textures of a USD file,
    the files that a groom, shot or preset names; of a folder its presets. known: seen on the way.
    """
    yield path
    if path.is_dir():
        yield from path.rglob("*.toml")
    elif path.suffix.lower() in _INPUT_SUFFIXES:
        from pxr import Tf, UsdUtils  # 4 MiB, which a bake without such files does without

        with contextlib.suppress(
            Tf.ErrorException, UnicodeDecodeError, RuntimeError, OverflowError
        ):
            # what a broken file names is not read either
            layers, assets, _ = UsdUtils.ComputeAllDependencies(str(path))
            yield from (Path(layer.realPath) for layer in layers)
            yield from map(Path, assets)
    elif path.suffix.lower() == ".toml" and path.is_file():
        known |= {path.resolve()}
        with contextlib.suppress(OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
            for name in _texts_in(tomllib.loads(path.read_text(encoding="utf-8"))):
                named = path.parent / name
                if os.path.isfile(named) and named.resolve() not in known:
                    yield from _files_of(named, known)


def _texts_in(value: Any) -> Iterator[str]:
    """Yield all texts of a TOML document that may be names of files."""
    if isinstance(value, str) and "\0" not in value:
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts_in(each)


def _folder_problems(path: Path) -> list[Problem]:
    """Return reasons why a file's folder cannot be written to; empty if it can."""
    folder = path.parent
    if not os.path.isdir(folder):
        exists = os.path.lexists(folder)
        return [
            Problem(
                str(folder),
                "",
                "is not a folder. Name another"
                if exists
                else "folder does not exist. Make it first",
            )
        ]
    try:
        # Only an attempt tells: permission bits say nothing about mounts, quotas or root.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return [Problem(str(folder), "", f"cannot write to this folder: {error.strerror}")]
    return []


def prim_name(text: str) -> str:
    """Return a valid ASCII prim name: every other character becomes "_"; never empty."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text) or "_"
    return f"_{name}" if name[0].isdigit() else name


def unique_prim_names(ids: Sequence[str]) -> list[str]:
    """Return one prim name per id, all different and the same for the same ids in order.

    Ids that are valid names keep them; where sanitised ids collide, the later ones get _2, _3...
    """
    names = [prim_name(text) for text in ids]
    taken = {name for name, text in zip(names, ids, strict=True) if name == text}
    counts: dict[str, int] = {}
    for index, (name, text) in enumerate(zip(names, ids, strict=True)):
        if name == text:
            continue
        candidate, count = name, counts.get(name, 1)
        while candidate in taken:
            count += 1
            candidate = f"{name}_{count}"
        counts[name] = count  # those below are taken
        taken.add(candidate)
        names[index] = candidate
    return names


# Feathers that each have prims of their own where that is left to the writer; readers are slow with
# thousands of prims side by side.
_MAX_SINGLE = 200

# part of a feather, and attribute
AttributeKey = tuple[str, str]

_PARTS = {CURVES_FORM: (RACHIS_PRIM, BARB_PRIM), CONDENSED_FORM: (RACHIS_PRIM,)}


@dataclass(frozen=True)
class CacheForm:
    """Form of the feathers in a cache.

    parts: the prims of each feather. condensed: whether rachises carry barbs, and thinned: half of
    their rows and nodes. rates: whether velocities and accelerations are written.
    """

    parts: tuple[str, ...] = (MESH_PRIM, RACHIS_PRIM, BARB_PRIM)
    condensed: bool = False
    rates: bool = True
    thinned: bool = False

    @staticmethod
    def of(options: WriteOptions) -> CacheForm:
        parts = _PARTS.get(options.form, CacheForm.parts)
        return CacheForm(
            parts,
            condensed=options.form in (CONDENSED_FORM, BOTH_FORMS),
            rates=options.rates != "none",
            thinned=options.form == CONDENSED_FORM,
        )

    def writes(self, key: AttributeKey) -> bool:
        """Return whether an attribute of a part of feathers is written."""
        return key[0] in self.parts and (self.rates or key[1] not in RATES)


class AttributeKeys(NamedTuple):
    """Attributes of a feather, by their values: vectors, numbers, rotations, integers.

    wet: numbers of feathers that are wet at times.
    """

    vectors: tuple[AttributeKey, ...]
    scalars: tuple[AttributeKey, ...]
    turns: tuple[AttributeKey, ...]
    whole: tuple[AttributeKey, ...]
    wet: tuple[AttributeKey, ...]


@cache
def find_keys(
    parts: tuple[str, ...],
    extras: frozenset[str],
    form: CacheForm,
    faces: bool,
    hooks: bool,
    wet: bool,
) -> AttributeKeys:
    """Return the attributes of feathers with these parts; equal feathers share them.

    extras: ACCELERATIONS, names of DIAGNOSTICS. faces: whether there are any. hooks, wet: whether
    their state is written.
    """
    each = ("points", "velocities", *([ACCELERATIONS] * (ACCELERATIONS in extras)))
    asked = [name for extra, names in DIAGNOSTICS.items() if extra in extras for name in names]
    asked += HOOK_PRIMVARS if hooks else ()
    shown = (MESH_PRIM, faces), (RACHIS_PRIM, form.condensed)
    clumps = tuple(
        (part, name) for part, is_shown in shown for name in WET_PRIMVARS if wet and is_shown
    )
    return AttributeKeys(
        vectors=(
            *((part, name) for part in parts for name in each),
            (MESH_PRIM, "normals"),
            *((part, "normals") for part in parts if part == BARB_PRIM),
            (MESH_PRIM, BARB_DIRECTION),
            *((RACHIS_PRIM, name) for name in BARB_NODE_PRIMVARS if form.condensed),
        ),
        scalars=(*((MESH_PRIM, name) for name in asked), *clumps),
        turns=((RACHIS_PRIM, ORIENT_PRIMVAR),) if form.condensed else (),
        whole=((RACHIS_PRIM, DETAIL_ATTRIBUTE),) if form.thinned else (),
        wet=clumps,
    )


class MeshGroup(NamedTuple):
    """Feathers of one mesh. name: of its prim. members: their numbers, in order."""

    name: str
    members: tuple[int, ...]


def choose_group(group: str | None, feathers: int) -> str:
    """Return the grouping of a cache: as given, else by region if feathers are many."""
    return group or (BY_REGION if feathers > _MAX_SINGLE else BY_FEATHER)


def group_feathers(
    entries: Sequence[FeatherEntry], group: str, part: str = "", condensed: bool = False
) -> list[MeshGroup]:
    """Return the groups of a cache, in the order of their first feathers.

    group: of GROUPINGS; feathers without a region go by their kind. part: suffix of the names,
    where the cache is a part of a larger one with the same groups. condensed: feathers of one group
    must have as many barb nodes, since a primvar has one element size; others are grouped by these.
    """
    if group == BY_FEATHER:
        names = unique_prim_names([entry.name or entry.id for entry in entries])
        return [MeshGroup(name, (number,)) for number, name in enumerate(names)]
    members: dict[str, list[int]] = {}
    first: dict[str, int] = {}
    for number, entry in enumerate(entries):
        label = (entry.region if group == BY_REGION else "") or entry.kind
        label = AS_ONE if group == AS_ONE else label
        columns = entry.feather.columns
        if condensed and columns != first.setdefault(label, columns):
            label = f"{label}_{columns}"
        members.setdefault(label, []).append(number)
    names = unique_prim_names([f"{label}_{part}" if part else label for label in members])
    return [MeshGroup(*each) for each in zip(names, map(tuple, members.values()), strict=True)]
