"""A bake as work for a farm: items that need no communication, and a job template.

Every item bakes a share of the feathers to files of its own; the last joins them and waits for
all others. Of a flock a share is some of its caches, and the last item writes the
stage. The template follows the Open Job Description specification, jobtemplate-2023-09.

Partitions (shares) of the feathers, each baked to a cache of its own, become one cache: `join`
writes a root that refers to them. `merge` reads their samples and writes them as a bake of all
feathers at once does, with the same bytes; nothing is simulated.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from numbers import Integral
from pathlib import Path
from typing import Any

from featherfx.api import Folders, open_document, scene_readers, shot_as_written
from featherfx.baking.frame_loop import cache_tables, new_writer
from featherfx.baking.options import FlockOptions
from featherfx.baking.task import BakeTask, default_output, part_path
from featherfx.errors import InputError, Problem, require, require_type
from featherfx.files.atomic_write import write_text
from featherfx.files.folders import SHIPPED_PRESETS, own_folders
from featherfx.groom.document import Document
from featherfx.limits import TASK_HOURS
from featherfx.phases import phase
from featherfx.shot.contact.partition import most_shares, share_count
from featherfx.shot.flock import FlockShot
from featherfx.shot.frames import Frame, sample_number
from featherfx.shot.loop.placement import place_feathers
from featherfx.shot.types import Shot
from featherfx.usd.convert.merge import join_shares
from featherfx.usd.types import OutputError
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.output import check_output, find_file_problems
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


# of the environment, in which USD finds files that are not beside those that name them
_SEARCH = "PXR_AR_DEFAULT_SEARCH_PATH"
# Characters that a job's name may have at most.
_NAME_LENGTH = 64
# of joining, which names files; seconds
_JOIN_SECONDS = 3600
# of the environment that installs packages; seconds
_INSTALL_SECONDS = 1800
# Installs the packages of the job, if it names any, into the session's folder, and puts them first
# on the path of its tasks; `openjd_env` is how a session hears of a variable.
_INSTALL = """\
import os, pathlib, shlex, subprocess, sys, venv

packages, folder = shlex.split(sys.argv[1]), pathlib.Path(sys.argv[2], "packages")
if packages:
    venv.create(folder, with_pip=True)
    commands = folder / ("Scripts" if os.name == "nt" else "bin")
    subprocess.run([commands / "python", "-m", "pip", "install", *packages], check=True)
    print(f"openjd_env: PATH={commands}{os.pathsep}{os.environ['PATH']}", flush=True)
"""


def plan(
    shot_path: str | Path,
    output: str | Path | None,
    shares: int,
    options: Sequence[str] = (),
    preset_folders: Folders = (),
    overwrite: bool = False,
    task_shares: int | None = None,
    task_hours: float = TASK_HOURS,
) -> list[Path]:
    """Write the items and the job template beside the output, and return both paths.

    output: of the whole cache, default as for a bake; wing.usdc gives wing.plan.json, whose paths
    are absolute, and wing.openjd.json, whose job has shot, output and every folder of presets that
    is searched here (preset_folders, then those of FEATHERFX_PRESETS and of the user) as
    parameters. Workers search these and the shipped ones, none of their own. Where USD has a search
    path here (PXR_AR_DEFAULT_SEARCH_PATH), items and job have it, too, its folders as parameters.

    shares: items that bake, at least 1 and at most the number of feathers; fewer where feathers may
    touch, which is said (InputWarning). task_shares: that a task of the template bakes, by task
    chunking, which a scheduler has to know; None: one, without that. task_hours: after which a
    scheduler gives up a task of the template. options: of `featherfx bake`, passed on to every
    item. overwrite: whether a plan that exists is replaced. Raises
    InputError where the shot or the number is wrong, or a file stands there.
    """
    document = open_document("shot", shot_path, preset_folders)
    shot = _flock_as_written(document) if "flock" in document.tables else shot_as_written(document)
    shot_path = Path(os.path.abspath(shot_path))
    output = default_output(shot) if output is None else output
    output = Path(os.path.abspath(check_output(output, overwrite=True)))
    items, job = (output.with_suffix(suffix) for suffix in (".plan.json", ".openjd.json"))
    require(*find_file_problems([items, job], overwrite))
    shares, most = _count_shares(shot, shares, output)
    folders, search = own_folders(preset_folders), _search_path()
    searched = [*_searched([str(folder) for folder in folders]), *options]
    commands = [
        bake_command(shot_path, output, f"{k}/{shares}", searched) for k in range(1, shares + 1)
    ]
    paths = _paths(shot_path, output, folders, search)
    named = _parameters(paths, "Presets")
    tasks = (task_shares, round(3600 * task_hours))
    given = [*_searched(named), *options]
    last = (
        join_command if isinstance(shot, Shot) else partial(stage_command, "{{Param.Shot}}", given)
    )
    template = job_template(shot.name, (shares, most), tasks, paths, given, last)
    last = join_command if isinstance(shot, Shot) else partial(stage_command, shot_path, searched)
    work = work_items(commands, last(output, str(shares)))
    if search:
        work["environment"] = {_SEARCH: os.pathsep.join(map(str, search))}
    texts = {items: work, job: template}
    for path, content in texts.items():
        write_text(path, json.dumps(content, indent=2) + "\n")
    return list(texts)


def _flock_as_written(document: Document) -> FlockShot:
    """Read the flock of a document. Raises InputError."""
    from featherfx.shot.read.flock import read_flock

    return read_flock(document.source, document.preset_folders, scene_readers())


def _count_shares(shot: Shot | FlockShot, shares: int, output: Path) -> tuple[int, int]:
    """Return the shares that a bake is cut into, and the most. Raises InputError for too many."""
    if isinstance(shot, Shot):
        shot = place_feathers(shot)
        most, what = len(shot.groom.feathers), "feathers"
    else:
        from featherfx.baking.flock import list_caches

        most, what = len(list_caches(shot, output.parent, FlockOptions())), "caches"
    if not 1 <= shares <= most:
        message = f"{shares} is out of range. Give 1 to {most}, the number of {what}"
        raise InputError(Problem(str(shot.source), "plan", message))
    return (
        (share_count(shot, shares), most_shares(shot)) if isinstance(shot, Shot) else (shares, most)
    )


def bake_command(
    shot_path: str | Path,
    output: str | Path,
    share: str,
    options: Sequence[str],
    progress: str = "json",
) -> list[str]:
    """Command that bakes one share, i/n. progress: style of its lines.

    It resumes: a worker that is killed, or handed to another machine, loses a chunk at most.
    """
    fixed = ["featherfx", "bake", str(shot_path), "-o", str(output), "--feathers", share]
    return [*fixed, "--resume", "--progress", progress, *options]


def join_command(output: str | Path, shares: str) -> list[str]:
    """Command of the item that comes last."""
    return ["featherfx", "join", str(output), "--shares", shares, "--overwrite"]


def stage_command(
    flock: str | Path, options: Sequence[str], output: str | Path, shares: str
) -> list[str]:
    """Command of the item that comes last of a flock: it takes what is done."""
    fixed = ["featherfx", "bake", str(flock), "-o", str(output)]
    return [*fixed, "--resume", "--progress", "json", *options]


def work_items(commands: Sequence[Sequence[str]], join: Sequence[str]) -> dict[str, Any]:
    """The items by name, each with its command and the items that it waits for."""
    names = [f"bake_{k}" for k in range(1, len(commands) + 1)]
    items = [
        {"name": name, "command": list(command), "after": []}
        for name, command in zip(names, commands, strict=True)
    ]
    return {"items": [*items, {"name": "join", "command": list(join), "after": names}]}


def _searched(folders: Sequence[str]) -> list[str]:
    """Options by which a worker finds presets in these folders and the shipped ones only."""
    return [part for folder in (*folders, SHIPPED_PRESETS) for part in ("--presets", folder)]


def _search_path() -> list[Path]:
    """Folders that USD searches, by the environment."""
    return [
        Path(os.path.abspath(each)) for each in os.getenv(_SEARCH, "").split(os.pathsep) if each
    ]


def _parameters(paths: Sequence[dict[str, Any]], kind: str) -> list[str]:
    """List placeholders of the parameters whose names begin with a kind."""
    return [f"{{{{Param.{each['name']}}}}}" for each in paths if each["name"].startswith(kind)]


def _paths(
    shot: Path, output: Path, folders: Sequence[Path], search: Sequence[Path]
) -> list[dict[str, Any]]:
    """The parameters Shot, Output, Presets1... and Search1..., which a farm may map to its own
    paths. folders: of presets. search: of USD.

    Defaults of paths are relative to the template's folder, which stands beside the output, and
    must lie within it; what is elsewhere has none, and is named where the job is submitted.
    """
    parameters: list[dict[str, Any]] = []
    given = [("Shot", shot, "FILE", "IN"), ("Output", output, "FILE", "OUT")]
    for kind, several in (("Presets", folders), ("Search", search)):
        given += [(f"{kind}{k}", each, "DIRECTORY", "IN") for k, each in enumerate(several, 1)]
    for name, path, what, flow in given:
        each = {"name": name, "type": "PATH", "objectType": what, "dataFlow": flow}
        if path.is_relative_to(output.parent):
            each["default"] = path.relative_to(output.parent).as_posix()
        parameters.append(each)
    return parameters


def job_template(
    name: str,
    shares: tuple[int, int],
    tasks: tuple[int | None, int],
    paths: Sequence[dict[str, Any]],
    options: Sequence[str],
    last: Callable[[str, str], list[str]],
) -> dict[str, Any]:
    """An Open Job Description template: a step with a task per share, and one that joins.

    shares: the default of the job's parameter Shares, and its greatest value. tasks: the shares of
    one, as task_shares of plan, and its seconds at most. paths: its parameters that are paths.
    options: of every bake; with --jobs, a worker has to have as many processors. last: the command
    that joins, of an output and the number of shares.

    Its parameter Packages is what pip installs for the job; where it is empty, as at first, workers
    have featherfx already.
    """
    task_shares, seconds = tasks
    processors = int(dict(pairwise(options)).get("--jobs", 1))
    define: dict[str, Any] = {"name": "Share", "type": "INT", "range": "1-{{Param.Shares}}"}
    chunked: dict[str, Any] = {}
    if task_shares:
        chunks = {"defaultTaskCount": task_shares, "rangeConstraint": "CONTIGUOUS"}
        define |= {"type": "CHUNK[INT]", "chunks": chunks}
        chunked = {"extensions": ["TASK_CHUNKING"]}
    share = "{{Task.Param.Share}}/{{Param.Shares}}"
    bake = bake_command("{{Param.Shot}}", "{{Param.Output}}", share, options, "openjd")
    join = last("{{Param.Output}}", "{{Param.Shares}}")
    return {
        "specificationVersion": "jobtemplate-2023-09",
        **chunked,
        "name": f"featherfx {name}"[:_NAME_LENGTH],
        "parameterDefinitions": [
            *paths,
            {
                "name": "Shares",
                "type": "INT",
                "default": shares[0],
                "minValue": 1,
                "maxValue": shares[1],
            },
            {"name": "Packages", "type": "STRING", "default": ""},
        ],
        "jobEnvironments": [_installed_packages(), *_searching(_parameters(paths, "Search"))],
        "steps": [
            {
                "name": "bake",
                "parameterSpace": {"taskParameterDefinitions": [define]},
                "hostRequirements": {
                    "amounts": [{"name": "amount.worker.vcpu", "min": processors}]
                },
                "script": {"actions": {"onRun": _action(bake, seconds)}},
            },
            {
                "name": "join",
                "dependencies": [{"dependsOn": "bake"}],
                "script": {"actions": {"onRun": _action(join, _JOIN_SECONDS)}},
            },
        ],
    }


def _installed_packages() -> dict[str, Any]:
    """The environment of the job: packages that pip installs when a worker begins with it."""
    given = ["{{Env.File.Install}}", "{{Param.Packages}}", "{{Session.WorkingDirectory}}"]
    install = {"name": "Install", "type": "TEXT", "filename": "install.py", "data": _INSTALL}
    action = _action(["python3", *given], _INSTALL_SECONDS)
    return {
        "name": "packages",
        "script": {"actions": {"onEnter": action}, "embeddedFiles": [install]},
    }


def _searching(folders: Sequence[str]) -> list[dict[str, Any]]:
    """The environment of the job in which USD searches folders, if there are any."""
    if not folders:
        return []
    return [{"name": "search", "variables": {_SEARCH: os.pathsep.join(folders)}}]


def _action(command: Sequence[str], seconds: int) -> dict[str, Any]:
    """A command that is ended after so many seconds."""
    return {"command": command[0], "args": list(command[1:]), "timeout": seconds}
