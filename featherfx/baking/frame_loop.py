"""The frame loop: frames are simulated and written side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple, Self

import numpy as np

from featherfx.baking.entries import drawn_entries, metadata_of, scenery_of
from featherfx.baking.task import BakeTask
from featherfx.files.process import Background, give_back_memory, keep_arrays_apart
from featherfx.jit.code_cache import EXPECTED_WORKS
from featherfx.jit.compiled import request_expected
from featherfx.phases import phase
from featherfx.shot.frames import Frame
from featherfx.shot.loop.simulate import Checkpoint, Simulation, simulate
from featherfx.usd.write.cache_writer import CachePlace, CacheWriter, Continuation
from featherfx.usd.write.layers import format_table

# feathers from which on memory is given back as it is freed, which costs some hundredths of a bake
_MIN_KEPT_APART = 10_000


def simulate_and_write(
    task: BakeTask, notify: Callable[[int, int], None]
) -> tuple[int, dict[str, Any]]:
    """Run the frame loop; while a frame is simulated, the one before is written. Return the samples
    that were there already, and the figures for the report.

    notify: called with the samples done and their number.
    """
    sink = CacheSink(task)
    shot = task.shot
    works = ["bake", *["contact"] * (shot.contact is not None), *["bird"] * shot.has_coat_on_skin]
    EXPECTED_WORKS[:] = works
    request_expected(*works, later=True)
    try:
        with sink:
            figures = _run_loop(sink, task, notify)
            # the simulation is released by now; the writer's end needs as much memory of its own
            give_back_memory()
            return figures
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(sink.state) from error


def _run_loop(
    sink: CacheSink, task: BakeTask, notify: Callable[[int, int], None]
) -> tuple[int, dict[str, Any]]:
    """Write all samples; the writer then lacks only its end. As simulate_and_write."""
    options, whole = task.options, task.whole
    done, start = 0, None
    again: dict[str, Any] = {}
    every = range(len(whole.groom.feathers)) if task.wanted is None else task.wanted
    wanted: Sequence[int] = every
    if len(whole.groom.feathers) >= _MIN_KEPT_APART:
        keep_arrays_apart()
    if options.resume:
        with phase("building", silent=True):
            done, state = sink.writer.samples_done, sink.writer.state
        start = Checkpoint.load(state) if state else None
        from featherfx.baking.reuse import count_again, numbers_to_simulate

        wanted = numbers_to_simulate(task, every, sink.writer, start)
        if task.taken is not None:
            again = {"again": count_again(task, wanted)}
    with phase("building"):
        simulation = simulate(whole, options.jobs, task.frames, options.subframes, start, wanted)
    if task.dependences is not None and task.dependences.shot is whole:
        task.dependences.options = simulation.resolved
    notify(done, task.samples)
    # unless it goes on from an earlier bake, the writer is built while feathers settle
    sink.begin()
    sink.compare()
    writing = _write_frames(sink, task, simulation, done, notify)
    sink.tell()
    beside = {
        "writing_beside": writing.seconds,
        "writing_processor_seconds": writing.processor_seconds,
    }
    stepped = [
        task.whole.groom.feathers[number].id
        for number, options in zip(wanted, simulation.options, strict=True)
        if options.is_simulated
    ]
    return done, simulation.report | beside | again | {"stepped": stepped}


def _write_frames(
    sink: CacheSink,
    task: BakeTask,
    simulation: Simulation,
    done: int,
    notify: Callable[[int, int], None],
) -> Background:
    """Go through a simulation, draw the samples that are not done beside it, and write them beside
    both; return what wrote them."""
    samples = task.samples
    writing = Background(sink.write, 1)  # frames of a plumage are large

    def draw_one(draw: Callable[[], Frame], checkpoint: Checkpoint | None) -> None:
        frame = draw()
        writing.wait()  # so that no other waits meanwhile
        writing(frame, checkpoint)

    drawing = Background(draw_one, 1)
    eta = FrameEta(samples - done, samples - done)
    with writing, drawing:
        frames = (
            simulation.samples(
                lambda sample: sink.writer.ends_chunk(sample), 1 + task.options.accelerations
            )
            if done < samples
            else ()
        )
        with phase("simulating", silent=True) as progress:
            for draw, checkpoint in frames:
                drawing.wait()
                drawing(draw, checkpoint)
                del draw, checkpoint  # large
                eta.simulated += 1
                eta.finished = eta.simulated - 1
                progress(eta.simulated, eta.left(writing))
                done += 1
                notify(done, samples)
        with phase("writing"):
            drawing.close()
            writing.close()
    return writing


def new_writer(task: BakeTask) -> CacheWriter:
    """Open a writer of a task's feathers; raises what CacheWriter raises."""
    shot, quality = task.shot, task.shot.quality
    return CacheWriter(
        task.path,
        drawn_entries(shot.groom, quality, task.options, task.names, shot.skin, shot.wets),
        task.frames,
        shot.frames_per_second,
        task.options,
        metadata=metadata_of(shot.groom, quality)
        | scenery_of(shot, task.path, task.bodies)
        | {"shot": shot.name, "settings": task.settings},
        place=CachePlace(
            task.root,
            "{}of{}".format(*task.options.feathers) if task.options.feathers else "",
            task.origin,
            shot.time_codes_per_second,
            shot.handles,
        ),
        continuation=Continuation(task.settings, task.shot.inputs, task.frames_each),
    )


class CacheSink:
    """Writer of a task's cache, built by a thread of its own while others work; a context manager
    that ends as the writer's block."""

    def __init__(self, task: BakeTask) -> None:
        self._task, self._pool = task, ThreadPoolExecutor(1, "featherfx sink")
        self._made: Future[CacheWriter] | None = None
        self._compared: Future[dict[str, Any]] | None = None

    def begin(self) -> Future[CacheWriter]:
        """Have the writer built, if it is not."""
        self._made = self._made or self._pool.submit(new_writer, self._task)
        return self._made

    @property
    def writer(self) -> CacheWriter:
        """Writer; waits for it. Raises what new_writer raises."""
        return self.begin().result()

    def compare(self) -> None:
        """Compute, when the writer is built, the texts that a later bake compares itself with."""

        def find() -> dict[str, Any]:
            dependences = self._task.dependences
            return {} if dependences is None else cache_tables(self._task, dependences.texts)

        self._compared = self._pool.submit(find)

    def tell(self) -> None:
        """Have the writer store these texts; waits for them, and raises what computing raises."""
        assert self._compared is not None
        self.writer.tell(self._compared.result())

    def write(self, frame: Frame, checkpoint: Checkpoint | None) -> None:
        """Write the next sample, and at the end of a chunk the checkpoint."""
        shot = self._task.shot
        ratio = (shot.time_codes_per_second or shot.frames_per_second) / shot.frames_per_second
        if ratio != 1.0:
            frame = frame.in_seconds_of(ratio)
        self.writer.write(frame, checkpoint.save if checkpoint else None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self._pool.shutdown(cancel_futures=True)
        if self._built is not None:
            self._built.__exit__(*error)

    @property
    def _built(self) -> CacheWriter | None:
        """Writer, if it was built."""
        if self._made is None or self._made.cancelled() or self._made.exception() is not None:
            return None
        return self._made.result()

    @property
    def state(self) -> str:
        """Message about what an interrupt has left."""
        writer = self._built
        if writer is None:
            return "interrupted before the first frame: nothing new was written"
        if writer.published:
            return f"interrupted, but {self._task.path} is complete"
        if kept := writer.samples_kept:
            return f"interrupted: {kept} of {self._task.samples} samples are kept for --resume"
        return "interrupted: nothing was written"


def cache_tables(task: BakeTask, dependences: Sequence[str]) -> dict[str, Any]:
    """Return what a later bake compares itself with; dependences: of the task's feathers."""
    depend = dict(zip(task.names, dependences, strict=True))
    return {"inputs": format_table(task.shot.inputs), "dependences": format_table(depend)}


class _Mark(NamedTuple):
    """Samples simulated, and s of wall time, CPU time and CPU time beside, until then."""

    simulated: int
    seconds: float
    worked: float
    beside: float


class FrameEta:
    """Estimated time left of samples that are simulated while those before are finished beside.

    A sample takes the CPU time between the mean and the median of those so far, since a few are
    often many times as hard as the others; the work beside takes its mean. The wall time of this
    CPU time follows from the last third of the work; after the last sample finishing goes on alone.
    simulated, finished: parts done of either.
    """

    def __init__(self, simulating: int, finishing: int) -> None:
        """Begin to count.

        simulating: samples in all. finishing: parts of the work beside.
        """
        self._simulating, self._finishing = simulating, finishing
        self.simulated = self.finished = 0
        self._marks: list[_Mark] = []

    def left(self, beside: Background) -> float | None:
        """Estimate s until the last sample is finished; None while it is not known."""
        # the first sample may cost nothing, as those do that all feathers are settled at, and the
        # second loads what all others need
        if self.simulated < 2:
            return None
        # not its clock, which goes on while it waits for the interpreter
        worked = beside.processor_seconds
        now = _Mark(self.simulated, time.perf_counter(), time.process_time(), worked)
        self._marks.append(now)
        if len(self._marks) < 2:
            return None
        costs = [
            (end.worked - end.beside - start.worked + start.beside)
            / (end.simulated - start.simulated)
            for start, end in zip(self._marks[:-1], self._marks[1:], strict=True)
        ]
        each, part = 0.5 * (np.mean(costs) + np.median(costs)), worked / max(self.finished, 1)
        samples = max(self._simulating - self.simulated, 0)
        to_finish = max(self._finishing - self.finished, 0)
        # wall time of one s of CPU time, in the last third of the work
        since = now.worked - (now.worked - self._marks[0].worked) / 3.0
        late = next(mark for mark in reversed(self._marks[:-1]) if mark.worked <= since)
        slowness = (now.seconds - late.seconds) / max(now.worked - late.worked, 1e-9)
        meanwhile = min(2 * samples, to_finish)
        alone = part * (to_finish - meanwhile) * max(slowness, 1.0)
        return float((each * samples + part * meanwhile) * slowness + alone)
