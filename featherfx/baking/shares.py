"""One cache from partitions (shares) of its feathers, each baked to a cache of its own.

`join` writes a root that refers to the partitions. `merge` reads their samples and writes them as a
bake of all feathers at once does, with the same bytes; nothing is simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from numbers import Integral
from pathlib import Path

from featherfx.baking.frame_loop import cache_tables, new_writer
from featherfx.baking.task import BakeTask, part_path
from featherfx.errors import InputError, Problem, require_type
from featherfx.phases import phase
from featherfx.shot.frames import Frame, sample_number
from featherfx.usd.convert.merge import join_shares
from featherfx.usd.types import OutputError
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.output import check_output
from featherfx.usd.write.previous_cache import PreviousCache

# settings in which a share may differ from the whole
_OWN = ("feathers", "layout", "chunk")


def join(output: str | Path, shares: int, overwrite: bool = False) -> int:
    """Write the root of a cache that was baked in shares of its feathers; return their number.

    output: name of the whole; the shares stand beside it (featherfx.baking.task.part_path). Raises
    InputError where one is missing or was baked with other settings.
    """
    require_type("shares", shares, Integral, "a whole number")
    if shares < 1:
        raise InputError(Problem(str(output), "shares", f"{shares} is not allowed. Give 1 or more"))
    path = check_output(output, overwrite)
    parts = [part_path(path, (k, shares)) for k in range(1, shares + 1)]
    return join_shares(path, parts, overwrite)


def merge(
    task: BakeTask,
    shares: Sequence[Path],
    notify: Callable[[int, int], None],
    pieces: Sequence[Path] = (),
) -> None:
    """Write the cache of a task from shares of its feathers, each in one of them.

    shares: caches with chunks of as many samples as the whole's. notify: called with the samples
    done and their number. pieces: where merge_piece has left all chunks, in their order; else they
    are written here. Raises OutputError where a share was baked with other settings, or feathers
    are missing.
    """
    with phase("building", silent=True):
        writer = new_writer(task)
    with writer:
        caches = [PreviousCache(path) for path in shares]
        depend = _taken(task, writer, shares, caches)
        with phase("writing", silent=True):
            for piece in pieces:
                writer.adopt(piece)
            if not pieces:
                _write(task, writer, range(task.samples), notify)
        writer.tell(cache_tables(task, [depend[name] for name in task.names]))
    notify(task.samples, task.samples)


def merge_piece(
    task: BakeTask,
    shares: Sequence[Path],
    notify: Callable[[int, int], None],
    piece: Path,
    place: tuple[int, int],
) -> None:
    """Write one run of chunks of a task's cache for merge to take: as those of an unfinished cache
    at a path of its own.

    place: (i, n), the i-th of n runs. Raises what merge raises.
    """
    options = replace(task.options, layout="clips", resume=True)
    with new_writer(replace(task, path=piece, options=options)) as writer:
        caches = [PreviousCache(path) for path in shares]
        _taken(task, writer, shares, caches)
        chunks = -(-task.samples // writer.chunk)
        first, end = (chunks * number // place[1] for number in (place[0] - 1, place[0]))
        writer.write_piece(first)
        _write(
            task, writer, range(first * writer.chunk, min(end * writer.chunk, task.samples)), notify
        )


def _write(
    task: BakeTask, writer: CacheWriter, samples: range, notify: Callable[[int, int], None]
) -> None:
    for done, sample in enumerate(samples):
        notify(done, len(samples))
        code = sample_number(task.frames[0], sample, task.options.subframes)
        writer.write(Frame(code, 0.0, ()))


def _taken(
    task: BakeTask, writer: CacheWriter, shares: Sequence[Path], caches: Sequence[PreviousCache]
) -> dict[str, str]:
    """Have a writer take the feathers of all shares; returns their dependences by name."""
    depend = {name: text for each in caches for name, text in each.dependences.items()}
    problems = list(_problems(task, writer, shares, caches))
    if problems or depend.keys() != set(task.names):
        missing = Problem(
            str(task.path),
            "",
            "its shares do not hold all of its feathers. Bake the missing shares",
        )
        raise OutputError(*(problems or [missing]))
    number = {name: k for k, name in enumerate(task.names)}
    for cache in caches:
        writer.take_over(cache, [number[name] for name in cache.dependences])
    return depend


def _problems(
    task: BakeTask, writer: CacheWriter, shares: Sequence[Path], caches: Sequence[PreviousCache]
) -> Iterator[Problem]:
    """Yield reasons why shares are no parts of the task's cache."""
    for path, cache in zip(shares, caches, strict=True):
        for key, text in task.settings.items():
            found = cache.settings.get(key)
            if key not in _OWN and found != text:
                yield Problem(str(path), key, f"was {found}, but {text} in the whole")
        if cache.chunk != writer.chunk:
            message = f"has chunks of {cache.chunk} samples, not {writer.chunk}"
            yield Problem(str(path), "", message)
