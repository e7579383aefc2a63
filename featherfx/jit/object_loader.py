"""A loader of the object files that LLVM writes, without LLVM, which takes 48 MiB of a process.

An object file holds sections, symbols and relocations: places to fill with addresses (System V
ABI, ELF-64, and its supplement for AMD64). Kernels refer to what they call by whole addresses.
LLVM loads files of another format (compiler.py).
"""

from __future__ import annotations

import ctypes
import mmap
import platform
import struct
import sys
from collections import namedtuple
from typing import Any

# flags of a section: written to, in memory
_WRITTEN, _ALLOCATED = 0x1, 0x2
# kinds of sections: symbols, relocations, zeros that are not in the file, tables for unwinding
_SYMBOLS, _RELOCATIONS, _ZEROS, _UNWINDING = 2, 4, 8, 0x70000001
# kinds of relocations (R_X86_64_*): 64, PC32, PLT32, PC64
_WHOLE, _FROM_HERE, _CALLED_FROM_HERE, _WHOLE_FROM_HERE = 1, 2, 4, 24
# sections of symbols that have none
_UNDEFINED, _ABSOLUTE, _COMMON = 0, 0xFFF1, 0xFFF2


class CannotBeLoadedError(Exception):
    """Machine code that only LLVM can load."""


# of the file format: Elf64_Shdr and Elf64_Sym
_Section = namedtuple("_Section", "name kind flags address offset size link info align width")
_Symbol = namedtuple("_Symbol", "name info other section value size")
# memory of loaded code, for as long as the process lives
_memories: list[Any] = []


def can_load() -> bool:
    """Return whether object files of this system are loaded here."""
    return sys.platform == "linux" and platform.machine() == "x86_64"


def load_object(machine: bytes, links: dict[str, int]) -> dict[str, int]:
    """Load an object file; addresses by name of the functions that it defines.

    links: addresses by name of further functions that it calls. Raises CannotBeLoadedError.
    """
    if not can_load() or machine[:6] != b"\x7fELF\x02\x01":
        raise CannotBeLoadedError("of another system")
    (offset,) = struct.unpack_from("<Q", machine, 0x28)
    width, count = struct.unpack_from("<HH", machine, 0x3A)
    headers = struct.iter_unpack("<IIQQQQIIQQ", machine[offset : offset + width * count])
    sections = [_Section(*each) for each in headers]
    (table,) = (each for each in sections if each.kind == _SYMBOLS)
    fields = struct.iter_unpack("<IBBHQQ", _content(machine, table))
    symbols = [_Symbol(*each) for each in fields]
    text = _content(machine, sections[table.link])
    names = [text[each.name : text.index(b"\0", each.name)].decode() for each in symbols]
    starts, code = _place_sections(machine, sections)
    addresses = _find_addresses(symbols, names, starts, links)
    for each in sections:
        if each.kind == _RELOCATIONS and each.info in starts:
            _relocate(_content(machine, each), starts[each.info], addresses)
    _make_executable(*code)
    return {
        name: address
        for each, name, address in zip(symbols, names, addresses, strict=True)
        if each.section != _UNDEFINED and each.name
    }


def _content(machine: bytes, section: _Section) -> bytes:
    return machine[section.offset : section.offset + section.size]


def _place_sections(
    machine: bytes, sections: list[_Section]
) -> tuple[dict[int, int], tuple[int, int]]:
    """Copy sections to memory: start of each by its number, and start and size of all code.

    Tables for unwinding are left out: kernels raise nothing.
    """
    starts: dict[int, int] = {}
    code = (0, 0)
    for written in (False, True):
        at, offsets = 0, {}
        for k, each in enumerate(sections):
            fits = each.flags & _ALLOCATED and bool(each.flags & _WRITTEN) == written
            if fits and each.kind != _UNWINDING and each.size:
                offsets[k] = -(-at // each.align) * each.align
                at = offsets[k] + each.size
        if not offsets:
            continue
        base = _allocate(at)
        for k, offset in offsets.items():
            starts[k] = base + offset
            if sections[k].kind != _ZEROS:
                ctypes.memmove(starts[k], _content(machine, sections[k]), sections[k].size)
        if not written:
            code = (base, at)
    return starts, code


def _allocate(size: int) -> int:
    """Address of zeros that stay."""
    memory = mmap.mmap(-1, size)
    _memories.append(memory)
    return ctypes.addressof(ctypes.c_char.from_buffer(memory))


def _make_executable(base: int, size: int) -> None:
    protect = mmap.PROT_READ | mmap.PROT_EXEC
    address, length = ctypes.c_void_p(base), ctypes.c_size_t(size)
    if size and ctypes.CDLL(None).mprotect(address, length, protect):
        raise CannotBeLoadedError("the system does not let memory be run")


def _find_in_system(name: str) -> int:
    """Address of a function of the libraries that Python links: libc and libm."""
    try:
        return ctypes.cast(getattr(ctypes.CDLL(None), name), ctypes.c_void_p).value or 0
    except AttributeError as error:
        raise CannotBeLoadedError(f"{name} is not known") from error


def _find_addresses(
    symbols: list[_Symbol], names: list[str], starts: dict[int, int], links: dict[str, int]
) -> list[int]:
    """Address of every symbol."""
    # the value of a common symbol is its alignment
    common = sum(each.size + each.value for each in symbols if each.section == _COMMON)
    free = _allocate(common) if common else 0
    found = []
    for each, name in zip(symbols, names, strict=True):
        if each.section == _COMMON:
            free = -(-free // each.value) * each.value
            found.append(free)
            free += each.size
        elif each.section == _UNDEFINED:
            found.append(links[name] if name in links else _find_in_system(name) if name else 0)
        elif each.section == _ABSOLUTE:
            found.append(each.value)
        else:
            found.append(starts.get(each.section, 0) + each.value)
    return found


def _relocate(places: bytes, start: int, addresses: list[int]) -> None:
    """Write addresses where they belong in a section."""
    for offset, info, addend in struct.iter_unpack("<QQq", places):
        target, place = addresses[info >> 32] + addend, start + offset
        kind = info & 0xFFFFFFFF
        if kind in (_WHOLE, _WHOLE_FROM_HERE):
            value = target if kind == _WHOLE else target - place
            ctypes.c_uint64.from_address(place).value = value & (1 << 64) - 1
        elif kind in (_FROM_HERE, _CALLED_FROM_HERE) and -(1 << 31) <= target - place < 1 << 31:
            ctypes.c_int32.from_address(place).value = target - place
        else:
            raise CannotBeLoadedError(f"relocation of kind {kind}")
