"""Layers of samples as USD crate files (version 0.8.0), written as their values come.

USD exports a layer whose values are all in memory; it compares, hashes and copies them, and no
thread runs Python meanwhile. Here each array goes to the file from where it was computed, and what
names the arrays follows:

    header | values | tokens | strings | fields | sets of fields | paths | specs | their places

64 bits stand for a value: bits that say whether it is an array or stands in place of its address,
its type, and the address. Sections are small: integers are coded as differences of 32 bits, and LZ4
blocks hold literals alone. Source: crateFile.cpp, integerCoding.cpp and fastCompression.cpp of
OpenUSD.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

_HEADER = struct.Struct("<8s8Bq64x")
_VERSION = 0, 8, 0, 0, 0, 0, 0, 0
_WHOLE, _SECTION = struct.Struct("<Q"), struct.Struct("<16sqq")
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


class _Node(NamedTuple):
    """A path in the order of the file: its spec, element (below 0: a property's), and how far its
    sibling is, 0 for the next; _CHILD or _LEAF without one."""

    spec: Any
    element: int
    jump: int


class CrateFile:
    """A file that takes arrays, then the layer that has them as samples.

    file: open for writing, empty. Raises OSError where it cannot be written.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._end = file, 0
        self._tokens = {"": 0}  # no element of a path: it has no sign
        self._write(bytes(_HEADER.size))

    def add(self, numbers: NDArray[Any]) -> int:
        """Write an array (N, ...), and return what stands for it."""
        kind = _ARRAY | _ARRAYS[numbers.dtype.str, numbers.shape[1:]] << _TYPE_BITS
        if not len(numbers):
            return kind
        self._write(bytes(-self._end % _WHOLE.size))
        place = self._write(_WHOLE.pack(len(numbers)))
        self._write(np.ascontiguousarray(numbers).data.cast("B"))
        return kind | place

    def finish(
        self, layer: Any, codes: Sequence[float], samples: Mapping[Any, Sequence[int]]
    ) -> None:
        """Write what names the arrays: all of a layer that has no samples, and these.

        codes: of all samples. samples: of attributes by path, what stands for each of their values.
        """
        times = self._list(_DOUBLE_LIST, np.array(codes))
        written = {path: self._samples(times, each) for path, each in samples.items()}
        nodes = self._nodes(layer.pseudoRoot, 0, False)
        fields: dict[tuple[int, int], int] = {}
        sets: list[int] = []
        starts = []
        for node in nodes:
            starts.append(len(sets))
            own = self._fields(node.spec)
            if node.spec.path in written:
                own["timeSamples"] = written[node.spec.path]
            named = ((self._token(name), value) for name, value in own.items())
            sets += [*(fields.setdefault(each, len(fields)) for each in named), _END]
        kinds = [_kind_of(node.spec) for node in nodes]
        every = range(len(nodes))
        names, values = zip(*fields, strict=True)
        texts = b"".join(name.encode() + b"\0" for name in self._tokens)
        reps = struct.pack(f"<{len(values)}Q", *values)
        elements, jumps = [n.element for n in nodes], [n.jump for n in nodes]
        self._publish(
            {
                "TOKENS": _whole(len(self._tokens), len(texts)) + _sized(_packed(texts)),
                "STRINGS": _whole(0),
                "FIELDS": _whole(len(fields)) + _integers(names) + _sized(_packed(reps)),
                "FIELDSETS": _whole(len(sets)) + _integers(sets),
                "PATHS": _whole(len(nodes)) * 2
                + b"".join(map(_integers, (every, elements, jumps))),
                "SPECS": _whole(len(nodes)) + b"".join(map(_integers, (every, starts, kinds))),
            }
        )

    def _write(self, data: Any) -> int:
        """Write bytes, and return where they begin."""
        place = self._end
        self._file.write(data)
        self._end += len(data)
        return place

    def _token(self, text: str) -> int:
        return self._tokens.setdefault(text, len(self._tokens))

    def _list(self, kind: int, numbers: NDArray[Any]) -> int:
        return kind << _TYPE_BITS | self._write(_whole(len(numbers)) + numbers.tobytes())

    def _samples(self, times: int, values: Sequence[int]) -> int:
        """Write the samples of an attribute; 8: what is told of follows at once."""
        head = _whole(8, times, 8, len(values))
        place = self._write(head + struct.pack(f"<{len(values)}Q", *values))
        return _SAMPLES << _TYPE_BITS | place

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
        """What stands for the fields of a spec, by their names."""
        own = {name: self._value(name, spec.GetInfo(name)) for name in spec.ListInfoKeys()}
        children = _children(spec)
        for name, is_property in (("primChildren", False), ("properties", True)):
            chosen = [c.name for c in children if c.path.IsPropertyPath() == is_property]
            if chosen:
                tokens = np.array([self._token(each) for each in chosen], dtype=np.uint32)
                own[name] = self._list(_TOKEN_LIST, tokens)
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
        return _DOUBLE << _TYPE_BITS | self._write(struct.pack("<d", value))

    def _publish(self, sections: Mapping[str, bytes]) -> None:
        """Write sections, their places, and at last the header."""
        table = _whole(len(sections))
        for name, content in sections.items():
            table += _SECTION.pack(name.encode(), self._write(content), len(content))
        place = self._write(table)
        self._file.seek(0)
        self._file.write(_HEADER.pack(b"PXR-USDC", *_VERSION, place))


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
