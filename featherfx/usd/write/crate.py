"""Layers of samples as USD crate files (version 0.8.0), written as their values come.

USD exports a layer whose values are all in memory; it compares, hashes and copies them, and no
thread runs Python meanwhile. Here each array goes to the file from where it was computed, and what
names the arrays follows; that is made once for all chunks:

    header | constants | arrays | samples | tokens, fields, paths, specs, ... | their places

64 bits stand for a value: bits that say whether it is an array or stands in place of its address,
its type, and the address. Sections are small: integers are coded as differences of 32 bits, and LZ4
blocks hold literals alone. Source: crateFile.cpp, integerCoding.cpp and fastCompression.cpp of
OpenUSD.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

_HEADER = struct.Struct("<8s8Bq64x")
_MAGIC, _VERSION = b"PXR-USDC", (0, 8, 0, 0, 0, 0, 0, 0)
_WHOLE, _NUMBER, _SECTION = struct.Struct("<Q"), struct.Struct("<d"), struct.Struct("<16sqq")
_ARRAY, _IN_PLACE, _TYPE_BITS = 1 << 63, 1 << 62, 48
# numbers of types, of arrays by their numbers and elements
_BOOL, _INTEGER, _DOUBLE, _TOKEN, _SAMPLES = 1, 3, 9, 11, 46
_TOKEN_LIST, _DOUBLE_LIST = 41, 48
_ENUMERATIONS = {"specifier": 42, "variability": 44}
_ARRAYS: dict[tuple[str, tuple[int, ...]], int] = {
    ("<i4", ()): _INTEGER,
    ("<f4", ()): 8,
    ("<f2", (4,)): 18,
    ("<f4", (3,)): 24,
    ("<f2", (3,)): 25,
}
_ATTRIBUTE, _PRIM, _ROOT = 1, 6, 7
_END = -1  # of a set of fields
# of a path, of what comes next: its child, or none
_CHILD, _LEAF = -1, -2
_ENDS = "startTimeCode", "endTimeCode"


class _Node(NamedTuple):
    """A path in the order of the file: its spec, element (below 0: a property's), and how far its
    sibling is, 0 for the next; _CHILD or _LEAF without one."""

    spec: Any
    element: int
    jump: int


class CrateLayer:
    """All of a layer but its samples, as parts of files.

    sampled: paths of the attributes that will have samples.
    """

    def __init__(self, layer: Any, sampled: Sequence[Any]) -> None:
        self._tokens = {"": 0}  # no element of a path: it has no sign
        self._constants = bytearray(_HEADER.size)
        self._ends: dict[str, int] = {}
        nodes = self._nodes(layer.pseudoRoot, 0, False)
        values: list[int] = []
        names: list[int] = []
        known: dict[tuple[int, int], int] = {}
        sets: list[int] = []
        starts, places = [], {}
        wanted = set(sampled)
        for node in nodes:
            starts.append(len(sets))
            own = self._fields(node.spec)
            for name, value in own.items():
                place = known.setdefault((self._token(name), value), len(values))
                if place == len(values):
                    names.append(self._token(name))
                    values.append(value)
                sets.append(place)
            if node.spec.path in wanted:
                places[node.spec.path] = len(values)
                sets.append(len(values))
                names.append(self._token("timeSamples"))
                values.append(0)
            sets.append(_END)
        self._names, self._values = _integers(names), np.array(values, dtype=np.uint64)
        self._sampled = np.array([places[path] for path in sampled], dtype=np.int64)
        count, every = _whole(len(nodes)), range(len(nodes))
        ways = [node.element for node in nodes], [node.jump for node in nodes]
        kinds = [_kind_of(node.spec) for node in nodes]
        texts = b"".join(name.encode() + b"\0" for name in self._tokens)
        self._before = {
            "TOKENS": _whole(len(self._tokens), len(texts)) + _sized(_packed(texts)),
            "STRINGS": _whole(0),
        }
        self._after = {
            "FIELDSETS": _whole(len(sets)) + _integers(sets),
            "PATHS": 2 * count + b"".join(map(_integers, (every, *ways))),
            "SPECS": count + b"".join(map(_integers, (every, starts, kinds))),
        }

    def head(self, codes: Sequence[float] = (0.0,), place: int = 0) -> bytes:
        """The beginning of a file. codes: of all samples. place: of the table of sections."""
        found = bytearray(self._constants)
        _HEADER.pack_into(found, 0, _MAGIC, *_VERSION, place)
        for name, code in zip(_ENDS, (codes[0], codes[-1]), strict=True):
            if name in self._ends:
                _NUMBER.pack_into(found, self._ends[name], code)
        return bytes(found)

    def sections(self, samples: NDArray[np.uint64]) -> dict[str, bytes]:
        """Sections by name. samples: what stands for those of each sampled attribute."""
        values = self._values.copy()
        values[self._sampled] = samples
        fields = _whole(len(values)) + self._names + _sized(_packed(values.tobytes()))
        return {**self._before, "FIELDS": fields, **self._after}

    def _token(self, text: str) -> int:
        return self._tokens.setdefault(text, len(self._tokens))

    def _constant(self, kind: int, data: bytes) -> int:
        self._constants += bytes(-len(self._constants) % _WHOLE.size)
        place = len(self._constants)
        self._constants += data
        return kind << _TYPE_BITS | place

    def _nodes(self, spec: Any, element: int, has_sibling: bool) -> list[_Node]:
        """List a spec, and all below it."""
        below: list[_Node] = []
        children = _children(spec)
        for number, child in enumerate(children, 1):
            token = self._token(child.name)
            sign = -1 if child.path.IsPropertyPath() else 1
            below += self._nodes(child, sign * token, number < len(children))
        jump = _CHILD if children else _LEAF
        if has_sibling:
            jump = 1 + len(below) if children else 0
        return [_Node(spec, element, jump), *below]

    def _fields(self, spec: Any) -> dict[str, int]:
        """List what stands for the fields of a spec, by their names."""
        # sorted, so that equal layers make equal files
        own = {name: self._value(name, spec.GetInfo(name)) for name in sorted(spec.ListInfoKeys())}
        children = _children(spec)
        for name, is_property in (("primChildren", False), ("properties", True)):
            chosen = [c.name for c in children if c.path.IsPropertyPath() == is_property]
            if chosen:
                tokens = np.array([self._token(each) for each in chosen], dtype="<u4")
                own[name] = self._constant(_TOKEN_LIST, _whole(len(chosen)) + tokens.tobytes())
        return own

    def _value(self, name: str, value: Any) -> int:
        if name in _ENUMERATIONS:
            return _in_place(_ENUMERATIONS[name], value.value)
        if isinstance(value, bool):
            return _in_place(_BOOL, value)
        if isinstance(value, str):
            return _in_place(_TOKEN, self._token(value))
        if isinstance(value, int):
            return _in_place(_INTEGER, value)
        found = self._constant(_DOUBLE, _NUMBER.pack(value))
        if name in _ENDS:
            self._ends[name] = len(self._constants) - _NUMBER.size
        return found


class CrateFile:
    """A file that takes arrays, and then the layer that has them as samples.

    file: open for writing, empty. Raises OSError where it cannot be written.
    """

    def __init__(self, file: BinaryIO, layer: CrateLayer) -> None:
        self._file, self._layer, self._end = file, layer, 0
        self._write(layer.head())

    def add(self, numbers: NDArray[Any]) -> int:
        """Write an array (N, ...), and return what stands for it."""
        kind = _ARRAY | _ARRAYS[numbers.dtype.str, numbers.shape[1:]] << _TYPE_BITS
        if not len(numbers):
            return kind
        gap = -self._end % _WHOLE.size
        place = self._write(bytes(gap) + _WHOLE.pack(len(numbers))) + gap
        self._write(np.ascontiguousarray(numbers).data.cast("B"))
        return kind | place

    def finish(self, codes: Sequence[float], samples: Sequence[Sequence[int]]) -> None:
        """Write what names the arrays.

        codes: of all samples. samples: of each sampled attribute, what stands for its values.
        """
        self._write(bytes(-self._end % _WHOLE.size))
        times = self._write(_whole(len(codes)) + np.array(codes, dtype="<f8").tobytes())
        values = np.array(samples, dtype="<u8").reshape(-1, len(codes))
        # 8: what is told of follows at once
        told = [8, _DOUBLE_LIST << _TYPE_BITS | times, 8, len(codes)]
        tables = np.hstack([np.tile(np.array(told, dtype="<u8"), (len(values), 1)), values])
        place = self._write(tables.tobytes())
        starts = place + 8 * tables.shape[1] * np.arange(len(values))
        stands = starts.astype(np.uint64) | np.uint64(_SAMPLES << _TYPE_BITS)
        sections = self._layer.sections(stands)
        table = _whole(len(sections))
        for name, content in sections.items():
            table += _SECTION.pack(name.encode(), self._write(content), len(content))
        end = self._write(table)
        self._file.seek(0)
        self._file.write(self._layer.head(codes, end))

    def _write(self, data: Any) -> int:
        """Write bytes, and return where they begin."""
        place = self._end
        self._file.write(data)
        self._end += len(data)
        return place


def _children(spec: Any) -> list[Any]:
    if spec.path.IsPropertyPath():
        return []
    own = [] if spec.path.IsAbsoluteRootPath() else list(spec.properties)
    return [*spec.nameChildren, *own]


def _kind_of(spec: Any) -> int:
    if spec.path.IsAbsoluteRootPath():
        return _ROOT
    return _ATTRIBUTE if spec.path.IsPropertyPath() else _PRIM


def _in_place(kind: int, value: int) -> int:
    return _IN_PLACE | kind << _TYPE_BITS | int(value)


def _whole(*values: int) -> bytes:
    return b"".join(map(_WHOLE.pack, values))


def _sized(data: bytes) -> bytes:
    return _whole(len(data)) + data


def _packed(data: bytes) -> bytes:
    """One LZ4 block, which one byte precedes; of literals alone."""
    count, rest = min(len(data), 15), max(len(data) - 15, 0)
    head = bytes([count << 4]) + (b"\xff" * (rest // 255) + bytes([rest % 255])) * (count == 15)
    return b"\0" + head + data


def _integers(values: Sequence[int]) -> bytes:
    """Integers of 32 bits as differences, all of which are written in full."""
    numbers = np.array(values, dtype=np.int64).astype("<u4")
    ways = np.diff(numbers, prepend=np.zeros(1, "<u4"))
    marks = b"\xff" * -(-2 * len(numbers) // 8)
    return _sized(_packed(bytes(4) + marks + ways.tobytes()))
