"""Stored machine code of kernels: where it is, what it was made of, and how it is loaded.

A folder is named by a hash of a kernel file and of all files of this program that it imports. It
stands in the cache (files/folders.py). Further code comes with the program, for processors that
many have. An entry is a SHA-256 of the rest, the length of a head (8 bytes), the head in JSON and
the machine code. A damaged one, or one of another key, counts as missing.

Object files that LLVM writes are loaded without LLVM, which takes 48 MiB of a process. An object
file holds sections, symbols and relocations: places to fill with addresses (System V ABI, ELF-64,
and its supplement for AMD64). Kernels refer to what they call by whole addresses. LLVM loads files
of another format (compiler.py).
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import mmap
import os
import platform
import re
import struct
import sys
from collections import namedtuple
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from featherfx.errors import warn_input
from featherfx.files.atomic_write import write_whole
from featherfx.files.folders import (
    DistrustError,
    cache_folder,
    doubt,
    make_private_folder,
    read_trusted,
    write_private,
)
from featherfx.jit.kernel_calls import KernelLink, ReturnType, StoredKernel

Key = tuple[str, ...]  # types of arguments, system, machine and processor
# works that are about to be done, by names in arguments.json and seconds.json
EXPECTED_WORKS: list[str] = []
ROOT = Path(__file__).resolve().parents[1]
SHIPPED = ROOT / "_machine_code"  # that came with the program
# files that decide how kernels are compiled and stored
_COMPILER = [
    ROOT / f"{name}.py"
    for name in ("algebra/intrinsics", "jit/compiler", "jit/kernel_calls", "jit/kernel_types")
]
# by expression, since parsing the files takes 0.4 s of every run
_IMPORT = re.compile(rb"^from featherfx\.(\S+) import ", re.MULTILINE)
_CHECKSUM_BYTES, _LENGTH_BYTES = hashlib.sha256().digest_size, 8
_CPU_INFO = Path("/proc/cpuinfo")
# lines that tell one processor from another, on x86-64 and on ARM
_CPU_LINES = ("vendor_id", "cpu family", "model", "stepping", "flags")
_ARM_LINES = ("CPU implementer", "CPU part", "CPU variant", "Features")
# Linux's names of features, and LLVM's where they are others
_FEATURE_NAMES = {"bmi1": "bmi", "abm": "lzcnt", "sse4_2": "sse4.2", "asimd": "neon"}
# x86-64-v3: Haswell, Zen and later (x86-64 psABI, table 3.1)
_V3 = ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2")
# by machine: LLVM's name of the processor that code is shipped for, and features that it must have
_TARGETS: dict[str, tuple[str, tuple[str, ...]]] = {
    **dict.fromkeys(("x86_64", "AMD64"), ("x86-64-v3", _V3)),
    **dict.fromkeys(("aarch64", "arm64"), ("generic", ("neon",))),
}


def find_target() -> str:
    """LLVM's name of the processor whose shipped code can run here; empty if there is none."""
    name, needs = _TARGETS.get(platform.machine(), ("", ()))
    return name if set(needs) <= _inspect_processor()[1] else ""


@cache
def shipped_target() -> str:
    """The same where something came with the program, and the user asks for no processor."""
    return find_target() if SHIPPED.is_dir() and not _requested_processor() else ""


def _requested_processor() -> str:
    """The processor and features that the user has numba compile for; empty if none."""
    given = [os.environ.get(f"NUMBA_CPU_{each}") or "" for each in ("NAME", "FEATURES")]
    return " ".join(given).strip()


@cache
def _inspect_processor() -> tuple[str, frozenset[str]]:
    """Identity and features (LLVM's names) of this processor; by Linux, else by LLVM."""
    try:
        first = _CPU_INFO.read_text(encoding="utf-8").split("\n\n")[0]
    except OSError:
        from llvmlite import binding

        features = binding.get_host_cpu_features()
        name = f"{binding.get_host_cpu_name()} {features}"
        return name, frozenset(each for each, there in features.items() if there)
    pairs = (line.partition(":") for line in first.splitlines())
    lines = {key.strip(): value.strip() for key, _, value in pairs}
    identity = repr([lines.get(each) for each in (*_CPU_LINES, *_ARM_LINES)])
    flags = (lines.get("flags") or lines.get("Features", "")).split()
    names = frozenset(_FEATURE_NAMES.get(flag, flag) for flag in flags)
    return hashlib.sha256(identity.encode()).hexdigest()[:16], names


@cache
def _find_imports(source: Path) -> frozenset[Path]:
    """Files of this program that a kernel file imports, itself included.

    Constants and fields of named tuples are in machine code, too.
    """
    found = {source}
    for name in _IMPORT.findall(source.read_bytes()):
        # _COMPILER stands for the decorators
        if name != b"jit.compiled":
            place = ROOT / name.decode().replace(".", "/")
            # a folder of that name may be left of an earlier version
            file = Path(f"{place}.py")
            found |= _find_imports(file if file.is_file() else place / "__init__.py")
    return frozenset(found)


@cache
def hash_source(source: Path) -> str:
    """Name of the folder for the kernels of a file: a hash of all that their code depends on."""
    digest = hashlib.sha256(" ".join(map(version, ("numba", "llvmlite"))).encode())
    for part in (*_COMPILER, *sorted(_find_imports(source))):
        digest.update(part.read_bytes())
    return digest.hexdigest()[:16]


@cache
def code_folder() -> Path:
    """The user's folder of machine code, the same for as long as the process lives."""
    return cache_folder()


@cache
def explain_unloaded(folder: Path) -> str:
    """Why nothing can be loaded from a folder, made if need be; empty if it can."""
    try:
        if fault := doubt(folder):
            return fault
        make_private_folder(folder)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    return "" if os.access(folder, os.R_OK | os.X_OK) else f"no permission to read {folder}"


@cache
def explain_unsaved() -> str:
    """Why code that is compiled now is not stored; empty if it is."""
    if fault := explain_unloaded(code_folder()):
        return f"machine code is not cached, and every run compiles it again: {fault}"
    if os.access(code_folder(), os.W_OK):
        return ""
    return f"no permission to write to {code_folder()}: every run compiles what it lacks"


warn_once = cache(warn_input)  # of what concerns every kernel


def is_stored(kernel: str) -> bool:
    """Return whether a kernel (module and name) has code for any types, or does not exist."""
    module, _, own = kernel.rpartition(".")
    source = ROOT.parent.joinpath(*module.split(".")).with_suffix(".py")
    if not source.is_file():
        return True
    roots = (code_folder(), SHIPPED) if shipped_target() else (code_folder(),)
    return any(any((root / hash_source(source)).glob(f"*.{own}.py*")) for root in roots)


class KernelStore:
    """The stored machine code of one kernel, by the text of its arguments' types."""

    def __init__(self, source: Path, name: str) -> None:
        python = f"py{sys.version_info.major}{sys.version_info.minor}"
        own = name.replace("<locals>", "locals")
        self._folder = hash_source(source.resolve())
        self._name = f"{source.stem}.{own}.{python}"

    def load(self, text: str) -> Iterator[StoredKernel]:
        """Sound code for types: the user's, then what came with the program."""
        for root, file, key in self._find_files(text):
            try:
                stored = read_trusted(root, (file.parent.name, file.name))
            except DistrustError:
                warn_once(f"others can change machine code in {root}: it is not used. Remove it")
                continue
            except OSError:
                continue
            if (code := _decode(stored, key)) is not None:
                yield code

    def holds(self, text: str) -> bool:
        """Return whether there is code for types."""
        return any(True for _ in self._find_files(text))

    def save(self, text: str, code: StoredKernel) -> None:
        """Store compiled code; the work goes on, with a warning, where it cannot be stored."""
        if fault := explain_unsaved():
            warn_once(fault)
            return
        file, key = self._locate(code_folder(), text)
        head = json.dumps([key, code[1:]]).encode()
        content = len(head).to_bytes(_LENGTH_BYTES, "little") + head + code.machine
        whole = hashlib.sha256(content).digest() + content
        try:
            make_private_folder(file.parent)
            write_whole(file, lambda stream: write_private(stream, whole))
        except OSError as error:
            reason = error.strerror or str(error)
            warn_once(f"machine code is not cached in {code_folder()} ({reason})")

    def _find_files(self, text: str) -> Iterator[tuple[Path, Path, Key]]:
        """Files that are there for types, with the folder of all code and their keys."""
        places = [] if explain_unloaded(code_folder()) else [(code_folder(), "")]
        if target := shipped_target():
            places.append((SHIPPED, target))
        for root, target in places:
            file, key = self._locate(root, text, target)
            if file.is_file():
                yield root, file, key

    def _locate(self, root: Path, text: str, target: str = "") -> tuple[Path, Key]:
        """The file of an entry for a target, by default the processor here, and its key."""
        processor = target or _requested_processor() or _inspect_processor()[0]
        key = text, sys.platform, platform.machine(), processor
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return root / self._folder / f"{self._name}.{digest}.code", key


def _decode(stored: bytes, key: Key) -> StoredKernel | None:
    """Stored code; None where it is damaged, of another key, or stored in another form."""
    checksum, content = stored[:_CHECKSUM_BYTES], stored[_CHECKSUM_BYTES:]
    if hashlib.sha256(content).digest() != checksum:
        return None
    end = _LENGTH_BYTES + int.from_bytes(content[:_LENGTH_BYTES], "little")
    try:
        found, (entry, own, returns, links) = json.loads(content[_LENGTH_BYTES:end])
        named = tuple(KernelLink(*each) for each in links)
    except (ValueError, TypeError):
        return None
    stored_kernel = StoredKernel(content[end:], entry, own, _as_returned(returns), named)
    return stored_kernel if tuple(found) == key else None


def _as_returned(given: list[Any]) -> ReturnType:
    kind, parts = given
    return ReturnType(kind, None if parts is None else tuple(map(_as_returned, parts)))


# a section that is in memory, and one that is written to
_ALLOCATED, _WRITTEN = 0x2, 0x1
# kinds of sections: symbols, relocations, tables for unwinding
_SYMBOLS, _RELOCATIONS, _UNWINDING = 2, 4, 0x70000001
_WHOLE = 1  # the kind of relocations that LLVM writes for whole addresses (R_X86_64_64)
# sections of symbols that have none
_UNDEFINED, _ABSOLUTE, _COMMON = 0, 0xFFF1, 0xFFF2


class CannotBeLoadedError(Exception):
    """Machine code that only LLVM can load."""


# of the file format: Elf64_Shdr and Elf64_Sym
_Section = namedtuple("_Section", "name kind flags address offset size link info align width")
_Symbol = namedtuple("_Symbol", "name info other section value size")
_memories: list[Any] = []  # of loaded code, for as long as the process lives


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
    starts, base, size = _place_sections(machine, sections)
    addresses = _find_addresses(symbols, names, starts, links)
    for each in sections:
        if each.kind == _RELOCATIONS and each.info in starts:
            _relocate(_content(machine, each), starts[each.info], addresses)
    protect = mmap.PROT_READ | mmap.PROT_EXEC
    if ctypes.CDLL(None).mprotect(ctypes.c_void_p(base), ctypes.c_size_t(size), protect):
        raise CannotBeLoadedError("the system does not let memory be run")
    return {
        name: address
        for each, name, address in zip(symbols, names, addresses, strict=True)
        if each.section != _UNDEFINED and each.name
    }


def _content(machine: bytes, section: _Section) -> bytes:
    return machine[section.offset : section.offset + section.size]


def _place_sections(machine: bytes, sections: list[_Section]) -> tuple[dict[int, int], int, int]:
    """Copy sections to memory: start of each by its number, and start and size of all.

    Kernels write to no section, and raise nothing: tables for unwinding are left out.
    """
    at, offsets = 0, {}
    for k, each in enumerate(sections):
        if each.flags & _ALLOCATED and each.kind != _UNWINDING and each.size:
            if each.flags & _WRITTEN:
                raise CannotBeLoadedError("sections that are written to")
            offsets[k] = -(-at // each.align) * each.align
            at = offsets[k] + each.size
    base = _allocate(at)
    for k, offset in offsets.items():
        ctypes.memmove(base + offset, _content(machine, sections[k]), sections[k].size)
    return {k: base + offset for k, offset in offsets.items()}, base, at


def _allocate(size: int) -> int:
    """Address of zeros that stay."""
    memory = mmap.mmap(-1, size)
    _memories.append(memory)
    return ctypes.addressof(ctypes.c_char.from_buffer(memory))


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
        if info & 0xFFFFFFFF != _WHOLE:
            raise CannotBeLoadedError(f"relocation of kind {info & 0xFFFFFFFF}")
        value = addresses[info >> 32] + addend & (1 << 64) - 1
        ctypes.c_uint64.from_address(start + offset).value = value
