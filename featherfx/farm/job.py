"""One job of many shots, or of the shares of one: its order, its retries and its report.

Every shot is looked at first, and nothing is baked unless all are sound. Then its shares are baked
in any order, each by whatever worker is free, and merged when the last is there. Where a worker is
lost the engine gives its order to another, which goes on after the last chunk on disk. An order
that cannot write is tried by other workers, whose disks may have room; what fails otherwise would
fail again, and ends its shot. Other shots go on.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from featherfx._version import __version__
from featherfx.baking.bake import store_report
from featherfx.baking.options import BakeOptions, make_options, takes
from featherfx.baking.task import check_report
from featherfx.errors import InputError, Problem, SimulationError, require_type
from featherfx.farm.cluster import opened
from featherfx.farm.work import (
    BAKE,
    DONE,
    FAILED,
    LOST,
    MERGE,
    PLAN,
    QUIET,
    SHARE_PROGRESS,
    Engine,
    Order,
    OrderNews,
    OrderResult,
    Shares,
    outputs_of,
)
from featherfx.files.atomic_write import Lock, standing
from featherfx.files.disk_cache import keep, kept_before, program_digest
from featherfx.files.folders import SHIPPED_PRESETS, own_folders
from featherfx.phases import Progress, listener_of
from featherfx.usd.types import BUSY_MESSAGE, OutputError
from featherfx.usd.write.unfinished_cache import lock_file

# how often an order is given to a worker when what it writes is refused
_TRIES = 3
# shares for each worker, so that those that are done early take over from others
_SHARES_EACH = 2
_SHARE_TIMES = "share-times"  # key of the disk cache

_LOG = logging.getLogger("featherfx.farm")


@dataclass
class _ShotState:
    """A shot of the job: its plan once it is looked at, what became of its orders.

    looked: times of looking at it. left: shares that are not baked yet. baked: reports of the
    others. runs, pieces: of chunks that are merged, and reports of those that are there.
    problems: that ended it. past: processor s of a sample of each share in an earlier job, none
    where they are not known.
    """

    shot: Path
    output: Path
    shares: Shares
    plan: dict[str, Any] = field(default_factory=dict)
    looked: dict[str, float] = field(default_factory=dict)
    left: int = 0
    baked: list[dict[str, Any]] = field(default_factory=list)
    runs: int = 0
    pieces: list[dict[str, Any]] = field(default_factory=list)
    merged: dict[str, Any] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    lock: Lock | None = None
    past: list[float] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.output.stem

    def release(self) -> None:
        if self.lock is not None:
            self.lock.release()
            self.lock = None


@dataclass
class _Given:
    """An order that is out. worker: that has it. lost: that had it. done: part of it. tries: how
    often it was given."""

    shot: _ShotState
    order: Order
    worker: str = ""
    lost: list[str] = field(default_factory=list)
    done: float = 0.0
    tries: int = 1

    @property
    def name(self) -> str:
        order = self.order
        if order.what == BAKE and order.shares > 1:
            return f"{self.shot.name} {order.share}/{order.shares}"
        if order.piece:
            return f"{self.shot.name} merging {order.piece}/{order.pieces}"
        return f"{self.shot.name} merging" if order.what == MERGE else self.shot.name


class Job:
    """Shots to outputs by the workers of an engine.

    options: fields of BakeOptions for all shots. shares: for each shot, None: by the workers.
    notify: called with the frames done of all shots and their number.
    """

    def __init__(
        self,
        shots: Sequence[Path],
        outputs: Sequence[Path],
        options: dict[str, Any],
        engine: Engine,
        shares: int | None,
        notify: Callable[[float, float], None],
    ) -> None:
        self._options, self._engine, self._notify = options, engine, notify
        self._shots = [
            _ShotState(shot.absolute(), output.absolute(), Shares(output.absolute()))
            for shot, output in zip(shots, outputs, strict=True)
        ]
        one_each = engine.workers == 1 or len(shots) >= _SHARES_EACH * engine.workers
        by_workers = 1 if one_each else -(-_SHARES_EACH * engine.workers // len(shots))
        self._wanted = shares or by_workers
        self._out: dict[int, _Given] = {}
        self._finished: list[_Given] = []
        self._number, self._told = 0, 0.0
        self._begin_at = self._looked_at = self._baked_at = 0.0

    def run(self) -> list[dict[str, Any]]:
        """A report of each shot. Raises InputError with all that is wrong with any shot."""
        self._begin_at = time.perf_counter()
        try:
            self._look_at_all()
            self._engine.meet()
            self._looked_at = self._baked_at = time.perf_counter()
            begun = [(each, part) for each in self._shots for part in self._begin(each)]
            self._engine.share_out(len(begun))
            for each, order in self._longest_first(begun):
                self._give(each, order)
            self._until_all_are_heard()
        finally:
            for number in self._out:
                self._engine.cancel(number)
            for each in self._shots:
                each.release()
        self._raise_problems()
        return [self._report(each) for each in self._shots]

    def seconds(self) -> dict[str, float]:
        """Return s of a job that has just ended: until all shots were looked at and workers were
        there, until the last share was baked, and of merging from there on."""
        looking, baking = self._looked_at - self._begin_at, self._baked_at - self._looked_at
        merging = time.perf_counter() - self._baked_at
        return {"looking": looking, "baking": baking, "merging": merging}

    def _look_at_all(self) -> None:
        for each in self._shots:
            self._refuse_begun(each)
        self._raise_problems()
        for each in self._shots:
            self._give(each, self._order(each, PLAN, each.shares.begun() or self._wanted))
        self._until_all_are_heard()
        self._raise_problems()

    def _refuse_begun(self, each: _ShotState) -> None:
        """Shares of an earlier job are gone on with, or removed, only where that is asked for."""
        if not each.shares.begun() or self._options["resume"]:
            return
        message = "a job has begun it. --resume goes on, --overwrite bakes anew"
        if self._options["overwrite"]:
            try:
                lock = Lock(lock_file(each.output))
            except TimeoutError:
                message = BUSY_MESSAGE
            else:
                each.shares.remove()
                lock.release()
                return
        each.problems.append(Problem(str(each.output), "", message))

    def _order(self, each: _ShotState, what: str, shares: int, **more: Any) -> Order:
        shot, output = str(each.shot), str(each.output)
        return Order(what, shot, output, self._options, shares, program_digest(), **more)

    def _longest_first(
        self, begun: Sequence[tuple[_ShotState, Order]]
    ) -> list[tuple[_ShotState, Order]]:
        """Shares of shots in the order in which they are given out, so that no long one is begun
        last, by one worker alone: by what each took before, and where that is not known by its
        feathers and samples."""
        known = [each for each in self._shots if each.past]
        feathers = sum(sum(each.plan["sizes"]) for each in known)
        mean = sum(sum(each.past) for each in known) / feathers if known else 1.0

        def work(begun: tuple[_ShotState, Order]) -> float:
            each, place = begun[0], begun[1].share - 1
            of_sample = each.past[place] if each.past else mean * each.plan["sizes"][place]
            return float(each.plan["samples"] * of_sample)

        return sorted(begun, key=work, reverse=True)

    def _begin(self, each: _ShotState) -> list[Order]:
        """Make room for a shot; its shares."""
        count, chunk = each.plan["shares"], each.plan["chunk"]
        try:
            each.lock = Lock(lock_file(each.output))
            if count > 1:
                each.shares.begin(count)
        except TimeoutError:
            each.problems.append(Problem(str(each.output), "", BUSY_MESSAGE))
            return []
        except OSError as error:
            each.problems.append(Problem(str(error.filename), "", str(error.strerror)))
            return []
        if count == 1:
            each.release()  # its bake takes it itself
        each.left, each.past = count, read_share_times(each.shot, each.plan["sizes"])
        return [
            self._order(each, BAKE, count, share=share, chunk=chunk)
            for share in range(1, count + 1)
        ]

    def _give(self, each: _ShotState, order: Order) -> None:
        self._out[self._number] = _Given(each, order)
        self._engine.submit(self._number, order)
        self._number += 1

    def _until_all_are_heard(self) -> None:
        while self._out:
            news = self._engine.hear()
            if news.what == QUIET:
                if news.value == 0:
                    _LOG.warning("no worker is there; waiting for one")
            elif (given := self._out.get(news.number)) is not None:
                self._heard(given, news)
                if given.order.what != PLAN:
                    # cores of who has nothing to do go to those that still work
                    self._engine.share_out(len(self._out))

    def _heard(self, given: _Given, news: OrderNews) -> None:
        if news.place and given.worker != news.place:
            self._taken_up(given, news.place)
        if news.what == SHARE_PROGRESS:
            given.done = news.value[0] / max(news.value[1], 1)
        elif news.what == DONE:
            del self._out[news.number]
            given.done = 1.0
            self._finished.append(given)
            self._complete(given, news.value)
        elif news.what == LOST:
            del self._out[news.number]
            lost = ", ".join([*given.lost, given.worker])
            message = f"every worker that took it was lost ({lost}). Its log may tell why"
            self._fail(given, [Problem(str(given.shot.shot), given.name, message)])
        elif news.what == FAILED:
            self._failed(given, news)
        self._tell()

    def _taken_up(self, given: _Given, worker: str) -> None:
        if given.order.what == PLAN:
            given.worker = worker
            return
        if given.worker:
            _LOG.warning("%s: worker %s was lost", given.name, given.worker)
            given.lost.append(given.worker)
        given.worker = worker
        _LOG.info("%s: on %s", given.name, worker)

    def _complete(self, given: _Given, done: OrderResult) -> None:
        each, order = given.shot, given.order
        for text in done.warnings:
            _LOG.warning("%s: %s", given.name, text)
        if order.what == PLAN:
            each.plan, each.looked = done.report, done.times
            return
        seconds = done.times["wall_seconds"]
        _LOG.info("%s: done on %s in %.1f s", given.name, given.worker, seconds)
        told = {"worker": given.worker, "workers_lost": given.lost}
        if order.what == MERGE and order.piece:
            each.pieces.append({"piece": order.piece, **told, **done.times})
            self._merge_when_all_are_there(each)
        elif order.what == MERGE:
            each.merged = told | done.times
            each.shares.remove()
        else:
            each.baked.append({"share": order.share, **told, **done.report, **done.times})
            each.left -= 1
            self._baked_at = time.perf_counter()
            if each.left == 0:
                _note_times(each)
            if each.left == 0 and order.shares > 1:
                self._merge(each)
            elif each.left == 0:
                each.shares.remove()

    def _merge(self, each: _ShotState) -> None:
        """Have the chunks of the whole written by all workers, a run of them by each, or by the one
        that completes it."""
        chunks = -(-each.plan["samples"] // (each.plan["chunk"] * each.plan["subframes"]))
        runs = min(chunks, self._engine.workers)
        each.runs = runs if runs > 1 else 0
        for piece in range(1, each.runs + 1):
            count = each.plan["shares"]
            self._give(each, self._order(each, MERGE, count, pieces=each.runs, piece=piece))
        self._merge_when_all_are_there(each)

    def _merge_when_all_are_there(self, each: _ShotState) -> None:
        if len(each.pieces) == each.runs:
            each.release()  # for the one that merges
            order = self._order(each, MERGE, each.plan["shares"], pieces=each.runs)
            self._give(each, order)

    def _failed(self, given: _Given, news: OrderNews) -> None:
        """An order that was not carried out: given again where another worker may do better."""
        error = news.value
        if isinstance(error, OutputError) and given.order.what != PLAN and given.tries < _TRIES:
            _LOG.warning("%s: failed on %s: %s", given.name, news.place, error)
            given.tries, given.worker = given.tries + 1, ""
            self._engine.submit(news.number, given.order, avoid=news.place)
            return
        del self._out[news.number]
        if isinstance(error, InputError):
            self._fail(given, list(error.problems))
        elif isinstance(error, SimulationError):
            self._fail(given, [Problem(str(given.shot.shot), given.name, str(error))])
        else:
            error.add_note(f"while {given.name} was worked on by {news.place}")
            raise error

    def _fail(self, given: _Given, problems: Sequence[Problem]) -> None:
        """Note why a shot will not be there, and take its other orders back."""
        if given.order.what != PLAN:
            problems = [
                replace(each, message=f"{each.message} ({given.name} on {given.worker})")
                for each in problems
            ]
        given.shot.problems += problems
        others = [number for number, each in self._out.items() if each.shot is given.shot]
        for number in others:
            self._engine.cancel(number)
            del self._out[number]

    def _raise_problems(self) -> None:
        problems = [problem for each in self._shots for problem in each.problems]
        if problems:
            raise InputError(*dict.fromkeys(problems))

    def _tell(self) -> None:
        """Frames that are done of all shots, of which a share counts as its part; those of a share
        that was lost are counted again only where they are new."""
        total = sum(each.plan.get("samples", 0) for each in self._shots)
        if not all(each.plan for each in self._shots):
            return
        done = sum(
            given.done * given.shot.plan["samples"] / given.order.shares
            for given in (*self._out.values(), *self._finished)
            if given.order.what == BAKE
        )
        done = min(done, total)
        if done > self._told:
            self._told = done
            self._notify(done, total)

    def _report(self, each: _ShotState) -> dict[str, Any]:
        shares = sorted(each.baked, key=lambda share: int(share["share"]))
        plan = {key: each.plan[key] for key in ("shot", "feathers", "frames", "samples")}
        merging = {**each.merged, "pieces": each.pieces} if each.merged else {}
        parts = {"looking": each.looked, "shares": shares, "merging": merging}
        return {**plan, "output": str(each.output), **parts}


def _note_times(each: _ShotState) -> None:
    """Keep the times of shares for later jobs, where each was baked whole by one worker."""
    whole = all(
        not share["samples_taken_over"] and not share["workers_lost"] for share in each.baked
    )
    if whole and each.plan["samples"]:
        shares = sorted(each.baked, key=lambda share: int(share["share"]))
        took = [share["processor_seconds"] / each.plan["samples"] for share in shares]
        keep(_SHARE_TIMES, [str(each.shot), list(each.plan["sizes"])], {"seconds": took})


def read_share_times(shot: Path, sizes: Sequence[int]) -> list[float]:
    """Read the CPU time, s a sample, of each share of a shot in an earlier job of this machine.

    sizes: feathers of each share. Empty where the shot was not baked in such shares.
    """
    found = kept_before(_SHARE_TIMES, [str(shot), list(sizes)])
    return [] if found is None else found["seconds"].tolist()


@takes(BakeOptions)
def bake_many(
    shots: Sequence[str | Path] | str | Path,
    output: str | Path = ".",
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    shares: int | None = None,
    progress: Progress = False,
    **options: Any,
) -> dict[str, Any]:
    """Bake shots by workers of a Dask cluster and return the report of the job.

    Each gets the bytes of a bake by itself. output: a folder, made where it is missing, which takes
    a .usdc named after each shot's file; for one shot also a USD file. scheduler: address of one
    that is there; None: a cluster of processes of this machine is started, and ends with the job.
    workers: its processes, by default one for each core; of a scheduler, how many to wait for
    (default 1). shares: into how many each shot is cut, by default about two for each worker.
    progress: True for lines on stderr, or a function of the frames done of all shots and their
    number. options: fields of featherfx.baking.options.BakeOptions; jobs are the threads of each
    worker. Workers need the same paths for shots, what these name, and the output (docs/farm.md).
    What goes on is told to the logger "featherfx.farm".

    Raises InputError with all that is wrong with any shot before any work; afterwards, with the
    shots that could not be baked, when all others are done. Needs the extra "dask".
    """
    begin = time.perf_counter()
    chosen = make_options(BakeOptions, options)
    notify = listener_of(progress, "frames")
    shots = [shots] if isinstance(shots, str | Path) else shots
    require_type("shots", shots, Sequence, "the paths of shot files")
    for each in shots:
        require_type("shots", each, str | Path, "the paths of shot files")
    if not shots or chosen.feathers is not None:
        what = (
            "no shot is given. Name a shot"
            if not shots
            else "shares are cut by the job. Leave feathers out"
        )
        raise InputError(Problem("bake_many", "", what))
    if workers is not None and workers < 1:
        raise InputError(
            Problem("bake_many", "workers", f"{workers} is not allowed. Give 1 or more")
        )
    report = None if chosen.report is None else Path(chosen.report)
    check_report(report, chosen.overwrite or chosen.resume)
    before = standing(report) if report else None
    paths = [Path(os.path.abspath(each)) for each in shots]
    where = Path(os.path.abspath(output))
    outputs = outputs_of(paths, where)
    folders = [*(str(each) for each in own_folders(chosen.preset_folders)), SHIPPED_PRESETS]
    given = asdict(replace(chosen, preset_folders=folders, report=None))
    with opened(scheduler, workers) as engine, _made(None if outputs == [where] else where):
        starting = time.perf_counter() - begin
        job = Job(paths, outputs, given, engine, shares, notify or (lambda done, total: None))
        told, count = job.run(), engine.workers
        parts = {"starting": starting, **job.seconds()}
    seconds = time.perf_counter() - begin
    parts["ending"] = seconds - sum(parts.values())
    result = {"version": __version__, "workers": count, "wall_seconds": seconds, "seconds": parts}
    result["shots"] = told
    if report is not None:
        store_report(result, report, before)
    return result


@contextmanager
def _made(folder: Path | None) -> Iterator[None]:
    """A folder that is made where it is missing, and goes again where nothing came into it."""
    if folder is None or folder.exists():
        yield
        return
    try:
        folder.mkdir()
    except OSError as error:
        message = f"the folder cannot be made: {error.strerror}"
        raise OutputError(Problem(str(folder), "output", message)) from error
    try:
        yield
    finally:
        with suppress(OSError):
            folder.rmdir()
