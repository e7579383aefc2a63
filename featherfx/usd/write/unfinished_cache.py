"""Finished chunks of a cache on disk, and what a later run may continue from; needs no USD.

    wing.clips/                       (flat and payload layouts: .wing.usdc.parts/)
      lock                            held by the process that writes
      3f2a9c01d2e4b677/               one bake: the digest of all its settings
        bake.json                     the settings themselves
        0000.usdc, 0000.json          a chunk of frames, and its record
        0000.npz                      the solver's state at its end

A chunk counts once its record is there; the record is written last, after chunk and state are on
disk, and holds the checksums of both and its own. Only the newest state is kept. A folder of other
settings is never mixed with this one.

What is removed is a bake's own: files of the names above in a folder that is named after the
settings in its bake.json. Links are not followed, and all else stays.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from featherfx.errors import Problem
from featherfx.files.atomic_write import Lock, remove_leftovers, temporary_of, write_text
from featherfx.files.disk_cache import settings_digest
from featherfx.usd.types import BUSY_MESSAGE, BusyError, OutputError
from featherfx.usd.write.output import output_files, parts_folder

MANIFEST = "manifest.usdc"

_FORMAT = "5"
_BLOCK = 1 << 18
_SETTINGS = "bake.json"
_LOCK = "lock"
_FILE = re.compile(r"bake\.json|manifest\.usdc|\d{4,}\.(?:usdc|json|npz)")
_PUBLISHED = re.compile(r"bake\.json|manifest\.usdc|\d{4,}\.(?:usdc|json)")
_FOLDER = re.compile(r"[0-9a-f]{16}")

Save = Callable[[Path], object]


def chunk_error(path: Path) -> OutputError:
    """Return the error for a chunk that is missing or damaged."""
    return OutputError(Problem(str(path), "", "is not the chunk that was written. Bake again"))


@dataclass(frozen=True)
class ChunkRecord:
    """Record of a chunk.

    codes: its time codes. bytes, crc32: of the file. constant: per group of feathers, "1" where all
    poses of the chunk equal the first, else "0". first: per group, digest of that pose. low, high:
    corners of everything in the chunk, stage units. state: bytes and CRC-32 of the solver's state
    at its end, None where none was saved.
    """

    codes: tuple[float, ...]
    bytes: int
    crc32: int
    constant: str
    first: tuple[str, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    state: tuple[int, int] | None = None


class Parts:
    """The chunks of one bake in their folder, while it alone writes this output.

    path: the output. layout: "flat", "payload" or "clips". settings: all that the chunks depend on.
    keep: whether chunks of an earlier run with these settings are reused; all others are removed.
    finished: the cache is published, and only finish will be called. inputs: texts of the bake's
    files, to describe changes to another bake. Raises OutputError while another process writes this
    output or to the same folder, and where the folder's name is taken.
    """

    def __init__(
        self,
        path: Path,
        layout: str,
        settings: Mapping[str, str],
        keep: bool,
        finished: bool = False,
        inputs: Mapping[str, str] | None = None,
    ) -> None:
        folder = parts_folder(path, layout)
        self.folder = folder / settings_digest(settings)
        self._settings, self._inputs = dict(settings), dict(inputs or {})
        self.records: list[ChunkRecord] = []
        self._locks: list[Lock] = []
        with _output_errors(path.parent):
            self._lock(lock_file(path), path)
        try:
            _refuse_foreign(folder, self.folder)
            with _output_errors(folder):
                folder.mkdir(exist_ok=True)
                self._lock(folder / _LOCK, folder)
                if not finished:
                    self._start(keep)
            for file in output_files(path, "payload"):
                remove_leftovers(file)
        except BaseException:
            if keep:
                self.close()
            else:
                self.discard()
            raise

    def _lock(self, file: Path, output: Path) -> None:
        try:
            self._locks.append(Lock(file))
        except TimeoutError as error:
            raise BusyError(Problem(str(output), "", BUSY_MESSAGE)) from error

    def _start(self, keep: bool) -> None:
        if keep:
            self.records = self._sound_records()
        self._remove_strays()
        self.folder.mkdir(exist_ok=True)
        content = {"format": _FORMAT, "settings": self._settings, "inputs": self._inputs}
        write_text(self.folder / _SETTINGS, _json(content))

    def chunk(self, index: int) -> Path:
        """USD file of a chunk."""
        return self.folder / f"{index:04d}.usdc"

    def state(self, index: int) -> Path:
        """File of the solver's state at the end of a chunk."""
        return self.folder / f"{index:04d}.npz"

    def commit(self, record: ChunkRecord, save: Save | None) -> None:
        """Add the next chunk, whose file is there already. save: writes the state to a path.

        Raises OutputError where the system refuses; then the chunk does not count.
        """
        index = len(self.records)
        with _output_errors(self.folder):
            if save is not None:
                save(self.state(index))
                record = replace(record, state=compute_checksum(self.state(index)))
            self._write_record(index, record)
        if index:
            self.state(index - 1).unlink(missing_ok=True)
        self.records.append(record)

    def adopt(self, piece: Path) -> None:
        """Take over the next chunks from an unfinished cache in the clips layout.

        They must be its first ones; they stay there. Raises OutputError where they are damaged.
        """
        files = sorted((parts_folder(piece, "clips") / self.folder.name).glob("[0-9]*.json"))
        if not files:
            raise chunk_error(piece)
        for file in files:
            record, chunk = _read_record(file), file.with_suffix(".usdc")
            with _output_errors(self.folder):
                if record is None or compute_checksum(chunk) != (record.bytes, record.crc32):
                    raise chunk_error(piece)
                _link_file(chunk, self.chunk(len(self.records)))
                _link_file(file, self._record(len(self.records)))
            self.records.append(record)

    def _write_record(self, index: int, record: ChunkRecord) -> None:
        content = asdict(record)
        write_text(self._record(index), _json(content | {"check": _record_checksum(content)}))

    def finish(self, keep_chunks: bool) -> None:
        """Remove all files of bakes here that are no part of the published cache.

        Records then describe the cache alone, not how it was made.
        """
        if keep_chunks:
            with _output_errors(self.folder):
                for file in self.folder.glob("[0-9]*.json"):
                    if (record := _read_record(file)) is not None and record.state:
                        self._write_record(int(file.stem), replace(record, state=None))
        for bake in _list_bakes(self.folder.parent):
            kept = bake.iterdir() if keep_chunks and bake == self.folder else ()
            _remove_bake(bake, {file for file in kept if _PUBLISHED.fullmatch(file.name)})
        self._release()

    def discard(self) -> None:
        """Remove the chunks, and the folder unless something else is in it."""
        if len(self._locks) == 2:
            _remove_bake(self.folder)
        self._release()

    def close(self) -> None:
        """Keep all files for a later run."""
        self._release()

    def _release(self) -> None:
        while self._locks:
            # the output's last, when nothing is left to do
            self._locks.pop().release()
            with contextlib.suppress(OSError):
                self.folder.parent.rmdir()

    @staticmethod
    def are_whole(folder: Path, settings: Mapping[str, str]) -> bool:
        """Return whether the chunks of a finished bake are all there, by their sizes."""
        records = sorted((folder / settings_digest(settings)).glob("[0-9]*.json"))
        found = [(file.with_suffix(".usdc"), _read_record(file)) for file in records]
        return bool(found) and all(
            record is not None and chunk.is_file() and chunk.stat().st_size == record.bytes
            for chunk, record in found
        )

    def _record(self, index: int) -> Path:
        return self.folder / f"{index:04d}.json"

    def _sound_records(self) -> list[ChunkRecord]:
        """Return records of the chunks from the first on whose files are intact."""
        found: list[ChunkRecord] = []
        if _read_settings(self.folder) != self._settings:
            return found
        while (record := _read_record(self._record(len(found)))) is not None:
            file = self.chunk(len(found))
            if not file.is_file() or compute_checksum(file) != (record.bytes, record.crc32):
                break
            found.append(record)
        while found:
            state = self.state(len(found) - 1)
            if state.is_file() and compute_checksum(state) == found[-1].state:
                break
            found.pop()
        return found

    def _remove_strays(self) -> None:
        """Remove files without a record: temporary files, later chunks, old states."""
        wanted = {self.folder / _SETTINGS, self.state(len(self.records) - 1)}
        for index in range(len(self.records)):
            wanted |= {self.chunk(index), self._record(index)}
        _remove_bake(self.folder, wanted if self.records else set())


def _link_file(file: Path, target: Path) -> None:
    """Give a constant file a second name; a copy where the system cannot."""
    try:
        os.link(file, target)
    except OSError:
        shutil.copyfile(file, target)


def lock_file(path: Path) -> Path:
    """Return the lock file beside an output; it exists during a bake, and after a kill."""
    return path.with_name(f".{path.name}.lock")


def _refuse_foreign(folder: Path, bake: Path) -> None:
    """Raise OutputError where the folder of the chunks is not featherfx's own."""
    for place in (folder, bake):
        if place.is_symlink():
            message = "is a link, which is not followed. Remove it or choose another name"
            raise OutputError(Problem(str(place), "", message))
        if place.exists() and not place.is_dir():
            message = "is where the chunks go, but no folder. Remove it or choose another name"
            raise OutputError(Problem(str(place), "", message))
    with _output_errors(folder):
        found = sorted(each.name for each in folder.iterdir()) if folder.exists() else []
    others = [name for name in found if name not in (_LOCK, bake.name)]
    if others and not bake.exists() and not _list_bakes(folder):
        message = f"is where the chunks go, but holds others' files ({others[0]}). Choose another"
        raise OutputError(Problem(str(folder), "", f"{message} name or move them away"))


def _list_bakes(folder: Path) -> list[Path]:
    """Return the folders of bakes in a parts folder, known by their records."""
    try:
        found = sorted(folder.iterdir())
    except OSError:
        return []
    return [
        each
        for each in found
        if _FOLDER.fullmatch(each.name)
        and each.is_dir()
        and not each.is_symlink()
        and (settings_digest(_read_any_settings(each)) == each.name or _has_just_begun(each))
    ]


def _has_just_begun(bake: Path) -> bool:
    """Return whether a bake was killed before it had written its settings."""
    return all(temporary_of(file.name) == _SETTINGS for file in bake.iterdir())


def _rank_of_removal(file: Path) -> tuple[bool, bool, str]:
    return file.name == _SETTINGS, file.suffix != ".json", file.name


def _remove_bake(bake: Path, wanted: Collection[Path] = ()) -> None:
    """Remove a bake's own files but those that are wanted, and its folder if nothing is left.

    A chunk's record goes before the chunk, the settings go last: a kill between leaves no record of
    a file that is gone, and the rest is still known as this bake's.
    """
    with contextlib.suppress(OSError):
        if bake.is_symlink():
            return
        for file in sorted(bake.iterdir(), key=_rank_of_removal):
            own = _FILE.fullmatch(file.name) or _FILE.fullmatch(temporary_of(file.name))
            if own and file not in wanted and file.is_file() and not file.is_symlink():
                file.unlink()
        if not wanted:
            bake.rmdir()


def remove_cache(path: Path) -> None:
    """Remove a cache in the clips layout, finished or not, that nobody is writing."""
    folder = parts_folder(path, "clips")
    for bake in _list_bakes(folder):
        _remove_bake(bake)
    with contextlib.suppress(OSError):
        for file in (*output_files(path, "clips"), lock_file(path), folder / _LOCK):
            remove_leftovers(file)
            if file.is_file() and not file.is_symlink():
                file.unlink()
        folder.rmdir()


def list_unfinished_bakes(folder: Path) -> list[tuple[dict[str, str], dict[str, str]]]:
    """Return settings and inputs of the bakes that have chunks in a parts folder."""
    begun = [each for each in _list_bakes(folder) if (each / "0000.json").is_file()]
    return [(settings, _read_inputs(each)) for each in begun if (settings := _read_settings(each))]


def list_chunk_files(
    folder: Path, settings: Mapping[str, str]
) -> list[tuple[tuple[float, ...], Path]]:
    """Return time codes and files of the chunks of a finished bake, in order."""
    records = sorted((folder / settings_digest(settings)).glob("[0-9]*.json"))
    found = [(_read_record(file), file.with_suffix(".usdc")) for file in records]
    return [(record.codes, file) for record, file in found if record is not None]


def count_unfinished_samples(folder: Path) -> int:
    """Return the number of samples in the chunks of a parts folder."""
    records = (
        _read_record(file) for bake in _list_bakes(folder) for file in bake.glob("[0-9]*.json")
    )
    return sum(len(record.codes) for record in records if record is not None)


def refuse_unfinished(path: Path) -> None:
    """Raise OutputError where a new bake would remove samples of an interrupted one.

    A bake that is running is reported when this one begins to write.
    """
    kept = sum(count_unfinished_samples(parts_folder(path, layout)) for layout in ("flat", "clips"))
    if kept and not path.exists() and not _is_being_written(path):
        message = (
            f"holds {kept} sample{'s' * (kept > 1)} of a bake that did not come to its end. "
            "--resume goes on after them, --overwrite removes them and bakes anew"
        )
        raise OutputError(Problem(str(path), "", message))


def _is_being_written(path: Path) -> bool:
    try:
        if lock_file(path).exists():
            Lock(lock_file(path)).release()
    except (OSError, TimeoutError):
        return True
    return False


def compute_checksum(path: Path) -> tuple[int, int]:
    """Return bytes and CRC-32 of a file, at half the time of a SHA-256."""
    size, crc, block = 0, 0, bytearray(_BLOCK)
    with path.open("rb", buffering=0) as file:
        while count := file.readinto(block):
            crc = zlib.crc32(memoryview(block)[:count], crc)
            size += count
    return size, crc


def _read_settings(folder: Path) -> dict[str, str]:
    """Return the settings of a bake of this format; empty where there is none."""
    content = _read_json(folder / _SETTINGS)
    return _read_any_settings(folder) if content.get("format") == _FORMAT else {}


def _read_any_settings(folder: Path) -> dict[str, str]:
    """Return the settings of a bake of any format."""
    settings = _read_json(folder / _SETTINGS).get("settings")
    return settings if isinstance(settings, dict) else {}


def _read_inputs(folder: Path) -> dict[str, str]:
    """Return the texts of the files of a bake."""
    inputs = _read_json(folder / _SETTINGS).get("inputs")
    return inputs if isinstance(inputs, dict) else {}


def _read_record(path: Path) -> ChunkRecord | None:
    """Return a record as it was written; None where it is missing or damaged."""
    content = _read_json(path)
    check = content.pop("check", None)
    if not content or check != _record_checksum(content):
        return None
    names = ("codes", "first", "low", "high", "state")
    lists = {name: tuple(content[name]) for name in names if content[name] is not None}
    return ChunkRecord(**(content | lists))


def _record_checksum(content: Mapping[str, Any]) -> int:
    """Return the checksum of a record, the same before and after it is stored."""
    return zlib.crc32(json.dumps(content).encode())


def _read_json(path: Path) -> dict[str, Any]:
    """Return a JSON object; empty where there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _json(value: Any) -> str:
    return json.dumps(value, indent=1) + "\n"


@contextlib.contextmanager
def _output_errors(folder: Path) -> Iterator[None]:
    try:
        yield
    except FileExistsError as error:
        message = f"{error.strerror}. Remove it or choose another name"
        raise OutputError(Problem(str(error.filename), "", message)) from error
    except OSError as error:
        message = f"cannot write to this folder: {error.strerror or error}"
        raise OutputError(Problem(str(folder), "", message)) from error
