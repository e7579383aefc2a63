"""Work of a worker for a job: look at a shot, bake a share of it, merge its shares.

A worker holds nothing between two orders: all that one leaves is on disk, so that another worker
goes on after its last finished chunk.

A job has an output for every shot, and its shares until they are merged:

FOLDER/wing.usdc                       an output
FOLDER/.wing.usdc.shares/              until it is there
  shares.json                          how many
  wing.2of4.usdc, wing.2of4.clips/ ... a cache for each share (usd/write/layers.py)
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from featherfx.baking.bake import carry_out, open_task
from featherfx.baking.entries import drawn_entries
from featherfx.baking.options import BakeOptions
from featherfx.baking.plan import merge, merge_piece
from featherfx.baking.task import BakeTask, part_path
from featherfx.errors import InputError, InputWarning, Problem, require
from featherfx.files.atomic_write import write_text
from featherfx.files.disk_cache import program_digest
from featherfx.groom.read.toml_file import load_toml
from featherfx.phases import Account
from featherfx.shot.contact.partition import share_count, share_sizes
from featherfx.usd.types import ACCELERATIONS, BusyError, StageSpace
from featherfx.usd.write.cache_writer import chunk_frames
from featherfx.usd.write.output import USD_SUFFIXES
from featherfx.usd.write.poses import make_posed_feathers
from featherfx.usd.write.unfinished_cache import remove_cache

if TYPE_CHECKING:
    from featherfx.usd.write.stages import Bodies

# of a worker: FROM=TO for paths of the machine that gives the work, with os.pathsep between
_PATHS_VARIABLE = "FEATHERFX_PATHS"
_RECORD = "shares.json"


def outputs_of(shots: Sequence[Path], where: Path) -> list[Path]:
    """An output for each shot, in its order: a folder's files are named after the shots' files,
    and where several have one name, after the shots themselves.

    where: a folder, or for one shot also a USD file. Raises InputError where two outputs would be
    one.
    """
    if where.suffix in USD_SUFFIXES and not where.is_dir():
        if len(shots) == 1:
            return [where]
        message = f"is a file. Name a folder for {len(shots)} shots"
        raise InputError(Problem(str(where), "output", message))
    taken = Counter(shot.stem for shot in shots)
    names = [shot.stem if taken[shot.stem] == 1 else _name_of(shot) for shot in shots]
    problems = []
    for k, (shot, name) in enumerate(zip(shots, names, strict=True)):
        if name in names[:k]:
            other = shots[names.index(name)]
            problems.append(Problem(str(shot), "", f"would be {name}.usdc, as {other} is"))
    require(*problems)
    return [where / f"{name}.usdc" for name in names]


def _name_of(shot: Path) -> str:
    """The name that a shot file gives itself; wrong files are told of when they are read."""
    name = shot.stem
    with contextlib.suppress(InputError):
        name = str(load_toml(shot).get("name", name))
    return re.sub(r"[^\w.-]+", "_", name)


class Shares:
    """The shares of one output while they are baked. output: of the whole."""

    def __init__(self, output: Path) -> None:
        self._output = output
        self.folder = output.with_name(f".{output.name}.shares")

    def files(self, count: int) -> list[Path]:
        """The cache of each of so many shares."""
        return [part_path(self.target, (k, count)) for k in range(1, count + 1)]

    @property
    def target(self) -> Path:
        """Path that a share's bake takes for the output of the whole."""
        return self.folder / self._output.name

    def piece(self, place: tuple[int, int]) -> Path:
        """Return the path of a run of chunks of the whole, the i-th of n, until all are there:
        those of an unfinished cache at this path."""
        name = "{}.piece{}of{}{}".format(self._output.stem, *place, self._output.suffix)
        return self.folder / name

    def begun(self) -> int:
        """Number of shares that an earlier job has begun; 0: none."""
        try:
            found = json.loads((self.folder / _RECORD).read_text(encoding="utf-8"))
            return int(found["shares"])
        except (OSError, ValueError, TypeError, KeyError):
            return 0

    def begin(self, count: int) -> None:
        """Make room. Raises OSError where the system refuses."""
        self.folder.mkdir(exist_ok=True)
        write_text(self.folder / _RECORD, json.dumps({"shares": count}) + "\n")

    def remove(self) -> None:
        """Remove what a job has left here; links are not followed, and all else stays."""
        count = self.begun()
        if not count or self.folder.is_symlink():
            return
        pieces = self.folder.glob(f"{self._output.stem}.piece*.clips")
        for file in (
            *self.files(count),
            *(each.with_suffix(self._output.suffix) for each in pieces),
        ):
            remove_cache(file)
        with contextlib.suppress(OSError):
            (self.folder / _RECORD).unlink()
            self.folder.rmdir()


def mapped(path: str) -> str:
    """A path of the machine that gives the work, as this worker has it."""
    pairs = os.environ.get(_PATHS_VARIABLE, "").split(os.pathsep)
    for given, _, own in (pair.partition("=") for pair in pairs if "=" in pair):
        if path == given or path.startswith(given.rstrip("/\\") + "/"):
            return own + path[len(given) :]
    return path


PLAN, BAKE, MERGE = "look at", "bake", "merge"
# s for which a share may still be written by a worker that is thought to be lost, and between looks
_PATIENCE, _PAUSE = 60.0, 1.0


@dataclass(frozen=True)
class Order:
    """Work for one worker.

    what: PLAN, BAKE or MERGE. shot, output: paths on the machine that gives the work. options:
    fields of BakeOptions. shares: into how many the shot is cut, at most while it is looked at.
    share: from 1, 0 where it is about all of them. chunk: frames of a chunk of the whole. pieces:
    runs of chunks that are merged by several workers; piece: from 1, 0 for all of them.
    program: digest of the program that gives the work.
    """

    what: str
    shot: str
    output: str
    options: Mapping[str, Any]
    shares: int
    program: str
    share: int = 0
    chunk: int = 0
    pieces: int = 0
    piece: int = 0


@dataclass(frozen=True)
class OrderResult:
    """Result of an order. report: of a bake, or of a look: feathers, samples, shares and their
    sizes (feathers of each), chunk and finished. times: s that it took by the clock and of the
    processor. warnings: that it gave."""

    report: dict[str, Any]
    times: dict[str, float]
    warnings: tuple[str, ...]


def work(order: Order, notify: Callable[[int, int], None]) -> OrderResult:
    """Carry out an order; raises what a bake raises.

    notify: called with the samples done and their number; ends the work by raising.
    """
    if order.program != program_digest():
        message = "has another version of featherfx or numpy. Install the same on all machines"
        raise InputError(Problem(os.uname().nodename, "", message))
    begin, spent = time.perf_counter(), time.process_time()
    order = replace(order, shot=mapped(order.shot), output=mapped(order.output))
    with warnings.catch_warnings(record=True) as said, Account():
        warnings.simplefilter("always", InputWarning)
        report = _when_free(lambda: _WORK[order.what](order, notify))
    told = tuple(str(each.message) for each in said if issubclass(each.category, InputWarning))
    times = {
        "wall_seconds": time.perf_counter() - begin,
        "processor_seconds": time.process_time() - spent,
    }
    return OrderResult(report, times, tuple(dict.fromkeys(told)))


def _when_free(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Do what writes an output, which a worker that is thought to be lost may still be writing."""
    until = time.monotonic() + _PATIENCE
    while True:
        try:
            return work()
        except BusyError:
            if time.monotonic() > until:
                raise
        time.sleep(_PAUSE)


def _prepared(order: Order, output: Path, **changed: Any) -> BakeTask:
    folders = [mapped(str(each)) for each in order.options["preset_folders"]]
    options = {**order.options, "preset_folders": folders, **changed}
    return open_task(order.shot, output, BakeOptions(**options))


def _look(order: Order, notify: Callable[[int, int], None]) -> dict[str, Any]:
    """Check a shot and describe its work."""
    task = _prepared(order, Path(order.output))
    shares = share_count(task.shot, order.shares) if task.options.can_be_taken_over else 1
    # most of the feathers are taken over from the cache that is there
    if task.finished or task.taken is not None:
        shares = 1
    return {
        "shot": task.shot.name,
        "feathers": len(task.names),
        "frames": task.frames[1] - task.frames[0] + 1,
        "samples": task.samples,
        "shares": shares,
        "sizes": share_sizes(task.shot, shares),
        "chunk": _chunk(task) if shares > 1 else 0,
        "subframes": task.options.subframes,
        "finished": task.finished,
    }


def _chunk(task: BakeTask) -> int:
    """Frames of a chunk of the whole."""
    shot, options = task.shot, task.options
    entries = drawn_entries(shot.groom, shot.quality, options, task.names, shot.skin, shot.wets)
    extras = {*options.diagnostics, *([ACCELERATIONS] * options.accelerations)}
    return chunk_frames(options, make_posed_feathers(entries, StageSpace(), extras))


def _bake(order: Order, notify: Callable[[int, int], None]) -> dict[str, Any]:
    """A share, or the whole where there is only one, from where an earlier worker has left it."""
    output, changed = Path(order.output), dict[str, Any](resume=True)
    if order.shares > 1:
        output = Shares(output).target
        changed |= {"layout": "clips", "feathers": (order.share, order.shares)}
        changed |= {"chunk": order.chunk}
    task = _prepared(order, output, **changed)
    if order.shares > 1:
        # as merging takes over whole chunks
        task = replace(task, frames_each=order.chunk, bodies=_whole_bodies(task, order))
    if order.options["overwrite"] and order.shares == 1:
        task = replace(task, finished=False, taken=None)
    return carry_out(task, notify)


def _merge(order: Order, notify: Callable[[int, int], None]) -> dict[str, Any]:
    overwrite, own = order.options["overwrite"], Shares(Path(order.output))
    task = _prepared(order, Path(order.output), resume=not overwrite)
    files = own.files(order.shares)
    if task.finished:
        return {}
    if order.piece:
        place = order.piece, order.pieces
        merge_piece(task, files, notify, own.piece(place), place)
    else:
        pieces = [own.piece((number, order.pieces)) for number in range(1, order.pieces + 1)]
        merge(task, files, notify, pieces)
    return {}


def _whole_bodies(task: BakeTask, order: Order) -> Bodies:
    """Bodies of a share, whose layers stand beside the cache of the whole."""
    return {Path(order.output).with_name(each.name): own for each, own in task.bodies.items()}


_WORK = {PLAN: _look, BAKE: _bake, MERGE: _merge}

BEGUN, SHARE_PROGRESS, DONE, FAILED, LOST, QUIET = (
    "begun",
    "progress",
    "done",
    "failed",
    "lost",
    "quiet",
)


@dataclass(frozen=True)
class OrderNews:
    """News about an order.

    what: BEGUN; SHARE_PROGRESS, with value the samples done and their number; DONE, with an
    OrderResult;
    FAILED, with an exception; LOST: every worker that took it was lost; QUIET: there was no news
    for a while, with the number of workers. number: of the order. place: address of the worker,
    with the number of its process.
    """

    what: str
    number: int = -1
    place: str = ""
    value: Any = None


class Engine(Protocol):
    """workers: their number when it was opened."""

    workers: int

    def meet(self) -> None:
        """Wait until they are there."""

    def submit(self, number: int, order: Order, avoid: str = "") -> None:
        """Give an order to a worker, not to the one to avoid if there are others. One that is lost
        is replaced."""

    def cancel(self, number: int) -> None:
        """Take an order back, or end its work at the next sample."""

    def share_out(self, busy: int) -> None:
        """Let so many workers have the machine's cores, where all are of one machine."""

    def hear(self) -> OrderNews:
        """The next news; waits for it, some seconds at most."""
