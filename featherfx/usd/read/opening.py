"""USD files: located by folder or asset resolver, opened from disk, and their metadata checked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from zipfile import ZipFile, is_zipfile

from pxr import Ar, Sdf, Usd, UsdGeom

from featherfx.errors import InputError, Problem, require
from featherfx.limits import irregular
from featherfx.usd.installed import refuse_unfit_usd
from featherfx.usd.read.values import USD_ERRORS, describe_error, describe_value
from featherfx.usd.write.options import UP_AXES


def locate_file(folder: Path, name: str) -> Path:
    """Return the path of a file that is named relative to a folder.

    An existing file is returned as seen from the folder, also with backslashes. Else the asset
    resolver of this process is asked, which knows search paths (PXR_AR_DEFAULT_SEARCH_PATH) and, in
    a studio, addresses such as asset:bird. Without an answer the path is as seen from the folder.
    """
    own = folder / name
    if own.exists():
        return own
    if "\\" in name and (other := folder / name.replace("\\", "/")).exists():
        return other  # as Windows writes it
    refuse_unfit_usd()
    resolver = Ar.GetResolver()
    beside = str(folder.absolute() / "shot.usda")  # need not be there
    context = resolver.CreateDefaultContextForAsset(beside)
    with Ar.ResolverContextBinder(context):
        asked = resolver.CreateIdentifier(name, Ar.ResolvedPath(beside))
        found = resolver.Resolve(asked).GetPathString()
    return Path(found) if found else own


def locate_package(path: Path) -> tuple[Path, str]:
    """Return the file on disk, and what is named in it: a.usdz and b.usda of a.usdz[b.usda]."""
    package, inner = Ar.SplitPackageRelativePathOuter(str(path))
    return Path(package), inner


# (low, high) of what a stage says of itself; far beyond any stage in use, far within float32
_METADATA_RANGES = {
    "metersPerUnit": (1e-9, 1e9),
    "timeCodesPerSecond": (1e-3, 1e9),
    "framesPerSecond": (1e-3, 1e9),
    "startTimeCode": (-1e9, 1e9),
    "endTimeCode": (-1e9, 1e9),
}


def open_stage(path: str | Path) -> Any:
    """Open a USD file with all payloads.

    Raises InputError if that fails, if layers form a cycle, and for invalid units, axis, rates and
    time range.
    """
    path = locate_file(Path(), str(path))
    file, inner = locate_package(path)
    if not file.is_file():
        fault = irregular(file)
        told = f"{fault}. Name a USD file" if fault else "there is no such file. Check the path"
        raise InputError(Problem(str(path), "", told))
    if not os.access(file, os.R_OK):
        raise InputError(Problem(str(path), "", "may not be read. Check its permissions"))
    if Sdf.FileFormat.FindByExtension(inner or str(path)) is None:
        told, more = "no USD file", ""
        if path.suffix == ".toml":
            told = "a TOML file: a groom, shot or preset"
            more = ". `featherfx groom` and `featherfx bake` write one"
        raise InputError(Problem(str(path), "", f"is {told}, expects .usd, .usda or .usdc{more}"))
    refuse_unfit_usd()
    if inner and is_zipfile(file):
        with ZipFile(file) as package:
            names = package.namelist()
        if Ar.SplitPackageRelativePathOuter(inner)[0] not in names:
            known = ", ".join(names) or "nothing"
            raise InputError(Problem(str(path), "", f"{file.name} has no {inner}. Give {known}"))
    opened = str(path)
    try:
        stage = Usd.Stage.Open(opened)
        # USD keeps layers that are open elsewhere in this process; the file may be newer. Layers
        # with edits that are not saved belong to the host, and are read as they stand there.
        for layer in stage.GetUsedLayers():
            if not layer.dirty:
                opened = layer.realPath or opened
                layer.Reload()
        opened = str(path)
        problems = [*_cycles(stage, opened), *_wrong_metadata(stage, opened)]
    except USD_ERRORS as error:
        problem = Problem(opened, "", f"USD cannot open it: {describe_error(error)}")
        raise InputError(problem) from error
    require(*problems)
    return stage


def _cycles(stage: Any, path: str) -> Iterator[Problem]:
    """Yield a problem for a layer that is a sublayer of itself; USD omits it without an error."""

    def walk(layer: Any, above: tuple[str, ...]) -> list[str]:
        names = (*above, layer.realPath)
        if layer.realPath in above:
            return list(names[names.index(layer.realPath) :])
        below = (
            Sdf.Layer.Find(Sdf.ComputeAssetPathRelativeToLayer(layer, name))
            for name in layer.subLayerPaths
            if name
        )
        return next((found for each in below if each and (found := walk(each, names))), [])

    cycle = walk(stage.GetRootLayer(), ())
    if cycle:
        yield Problem(path, "subLayers", f"form a cycle: {' -> '.join(cycle)}")


def _wrong_metadata(stage: Any, path: str) -> Iterator[Problem]:
    units = {"metersPerUnit": UsdGeom.GetStageMetersPerUnit(stage)}
    codes = {
        name: stage.GetMetadata(name)
        for name in ("startTimeCode", "endTimeCode")
        if stage.HasAuthoredMetadata(name)
    }
    for name, value in (units | codes).items():
        yield from _out_of_range(path, name, value)
    axis = str(UsdGeom.GetStageUpAxis(stage))
    if axis not in UP_AXES:
        yield Problem(path, "upAxis", f"is '{axis}', expects {' or '.join(UP_AXES)}")
    # of every layer: USD scales the time of sublayers and references by the ratio of their rates
    for layer in stage.GetUsedLayers():
        file = path if layer == stage.GetRootLayer() else layer.realPath
        if layer.HasTimeCodesPerSecond():
            yield from _out_of_range(file, "timeCodesPerSecond", layer.timeCodesPerSecond)
        elif layer.HasFramesPerSecond():
            yield from _out_of_range(file, "framesPerSecond", layer.framesPerSecond)


def _out_of_range(file: str, name: str, value: Any) -> Iterator[Problem]:
    low, high = _METADATA_RANGES[name]
    if not isinstance(value, int | float) or not low <= value <= high:
        told = f"{value:g}" if isinstance(value, int | float) else describe_value(value)
        yield Problem(file, name, f"is {told}. Give {low:g} to {high:g}")


def read_note(stage: Any, name: str, default: Any) -> Any:
    """Return what featherfx noted in a cache by name; the default where its type is another."""
    told = stage.GetRootLayer().customLayerData.get("featherfx")
    found = told.get(name) if isinstance(told, dict) else None
    return found if isinstance(found, type(default)) else default


def read_scenery(stage: Any) -> Iterator[dict[str, Any]]:
    """Yield the scenery of a shot in its cache, without malformed entries."""
    entries = read_note(stage, "scenery", {})
    texts, numbers = ("role", "file", "prim"), ("start", "first", "time_codes_per_frame")
    kinds = {name: str if name in texts else float for name in texts + numbers}
    for entry in entries.values():
        if isinstance(entry, dict) and all(
            isinstance(entry.get(key), kind) for key, kind in kinds.items()
        ):
            yield entry if isinstance(entry.get("rest", 0.0), float) else {**entry, "rest": None}
