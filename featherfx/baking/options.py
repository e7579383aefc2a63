"""Options of a bake and of a groom's export; importable without numpy and USD."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

from featherfx.errors import require_type
from featherfx.files.folders import folders_of
from featherfx.groom.keys.problems import nearest
from featherfx.limits import (
    MAX_BARBS,
    MAX_BARBULES,
    MAX_BIRDS,
    MAX_COLUMNS,
    MAX_JOBS,
    MAX_ROWS,
    option,
)
from featherfx.usd.write.options import StageOptions, WriteOptions

if TYPE_CHECKING:
    from featherfx.shot.types import Quality

# s of processor time that stats spends on bakes of a part of the feathers, roughly
TRIAL_SECONDS = 15.0

Chosen = TypeVar("Chosen")
Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True)
class DrawnOptions:
    """Options of the drawn feathers, independent of the simulated ones."""

    preset_folders: Iterable[str | Path] = option(
        (), "Folder of presets that win over the shipped ones. Repeatable."
    )
    render_rows: int | None = option(
        None,
        "Rows of the meshes along the rachis.  [default: as simulated]",
        least=3,
        most=MAX_ROWS,
    )
    render_columns: int | None = option(
        None,
        "Columns of the meshes on each side of the rachis.  [default: as simulated]",
        least=1,
        most=MAX_COLUMNS,
    )
    barbs: int | None = option(
        None,
        "Also write N barbs along each vane as curves (variant `barbs` of the root prim).",
        least=1,
        most=MAX_BARBS,
        metavar="N",
    )
    barbules: int | None = option(
        None,
        "Also write N barbules on either side of each of these barbs, which then are as thin as"
        " without them.",
        least=1,
        most=MAX_BARBULES,
        metavar="N",
    )

    def grid(self, quality: Quality) -> tuple[int, int]:
        """Rows and columns of the meshes."""
        return self.render_rows or quality.rows, self.render_columns or quality.columns


# options of DrawnOptions that commands derive from it
DRAWN = tuple(each.name for each in fields(DrawnOptions) if each.name != "preset_folders")


@dataclass(frozen=True)
class GroomOptions(StageOptions, DrawnOptions):
    """Options of a groom that is written at rest."""

    quality: str = option("final", "Quality preset that gives rows and columns.")
    instances: bool | None = option(
        None,
        "Feathers of one shape as instances, or each a mesh of its own.  [default: instances where"
        " at least a third of them repeat and neither barbs nor textures are written]",
    )


@dataclass(frozen=True)
class BakeOptions(WriteOptions, DrawnOptions):
    """Options of a bake."""

    frames: tuple[int, int] | None = option(
        None, "First and last frame to write.  [default: all of the shot]", form="A-B"
    )
    jobs: int = option(
        1, "Feathers simulated at a time; the result does not depend on it.", least=1, most=MAX_JOBS
    )
    quality: str | None = option(None, "Quality preset instead of the shot's.", metavar="NAME")
    error: float | None = option(
        None,
        "How far any point may be off, in percent of a feather's length; rows, columns and steps"
        " are chosen for it, instead of by the quality.",
        least=0.01,
        most=20,
        metavar="PERCENT",
    )
    report: str | Path | None = option(
        None, "Write times, errors and other figures of the run to this JSON file."
    )
    feathers: tuple[int, int] | None = option(
        None,
        "Bake the I-th of N shares of the feathers, to OUT.IofN.usdc; I-J/N: shares I to J.",
        form="I/N",
    )


@dataclass(frozen=True)
class FlockOptions(BakeOptions):
    """Options of the bake of a flock."""

    birds: int | None = option(
        None,
        "Of a flock: birds of each group along a path.  [default: as the file says]",
        least=1,
        most=MAX_BIRDS,
        metavar="N",
    )


def make_options(kind: type[Chosen], values: Mapping[str, Any]) -> Chosen:
    """Make a class of options. Raises TypeError for names it lacks, and values of other types."""
    hints = get_type_hints(kind)
    for name, value in values.items():
        if name not in hints:
            raise TypeError(f"no option {name!r}, {nearest(name, hints)}")
        if not _fits(value, hints[name]):
            require_type(name, value, (), _in_words(hints[name]))
        if name == "preset_folders":
            folders_of(value)
    return kind(**values)


_WORDS = {
    bool: "True or False", int: "a whole number", float: "a number", str: "a text", Path: "a path",
    type(None): "None", tuple: "two whole numbers", Iterable: "a list",
}  # fmt: skip


def _in_words(hint: Any) -> str:
    """Return the types of a hint in words."""
    kind = get_origin(hint) or hint
    if kind in _WORDS:
        return _WORDS[kind]
    return " or ".join(_in_words(each) for each in get_args(hint))


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of a type; whole numbers are numbers, texts no sequences."""
    kinds, parts = get_origin(hint), get_args(hint)
    if kinds is None:
        number = {int: Integral, float: Real}.get(hint, hint)
        return isinstance(value, number) and (hint is bool or not isinstance(value, bool))
    if kinds is tuple:
        many = isinstance(value, tuple | list) and len(value) == len(parts)
        return many and all(map(_fits, value, parts))
    if issubclass(kinds, Iterable):
        return isinstance(value, Iterable) and not isinstance(value, str)
    return any(_fits(value, each) for each in parts)


def takes(options: type) -> Callable[[Function], Function]:
    """Names the fields of a class of options as the keywords of a function that passes them on."""

    def named(function: Function) -> Function:
        own = inspect.signature(function)
        fixed = [each for each in own.parameters.values() if each.kind is not each.VAR_KEYWORD]
        keywords = [
            each.replace(kind=each.KEYWORD_ONLY)
            for each in inspect.signature(options).parameters.values()
        ]
        signature = own.replace(parameters=[*fixed, *keywords])
        function.__signature__ = signature  # type: ignore[attr-defined]
        return function

    return named
