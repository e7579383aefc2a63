"""Feathers from tables: CSV and NPZ files with thousands of rows, read column by column."""

from __future__ import annotations

import csv
import lzma
import math
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, parallel
from featherfx.errors import CONTROL
from featherfx.groom.keys.groom import TABLE_KEYS
from featherfx.groom.keys.problems import MAX_REPORTED, Place, Problems
from featherfx.groom.keys.values import Number, shown
from featherfx.groom.presets.presets import KindChoice
from featherfx.groom.read.drafts import Draft, mirror_of, with_mirror_images
from featherfx.groom.read.space import Space
from featherfx.limits import MAX_ARRAY_BYTES, MAX_CHARACTERS, MAX_FEATHERS, irregular

_VECTORS = {
    "position": ("x", "y", "z"),
    "direction": ("direction_x", "direction_y", "direction_z"),
    "up": ("up_x", "up_y", "up_z"),
}
_FACTORS = ("scale", "width", "roll", "stiffness", "weight")
_TEXTS = ("kind", "region", "joint", "side")
_NUMBERS = tuple(name for names in _VECTORS.values() for name in names)
TABLE_COLUMNS = ("id", *_TEXTS, *_NUMBERS, *_FACTORS)
# what damaged files raise
_UNREADABLE = (
    *(OSError, EOFError, ValueError, TypeError, RuntimeError, SyntaxError, LookupError),
    *(csv.Error, zipfile.BadZipFile, zlib.error, struct.error, lzma.LZMAError),
)

Columns = dict[str, NDArray[Any]]


def read_table(entry: dict[str, Any], folder: Path, place: Place, space: Space) -> list[Draft]:
    """The drafts of one [[table]]; none after adding problems.

    entry: checked keys. folder: of the groom. place: of the entry in the groom.
    """
    path = folder / entry["file"]
    count = len(place.problems)
    columns = _load(path, place.problems)
    if columns is None:
        return []
    _check_columns(path, columns, entry, place)
    if len(place.problems) > count:
        return []
    _check_rows(path, columns, place.problems)
    if len(place.problems) > count:
        return []
    drafts = _drafts(path, columns, entry, place.problems, space)
    return with_mirror_images(drafts, place, mirror_of(entry, space))


def _load(path: Path, problems: Problems) -> Columns | None:
    if fault := irregular(path):
        problems.add(path, "", f"{fault}, expects a CSV or NPZ file")
        return None
    try:
        if path.suffix.lower() == ".npz":
            return _load_npz(path, problems)
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(islice(filter(None, csv.reader(file)), MAX_FEATHERS + 2))
        return _load_csv(path, rows, problems)
    except FileNotFoundError:
        problems.add(path, "", "there is no such file. Check the path")
    except UnicodeDecodeError as error:
        problems.add(path, "", f"is not UTF-8 text (byte {error.start})")
    except _UNREADABLE as error:
        problems.add(path, "", f"cannot be read: {error}")
    return None


def _load_npz(path: Path, problems: Problems) -> Columns | None:
    columns: Columns = {}
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name = entry.filename.removesuffix(".npy")
            if name not in TABLE_COLUMNS and name not in _VECTORS:
                columns[name] = np.zeros(0)  # is told as unknown, and not read
                continue
            values = _npz_array(archive, entry)
            if name in _VECTORS and values.ndim == 2 and values.shape[1] == 3:
                columns.update(zip(_VECTORS[name], values.T, strict=True))
            elif values.ndim == 1 and name not in _VECTORS:
                columns[name] = values
            else:
                expects = "(n, 3)" if name in _VECTORS else "(n,)"
                problems.add(path, name, f"has shape {values.shape}, expects {expects}")
    lengths = {name: len(values) for name, values in columns.items() if name in TABLE_COLUMNS}
    if len(set(lengths.values())) > 1:
        problems.add(path, "", f"columns differ in length: {lengths}")
        return None
    for name, values in columns.items():
        wanted = "fiu" if name in _NUMBERS + _FACTORS else "U"
        if name in TABLE_COLUMNS and values.dtype.kind not in wanted:
            kind = "numbers" if wanted == "fiu" else "texts"
            problems.add(path, name, f"holds {values.dtype} values, expects {kind}")
            return None
    return {
        name: values.astype(float) if name in _NUMBERS + _FACTORS else values
        for name, values in columns.items()
    }


def _npz_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of an archive, after what its head says of its size, whatever it is packed to."""
    with archive.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read_head = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            read_head = np.lib.format.read_array_header_2_0
        shape, _, kind = read_head(file)
    _check_count(math.prod(shape[:1]))
    size = math.prod(shape) * kind.itemsize
    if size > MAX_ARRAY_BYTES:
        sizes = f"{size / 1e6:.6g} MB, more than {MAX_ARRAY_BYTES / 1e6:.6g} MB"
        raise ValueError(f"{entry.filename} would take {sizes}")
    with archive.open(entry) as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _check_count(count: int) -> None:
    if count > MAX_FEATHERS:
        raise ValueError(f"holds more than {MAX_FEATHERS} rows")


def _load_csv(path: Path, rows: list[list[str]], problems: Problems) -> Columns | None:
    if not rows:
        problems.add(path, "", "is empty, expects a header line with column names")
        return None
    header = [name.strip() for name in rows[0]]
    _check_count(len(rows) - 1)
    repeated = sorted(name for name, count in Counter(header).items() if count > 1)
    for name in repeated:
        problems.add(path, name, "the header names this column twice. Remove one")
    for number, line in enumerate(rows[1:], 1):
        if len(line) != len(header):
            message = f"has {len(line)} cells, the header has {len(header)}"
            problems.add(path, f"row {number}", message)
            return None
    if repeated:
        return None
    cells = list(zip(*rows[1:], strict=True)) or [()] * len(header)
    columns: Columns = {}
    for name, values in zip(header, cells, strict=True):
        if name in _NUMBERS + _FACTORS:
            columns[name] = _numbers(path, name, values, problems)
        else:
            # as objects: one long text would make all of them long
            columns[name] = np.array([value.strip() for value in values], dtype=object)
    return columns


def _numbers(path: Path, name: str, cells: tuple[str, ...], problems: Problems) -> NDArray[Any]:
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        bad = np.array([not _is_number(cell) for cell in cells])
    _report(path, name, bad, lambda row: f"{cells[row]!r} is not a number", problems)
    return np.zeros(len(cells))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_columns(path: Path, columns: Columns, entry: dict[str, Any], place: Place) -> None:
    for name in columns:
        if name not in TABLE_COLUMNS:
            Place(str(path), name, place.problems).unknown("unknown column", name, TABLE_COLUMNS)
    for name in ("id", *_NUMBERS):
        if name not in columns:
            place.problems.add(path, name, "there is no such column. Add it to the table")
    if "kind" not in columns and entry["kind"] is None:
        place.child("kind").fail("is missing, and the table has no column kind. Give one of them")


def _report(
    path: Path, name: str, bad: NDArray[Any], message: Callable[[int], str], problems: Problems
) -> None:
    rows = np.flatnonzero(bad)
    for row in rows[:MAX_REPORTED]:
        problems.add(path, f"row {row + 1}.{name}", message(int(row)))
    if len(rows) > MAX_REPORTED:
        problems.add(path, name, f"and {len(rows) - MAX_REPORTED} more rows with the same fault")


def _check_numbers(path: Path, name: str, values: NDArray[Any], problems: Problems) -> None:
    bad = ~np.isfinite(values)
    _report(path, name, bad, lambda row: f"{values[row]} is not a finite number", problems)
    limits = TABLE_KEYS[name].type if name in _FACTORS else Number(-1e6, 1e6)
    assert isinstance(limits, Number)
    outside = ~bad & ((values < limits.low) | (values > limits.high))
    tail = f"is out of range. Give {limits.allowed()}"
    _report(path, name, outside, lambda row: f"{values[row]:g} {tail}", problems)


def _check_texts(path: Path, name: str, texts: list[str], problems: Problems) -> None:
    long = np.array([len(text) > MAX_CHARACTERS for text in texts])
    tail = f"characters. Give at most {MAX_CHARACTERS}"
    _report(path, name, long, lambda row: f"has {len(texts[row])} {tail}", problems)
    broken = np.array([CONTROL.search(text) is not None for text in texts])
    tail = "holds a line break or a control character"
    _report(path, name, broken, lambda row: f"{shown(texts[row])} {tail}", problems)


def _check_rows(path: Path, columns: Columns, problems: Problems) -> None:
    numbers = {name: columns[name] for name in _NUMBERS + _FACTORS if name in columns}
    for name, values in numbers.items():
        _check_numbers(path, name, values, problems)
    _report(path, "id", columns["id"] == "", lambda row: "the text is empty", problems)
    for name in ("id", *_TEXTS):
        if name in columns:
            _check_texts(path, name, columns[name].tolist(), problems)
    if "side" in columns:
        side = columns["side"]
        bad = ~np.isin(side, ("left", "right"))
        _report(path, "side", bad, lambda row: f"'{side[row]}' is not left or right", problems)
    if all(np.isfinite(values).all() for values in numbers.values()):
        direction, up = (_vectors(columns, name) for name in ("direction", "up"))
        zero = np.linalg.norm(direction, axis=1) < 1e-9
        _report(path, "direction_x", zero, lambda row: "a direction cannot be zero", problems)
        bad = parallel(direction, up) & ~zero
        _report(path, "up_x", bad, lambda row: "up is zero or parallel to direction", problems)


def _vectors(columns: Columns, name: str) -> Array:
    return np.column_stack([columns[each] for each in _VECTORS[name]])


def _drafts(
    path: Path, columns: Columns, entry: dict[str, Any], problems: Problems, space: Space
) -> list[Draft]:
    position, direction, up = (_vectors(columns, name) for name in _VECTORS)
    position = space.points(position)
    rotation = frames_from(space.directions(direction), space.directions(up))
    count = len(position)
    # columns that are missing stand in the groom, the same for all
    values = {
        name: columns[name].tolist() if name in columns else [entry[name]] * count
        for name in (*_TEXTS, *_FACTORS)
    }
    choices: dict[str, KindChoice] = {}
    drafts = []
    for number, name in enumerate(columns["id"].tolist()):
        place = Place(str(path), f"row {number + 1}", problems)
        kind = values["kind"][number]
        if kind not in choices:
            choices[kind] = KindChoice((kind,), 0.0, (), place)
        drafts.append(
            Draft(
                id=name,
                choice=choices[kind],
                position=position[number],
                rotation=rotation[number],
                region=values["region"][number],
                joint=values["joint"][number],
                left=values["side"][number] == "left",
                place=place,
                **{name: values[name][number] for name in _FACTORS},
            )
        )
    return drafts
