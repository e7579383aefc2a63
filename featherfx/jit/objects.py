"""Loads machine code as LLVM leaves it, without LLVM, whose library takes 48 MiB of every process.

What kernels are compiled to is an object file of sections and places to be filled with addresses
(System V ABI, ELF-64, and its supplement for AMD64). Kernels refer to what they call by whole
addresses. What is of another format, or refers otherwise, is left to LLVM (inner.py).
"""

from __future__ import annotations

import ctypes
import mmap
import platform
import struct
import sys
from functools import cache
from typing import Any, NamedTuple

from featherfx.jit.lazy_import import GIVEN

# of a section: allocated while it runs, written to; of its kind: places, nothing in the file
_WRITTEN, _ALLOCATED = 0x1, 0x2
_SYMBOLS, _PLACES, _ZEROS, _UNWINDING = 2, 4, 8, 0x70000001
# of places: a whole address; the same and half of one, from the place on
_WHOLE, _FROM_HERE, _CALLED_FROM_HERE, _WHOLE_FROM_HERE = 1, 2, 4, 24
_UNDEFINED, _ABSOLUTE, _COMMON = 0, 0xFFF1, 0xFFF2


class CannotBeLoadedError(Exception):
    """Machine code that is left to LLVM."""


class _Section(NamedTuple):
    name: int
    kind: int
    flags: int
    address: int
    offset: int
    size: int
    link: int
    info: int
    align: int
    width: int


class _Symbol(NamedTuple):
    name: int
    info: int
    other: int
    section: int
    value: int
    size: int


# memory of what was loaded, for as long as the process lives
_held: list[Any] = []


def can_load() -> bool:
    """Whether objects of this system are loaded here."""
    return sys.platform == "linux" and platform.machine() == "x86_64"


def loaded(machine: bytes, links: dict[str, int]) -> dict[str, int]:
    """Addresses by name of what an object file defines.

    links: addresses by name of further functions that it calls. Raises CannotBeLoadedError.
    """
    if not can_load() or machine[:6] != b"\x7fELF\x02\x01":
        raise CannotBeLoadedError("of another system")
    (offset,) = struct.unpack_from("<Q", machine, 0x28)
    width, count = struct.unpack_from("<HH", machine, 0x3A)
    sections = [
        _Section(*struct.unpack_from("<IIQQQQIIQQ", machine, offset + k * width))
        for k in range(count)
    ]
    (table,) = (each for each in sections if each.kind == _SYMBOLS)
    symbols = [
        _Symbol(*fields) for fields in struct.iter_unpack("<IBBHQQ", _content(machine, table))
    ]
    names = _content(machine, sections[table.link])
    starts, code = _placed(machine, sections)
    addresses = _addresses(symbols, names, starts, links)
    for each in sections:
        if each.kind == _PLACES and each.info in starts:
            _fill(_content(machine, each), starts[each.info], addresses)
    _make_executable(code)
    return {
        _name(names, each.name): address
        for each, address in zip(symbols, addresses, strict=True)
        if each.section != _UNDEFINED and each.name
    }


def _content(machine: bytes, section: _Section) -> bytes:
    return machine[section.offset : section.offset + section.size]


def _name(names: bytes, at: int) -> str:
    return names[at : names.index(b"\0", at)].decode()


def _placed(machine: bytes, sections: list[_Section]) -> tuple[dict[int, int], tuple[int, int]]:
    """Where each section that runs need begins, by its number; begin and size of what is not
    written to. What unwinding takes is left out: kernels raise nothing."""
    starts: dict[int, int] = {}
    code = (0, 0)
    for written in (False, True):
        wanted = [
            (k, each)
            for k, each in enumerate(sections)
            if each.flags & _ALLOCATED
            and bool(each.flags & _WRITTEN) == written
            and each.kind != _UNWINDING
            and each.size
        ]
        at, offsets = 0, {}
        for k, each in wanted:
            at = -(-at // each.align) * each.align
            offsets[k] = at
            at += each.size
        if not wanted:
            continue
        base = _memory(at)
        starts |= {k: base + offset for k, offset in offsets.items()}
        for k, each in wanted:
            if each.kind != _ZEROS:
                ctypes.memmove(starts[k], _content(machine, each), each.size)
        if not written:
            code = (base, at)
    return starts, code


def _memory(size: int) -> int:
    """Address of zeros."""
    memory = mmap.mmap(-1, size)
    _held.append(memory)
    return ctypes.addressof(ctypes.c_char.from_buffer(memory))


def _make_executable(code: tuple[int, int]) -> None:
    base, size = code
    if size and _system().mprotect(
        ctypes.c_void_p(base), ctypes.c_size_t(size), mmap.PROT_READ | mmap.PROT_EXEC
    ):
        raise CannotBeLoadedError("the system lets no memory be run")


@cache
def _system() -> Any:
    """The process with all that it has loaded."""
    return ctypes.CDLL(None)


@cache
def _of_system(name: str) -> int:
    for library in (_system, lambda: ctypes.CDLL("libm.so.6")):
        try:
            return ctypes.cast(getattr(library(), name), ctypes.c_void_p).value or 0
        except (AttributeError, OSError):
            continue
    raise CannotBeLoadedError(f"{name} is not known")


def _addresses(
    symbols: list[_Symbol], names: bytes, starts: dict[int, int], links: dict[str, int]
) -> list[int]:
    """Address of every symbol."""
    common = [k for k, each in enumerate(symbols) if each.section == _COMMON]
    # value: what it is aligned to
    room = sum(symbols[k].size + symbols[k].value for k in common)
    free = _memory(room) if common else 0
    found = []
    for each in symbols:
        if each.section == _COMMON:
            free = -(-free // each.value) * each.value
            found.append(free)
            free += each.size
        elif each.section == _UNDEFINED:
            found.append(_outside(_name(names, each.name), links) if each.name else 0)
        elif each.section == _ABSOLUTE:
            found.append(each.value)
        else:
            found.append(starts.get(each.section, 0) + each.value)
    return found


def _outside(name: str, links: dict[str, int]) -> int:
    for known in (links, GIVEN):
        if name in known:
            return known[name]
    return _of_system(name)


def _fill(places: bytes, start: int, addresses: list[int]) -> None:
    """Write addresses where they belong in a section."""
    for offset, info, more in struct.iter_unpack("<QQq", places):
        target, place = addresses[info >> 32] + more, start + offset
        kind = info & 0xFFFFFFFF
        if kind in (_WHOLE, _WHOLE_FROM_HERE):
            value = target if kind == _WHOLE else target - place
            ctypes.c_uint64.from_address(place).value = value & (1 << 64) - 1
        elif kind in (_FROM_HERE, _CALLED_FROM_HERE) and -(1 << 31) <= target - place < 1 << 31:
            ctypes.c_int32.from_address(place).value = target - place
        else:
            raise CannotBeLoadedError(f"place of kind {kind}")
