"""Finished chunks of a cache on disk, and what a later run may continue from; needs no USD.

    wing.clips/                       (flat and payload layouts: .wing.usdc.parts/)
      lock                            held by the process that writes
      3f2a9c01d2e4b677/               one bake: the digest of all its settings
        bake.json                     the settings themselves
        0000.usdc, 0000.json          a chunk of frames, and its record
        0000.npz                      the solver's state at its end

A chunk counts once its record is there; the record is written last, after chunk and state are on
disk. Only the newest state is kept. A folder of other settings is never mixed with this one.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from featherfx.errors import Problem
from featherfx.files.lock import Lock
from featherfx.files.whole import write_text
from featherfx.shot.fingerprint import settings_digest
from featherfx.usd.types import OutputError

_FORMAT = "2"
_BLOCK = 1 << 18
_SETTINGS = "bake.json"

Save = Callable[[Path], object]


@dataclass(frozen=True)
class ChunkRecord:
    """What is known of a chunk without opening it.

    codes: its time codes. bytes, crc32: of the file. constant: per feather, "1" where all poses
    of the chunk equal the first, else "0". first: per feather, digest of the chunk's first pose.
    low, high: corners of everything in the chunk, stage units.
    """

    codes: tuple[float, ...]
    bytes: int
    crc32: int
    constant: str
    first: tuple[str, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]


class Parts:
    """The chunks of one bake in their folder.

    folder: parts_folder of the output. settings: all that the chunks depend on. keep: whether
    chunks that an earlier run with these settings left are taken over; all others are removed.
    Raises OutputError while another process writes to the same folder.
    """

    def __init__(self, folder: Path, settings: Mapping[str, str], keep: bool) -> None:
        self.folder = folder / settings_digest(settings)
        self._settings = dict(settings)
        folder.mkdir(exist_ok=True)
        try:
            self._lock = Lock(folder / "lock")
        except TimeoutError as error:
            message = "another bake is writing this cache; wait for it or choose another name"
            raise OutputError(Problem(str(folder), "", message)) from error
        self.records: list[ChunkRecord] = []
        try:
            self._start(keep)
        except BaseException:
            self.discard()
            raise

    def _start(self, keep: bool) -> None:
        if keep:
            self.records = self._sound_records()
        self._remove_strays()
        with _told(self.folder):
            self.folder.mkdir(exist_ok=True)
            content = {"format": _FORMAT, "settings": self._settings}
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
        with _told(self.folder):
            if save is not None:
                save(self.state(index))
            write_text(self._record(index), _json(asdict(record)))
        if index:
            self.state(index - 1).unlink(missing_ok=True)
        self.records.append(record)

    def finish(self, keep_chunks: bool) -> None:
        """The cache is published: remove all that is no part of it."""
        if keep_chunks:
            self.state(len(self.records) - 1).unlink(missing_ok=True)
            for other in self.folder.parent.iterdir():
                if other.is_dir() and other != self.folder:
                    shutil.rmtree(other, ignore_errors=True)
            self._lock.release()
        else:
            shutil.rmtree(self.folder.parent, ignore_errors=True)
            self._lock.release()

    def discard(self) -> None:
        """Remove the chunks, and the folder unless something else is in it."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self._lock.release()
        with contextlib.suppress(OSError):
            self.folder.parent.rmdir()

    def close(self) -> None:
        """Leave all as it is, for a later run."""
        self._lock.release()

    @staticmethod
    def are_whole(folder: Path, settings: Mapping[str, str]) -> bool:
        """Whether the chunks of a finished bake are all there, by their sizes."""
        bake = folder / settings_digest(settings)
        records = sorted(bake.glob("[0-9]*.json"))
        found = [(file.with_suffix(".usdc"), _read_record(file)) for file in records]
        return bool(found) and all(
            record is not None and chunk.is_file() and chunk.stat().st_size == record.bytes
            for chunk, record in found
        )

    def _record(self, index: int) -> Path:
        return self.folder / f"{index:04d}.json"

    def _sound_records(self) -> list[ChunkRecord]:
        """Records of the chunks from the first on whose files are what was written."""
        found: list[ChunkRecord] = []
        if _read_settings(self.folder) != self._settings:
            return found
        while (record := _read_record(self._record(len(found)))) is not None:
            file = self.chunk(len(found))
            if not file.is_file() or checksum(file) != (record.bytes, record.crc32):
                break
            found.append(record)
        while found and not self.state(len(found) - 1).is_file():
            found.pop()
        return found

    def _remove_strays(self) -> None:
        """Remove what no kept record speaks of: temporary files, later chunks, old states."""
        if not self.records:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        wanted = {self.folder / _SETTINGS, self.state(len(self.records) - 1)}
        for index in range(len(self.records)):
            wanted |= {self.chunk(index), self._record(index)}
        for file in self.folder.iterdir():
            if file not in wanted:
                file.unlink()


def unfinished_settings(folder: Path) -> list[dict[str, str]]:
    """Settings of the bakes that have chunks in a parts folder."""
    if not folder.is_dir():
        return []
    bakes = [each for each in sorted(folder.iterdir()) if (each / "0000.json").is_file()]
    return [settings for each in bakes if (settings := _read_settings(each))]


def checksum(path: Path) -> tuple[int, int]:
    """Bytes and CRC-32 of a file: tells a damaged file at half the time of a SHA-256."""
    size, crc, block = 0, 0, bytearray(_BLOCK)
    with path.open("rb", buffering=0) as file:
        while count := file.readinto(block):
            crc = zlib.crc32(memoryview(block)[:count], crc)
            size += count
    return size, crc


def _read_settings(folder: Path) -> dict[str, str]:
    content = _read_json(folder / _SETTINGS)
    sound = isinstance(content, dict) and content.get("format") == _FORMAT
    return dict(content["settings"]) if sound else {}


def _read_record(path: Path) -> ChunkRecord | None:
    content = _read_json(path)
    if content is None:
        return None
    lists = {name: tuple(content[name]) for name in ("codes", "first", "low", "high")}
    return ChunkRecord(**(content | lists))


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _json(value: Any) -> str:
    return json.dumps(value, indent=1) + "\n"


@contextlib.contextmanager
def _told(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        message = f"cannot write to this folder: {error.strerror or error}"
        raise OutputError(Problem(str(folder), "", message)) from error
