"""Frames simulated, laid and written side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from featherfx.baking.incremental import GONE, replay_of
from featherfx.baking.pace import Pace
from featherfx.baking.sink import Sink
from featherfx.baking.types import Task
from featherfx.errors import Problem
from featherfx.files.background import Background
from featherfx.files.gc_pause import seldom_collected, set_aside
from featherfx.files.memory import give_back_memory, keep_arrays_apart
from featherfx.jit.compile_progress import TELLER
from featherfx.phases import phase
from featherfx.shot.checkpoint import Checkpoint
from featherfx.shot.frames import Frame
from featherfx.shot.replay import Replay
from featherfx.shot.simulate import Simulation, simulate
from featherfx.usd.types import OutputError

# feathers from which on what they are made of is worth setting aside
MANY = 500
# the same of memory over time: what is freed is found again at a cost, some hundredths of a bake
VERY_MANY = 10_000


def simulate_and_write(
    task: Task, notify: Callable[[int, int], None]
) -> tuple[int, dict[str, Any]]:
    """Run the frame loop; while a frame is simulated, the one before is laid and the one before
    that written. Returns the samples taken over and the figures.

    notify: called with the samples done and their number.
    """
    sink = Sink(task)
    TELLER.works = ("bake",) if task.shot.contact is None else ("bake", "contact")
    try:
        with sink:
            found = _written_to(sink, task, notify)
            # all that was simulated is let go by now; the writer's end needs as much of its own
            give_back_memory()
            return found
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(sink.state) from error


def _written_to(
    sink: Sink, task: Task, notify: Callable[[int, int], None]
) -> tuple[int, dict[str, Any]]:
    """All samples, as simulate_and_write; the writer then lacks only its end."""
    options, samples = task.options, task.samples
    taken_over, start = 0, None
    if options.resume:
        with phase("building", silent=True):
            taken_over, state = sink.writer.samples_done, sink.writer.state
        start = Checkpoint.load(state) if state else None
    done = taken_over
    if len(task.whole.groom.feathers) >= VERY_MANY:
        keep_arrays_apart()
    wanted, replay = _simulated(task, sink, start), replay_of(task, start)
    with phase("building"), seldom_collected():
        simulation = simulate(
            task.whole, options.jobs, task.frames, options.subframes, start, wanted, replay
        )
    notify(done, samples)
    # where nothing is gone on with, it is built while feathers settle
    sink.begin()
    sink.compare(simulation.laid)
    many = len(task.whole.groom.feathers) >= MANY
    with set_aside() if many else nullcontext():
        writing = _frames_written(sink, task, simulation, done, notify)
    sink.tell()
    beside = {
        "writing_beside": writing.seconds,
        "writing_processor_seconds": writing.processor_seconds,
    }
    return taken_over, simulation.report | beside | _told(task, wanted, replay)


def _frames_written(
    sink: Sink, task: Task, simulation: Simulation, done: int, notify: Callable[[int, int], None]
) -> Background:
    """Go through a simulation and write the samples that are not done; what wrote them."""
    samples = task.samples
    writing = Background(sink.write, 1)  # frames of a plumage are large

    to_come = samples - done + task.samples_after
    pace = Pace(to_come, to_come + samples - done)

    def finish(finished: Callable[[], Iterator[tuple[Frame, Checkpoint | None]]]) -> None:
        for frame, checkpoint in finished():
            writing.wait()  # so that no other waits meanwhile
            writing(frame, checkpoint)
            pace.finished += 1
            del frame, checkpoint  # large, and the next is laid before it comes
        pace.finished += 1

    with writing, Background(finish, 1) as finishing:
        ahead = simulation.ahead(
            lambda sample: sink.writer.ends_chunk(sample), task.options.accelerations
        )
        with phase("simulating", silent=True) as told:
            for finished in ahead if done < samples else ():
                with phase("writing" if writing.is_waited_for else "simulating", silent=True):
                    finishing.wait()
                finishing(finished)
                del finished  # holds a sample
                pace.simulated += 1
                told(pace.simulated, pace.left(finishing))
                if done < samples:
                    done += 1
                    notify(done, samples)
            finishing.wait()
        with phase("writing"):
            writing.close()
    return writing


def _simulated(task: Task, sink: Sink, start: Checkpoint | None) -> Sequence[int]:
    """Numbers, in the whole, of the feathers to simulate; the writer takes the others over.

    start: of the bake that goes on; it simulates what that has simulated.
    """
    everyone = range(len(task.whole.groom.feathers)) if task.wanted is None else task.wanted
    taken = set(task.taken.feathers) if task.taken else set()
    if task.taken and task.taken.cache.chunk != sink.writer.chunk:
        taken = set()  # samples of a feather that hardly moves depend on where chunks begin
    wanted = [number for place, number in enumerate(everyone) if place not in taken]
    if start is not None and start.wanted.tolist() != wanted:
        wanted = start.wanted.tolist()
        known = set(wanted)
        taken = {place for place, number in enumerate(everyone) if number not in known}
        if taken and not (task.taken and taken <= set(task.taken.feathers)):
            raise OutputError(Problem(str(task.path), "", GONE))
    if task.taken and taken:
        sink.writer.take_over(task.taken.cache, sorted(taken))
    return wanted


def _told(task: Task, wanted: Sequence[int], replay: Replay) -> dict[str, Any]:
    """Of a report: how much was simulated again, and why."""
    if task.taken is None:
        return {}
    kept = len(task.names) - len(wanted)
    again = len(np.intersect1d(wanted, task.taken.moving)) if len(replay.numbers) else 0
    counts = {"feathers_simulated": len(wanted) - again, "feathers_taken_over": kept}
    if again:
        counts["feathers_laid_again"] = again
    return {"again": counts | {"changed": list(task.taken.changed)}}
