"""Presets that are changed by hand: their sliders, and files with only what was changed.

A file extends the preset of its own name, so that a folder of them, given as `--presets`, changes
shots without a word in these.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from featherfx.errors import InputError, Problem, require
from featherfx.files.atomic_write import into_text, standing, write_all
from featherfx.groom.keys.places import Direction, Preset
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import ArrayOf, Either, Flag, Key, Number, Table, Text, ValueType
from featherfx.groom.presets.library import plain
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.read.toml_text import toml_of

# what is not of the mechanics, or decides which other keys there are
_LEFT_OUT = {
    "feather": {"colour", "barbs", "scaling"},
    "motion": {"kind", "amount"},
    "bird": {"colours"},
}
# a slider goes through the whole range where the value is at least this part of it, else so many
# times beyond the value; whole numbers so many on
_PART, _FAR, _WHOLE = 0.1, 30.0, 100.0


class Slider(NamedTuple):
    """One value that can be changed. key: FAMILY/NAME:dotted.key, items of arrays by number.

    kind: number, whole, flag or choice. low, high: allowed. near: ends of the slider. scale:
    linear, factor (equal ways are equal factors) or cubic (fine near the low end).
    """

    key: str
    kind: str
    value: Any
    meaning: str
    unit: str = ""
    low: float = 0.0
    high: float = 1.0
    near: tuple[float, float] = (0.0, 1.0)
    scale: str = "linear"
    choices: tuple[str, ...] = ()


class Tuned:
    """Presets by family and name, with changed values.

    folders: where presets are looked for. changes: by key as of Slider. Raises InputError where a
    preset is not there.
    """

    def __init__(self, presets: Iterable[tuple[str, str]], folders: Sequence[Path]) -> None:
        self._folders = folders
        self._before: dict[tuple[str, str], dict[str, Any]] = {}
        for family, name in presets:
            _, tree = load_preset(f"{family}/{name}", folders)
            self._before[family, name] = plain(tree)
        self._now = copy.deepcopy(self._before)
        self._sliders = {each.key: each for each in self._all()}

    @property
    def sliders(self) -> list[Slider]:
        """With the values that there were."""
        return [*self._sliders.values()]

    def change(self, key: str, value: Any) -> None:
        """Set a value. Raises InputError where there is no such key, or it is not allowed."""
        if key not in self._sliders:
            raise InputError(Problem("tune", key, "cannot be changed here"))
        preset, _, path = key.partition(":")
        family, _, name = preset.rpartition("/")
        steps: list[str] = path.split(".")
        table, inner = _found(_table(family, self._before[family, name]), steps), Problems()
        if isinstance(value, int) and isinstance(table, Number) and not table.whole:
            value = float(value)
        checked = table.check(value, Place("tune", key, inner), True)
        inner.raise_any()
        values = self._now[family, name]
        self._now[family, name] = _replaced(values, steps, checked)

    def files(self) -> dict[str, str]:
        """Contents of preset files, by their names within a folder of presets."""
        found = {}
        for (family, name), before in self._before.items():
            lines = [*_changed(before, self._now[family, name])]
            if lines:
                found[f"{family}/{name}.toml"] = "\n".join([f'base = "{name}"', *lines, ""])
        return found

    def write(self, folder: Path, overwrite: bool) -> list[Path]:
        """Write the files; all appear, or none. Raises InputError where one would replace another
        that may not be replaced, or that it extends."""
        wanted = {folder / name: text for name, text in self.files().items()}
        problems = [*self._refused(wanted, overwrite)]
        if not wanted:
            problems.append(Problem(str(folder), "", "nothing was changed. Move a slider first"))
        require(*problems)
        try:
            for path in wanted:
                path.parent.mkdir(parents=True, exist_ok=True)
            before = {path: standing(path) for path in wanted}
            write_all([(path, into_text(text)) for path, text in wanted.items()], before)
        except OSError as error:
            told = f"cannot be written: {error.strerror or error}"
            raise InputError(Problem(str(folder), "", told)) from error
        return [*wanted]

    def _refused(self, wanted: Iterable[Path], overwrite: bool) -> Iterator[Problem]:
        for path in wanted:
            if not path.exists():
                continue
            if any(each.resolve() == path.parents[1].resolve() for each in self._folders):
                yield Problem(str(path), "", "is what these changes are to. Choose another folder")
            elif not overwrite:
                yield Problem(str(path), "", "exists. --overwrite replaces it")

    def _all(self) -> Iterator[Slider]:
        for (family, name), values in self._before.items():
            table, left_out = _table(family, values), _LEFT_OUT.get(family, set())
            for key, declared in table.keys.items():
                if key not in left_out:
                    at = f"{family}/{name}:{key}"
                    yield from _sliders(declared.type, values.get(key), at, declared)


def _table(family: str, values: dict[str, Any]) -> Table:
    return PRESET_FAMILIES[family].finished(values.get("kind", ""))


def _sliders(kind: ValueType, value: Any, at: str, key: Key) -> Iterator[Slider]:
    if isinstance(kind, Preset):
        kind = kind.finished()
    if isinstance(kind, Direction):
        kind = ArrayOf(Number(-1.0, 1.0), 3, 3)
    if isinstance(kind, Either):
        kind = kind.options.get(list if isinstance(value, tuple) else type(value), kind)
    if value is None:
        return
    if isinstance(kind, Table):
        for name, each in kind.keys.items():
            yield from _sliders(each.type, value.get(name), f"{at}.{name}", each)
    elif isinstance(kind, ArrayOf) and isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from _sliders(kind.item, item, f"{at}.{number}", key)
    elif isinstance(kind, Number):
        near, scale = _near(kind, float(value))
        what = "whole" if kind.whole else "number"
        limits = (kind.unit, float(kind.low), float(kind.high), near, scale)
        yield Slider(at, what, value, key.meaning, *limits)
    elif isinstance(kind, Flag):
        yield Slider(at, "flag", value, key.meaning)
    elif isinstance(kind, Text) and kind.choices:
        yield Slider(at, "choice", value, key.meaning, choices=kind.choices)


def _near(kind: Number, value: float) -> tuple[tuple[float, float], str]:
    """Ends and scale of a slider."""
    low, high = float(kind.low), float(kind.high)
    if kind.whole:
        return (low, min(high, max(low + _WHOLE, 2.0 * value))), "linear"
    if low < 0.0 or value >= _PART * high or (value == 0.0 and high <= 1.0):
        return (low, high), "linear"
    if low > 0.0:
        return (max(low, value / _FAR), min(high, value * _FAR)), "factor"
    return (low, min(high, value * _FAR) if value else high), "cubic"


def _found(kind: ValueType, steps: Sequence[str]) -> ValueType:
    """The type of what a key leads to."""
    for step in steps:
        if isinstance(kind, Preset):
            kind = kind.finished()
        if isinstance(kind, Direction):
            return Number(-1.0, 1.0)
        if isinstance(kind, Either):
            kind = kind.options[list if step.isdigit() else dict]
        assert isinstance(kind, Table | ArrayOf)
        kind = kind.keys[step].type if isinstance(kind, Table) else kind.item
    return kind.options[float] if isinstance(kind, Either) else kind


def _replaced(values: Any, steps: Sequence[str], value: Any) -> Any:
    """A copy of nested tables and arrays with another value where the steps lead."""
    if not steps:
        return value
    if isinstance(values, dict):
        return values | {steps[0]: _replaced(values[steps[0]], steps[1:], value)}
    number = int(steps[0])
    return tuple(
        _replaced(each, steps[1:], value) if k == number else each for k, each in enumerate(values)
    )


def _changed(before: dict[str, Any], now: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Lines of TOML for what differs; arrays are written as a whole."""
    for name, value in now.items():
        was = before.get(name)
        if isinstance(value, dict):
            yield from _changed(was or {}, value, f"{prefix}{name}.")
        elif value != was:
            yield f"{prefix}{name} = {toml_of(_rounded(value))}"


def _rounded(value: Any) -> Any:
    """As it is written; what is not given is left out."""
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items() if each is not None}
    if isinstance(value, list | tuple):
        return tuple(_rounded(each) for each in value)
    if isinstance(value, float) and math.isfinite(value):
        return float(f"{value:.6g}")
    return value
