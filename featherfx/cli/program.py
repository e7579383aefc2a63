"""The command line as a whole: the log, warnings, and failures as messages and exit codes.

Every line of a log (`--log FILE`) has time, process, level and text. Logs are appended to, so that
a task that is tried again has one log; a file that is something else is refused.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import io
import json
import logging
import os
import platform
import re
import shlex
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import click

from featherfx._version import __version__
from featherfx.errors import InputError, InputWarning, Problem, SimulationError, as_sentence
from featherfx.files.process import refuse_small_address_space, spare_address_space
from featherfx.phases import StageRead, list_entries, listen_to_reads

LOGGER = logging.getLogger("featherfx")
LOGGER.addHandler(logging.NullHandler())  # else Python prints what nobody takes
_FORMAT = "%(asctime)s [%(process)d] %(levelname)s %(message)s"
_OURS = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} \[\d+\] [A-Z]+ ")
_VERBOSE = "featherfx.verbose"
_NO_MEMORY = "there is not enough memory. Raise its limits, or take fewer threads"
# commands that read and write no USD
_WITHOUT_USD = {"completion", "plugins", "presets", "sample", "schema", "trace"}


class _LogFile(logging.FileHandler):
    """Log file; lines that a full disk does not take are lost, and the work goes on."""

    def handleError(self, record: logging.LogRecord) -> None:
        pass


def open_log(ctx: click.Context, _: click.Parameter, path: Path | None) -> None:
    """Log this run to a file until its context ends. Raises InputError for a file that is no log
    and OSError for one that cannot be written to."""
    if path is None:
        return
    if path.exists() and not path.is_file():
        raise InputError(
            Problem(str(path), "", "is not a regular file. Name another file for the log")
        )
    if path.is_file() and path.stat().st_size:
        with path.open("rb") as file:
            if not _OURS.match(file.read(80)):
                raise InputError(
                    Problem(str(path), "", "holds something else than a log. Name another file")
                )
    handler = _LogFile(path, encoding="utf-8", errors="backslashreplace")
    handler.setFormatter(logging.Formatter(_FORMAT))
    before, begin = LOGGER.level, time.perf_counter()
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)

    def end() -> None:
        LOGGER.info("ended after %.2f s", time.perf_counter() - begin)
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(before)
        handler.close()

    ctx.find_root().call_on_close(end)
    python = f"Python {platform.python_version()} on {platform.platform()}"
    LOGGER.info("featherfx %s, %s, in %s", __version__, python, Path.cwd())
    LOGGER.info("arguments: %s", shlex.join(ctx.find_root().obj or ()))


def tell(line: str, level: int = logging.INFO) -> None:
    """Print a line on stderr, and log it."""
    click.echo(line, err=True)
    LOGGER.log(level, "%s", line)


def _remember_verbose(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().meta[_VERBOSE] = True


_warned: set[str] = set()  # what this run has said


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    text = as_sentence(f"featherfx: warning: {message}")
    if text not in _warned:
        _warned.add(text)
        tell(text, logging.WARNING)


_reads: list[StageRead] = []  # by this run


def _show_read(read: StageRead) -> None:
    _reads.append(read)
    text = f"featherfx: read {read}"
    if text not in _warned:
        _warned.add(text)
        tell(text)


def print_json(found: Mapping[str, Any]) -> None:
    """Print an object with the account of what this run read of stages, as `read`."""
    click.echo(json.dumps({**found, "read": list_entries(_reads)}, indent=2))


def plain(result: Any) -> Any:
    """Only what JSON has: a number that is not finite is null."""
    if hasattr(result, "as_json"):
        result = result.as_json()
    if is_dataclass(result):
        result = {each.name: getattr(result, each.name) for each in fields(result)}
    if hasattr(result, "_asdict"):
        result = result._asdict()
    if hasattr(result, "tolist"):
        result = result.tolist()
    if isinstance(result, Mapping):
        return {name: plain(each) for name, each in result.items()}
    if isinstance(result, list | tuple):
        return [plain(each) for each in result]
    return None if isinstance(result, float) and not isfinite(result) else result


def _verbose_option() -> click.Option:
    return click.Option(
        ["--verbose"],
        is_flag=True,
        expose_value=False,
        callback=_remember_verbose,
        help="Show the traceback of an error.",
    )


def _log_option() -> click.Option:
    return click.Option(
        ["--log"],
        type=click.Path(path_type=Path),
        metavar="FILE",
        is_eager=True,
        expose_value=False,
        callback=open_log,
        help="Append what is done and said to a log, with times and tracebacks.",
    )


# names that other programs have for options and keys
_MEANT = {
    "cores": "jobs", "cpus": "jobs", "force": "overwrite", "fps": "frames_per_second",
    "samples": "subframes", "threads": "jobs",
}  # fmt: skip


class _WithExamples(click.Command):
    """A command or group whose epilog holds examples."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # Examples are lines of their own; click would wrap them into one paragraph.
        if self.epilog:
            with formatter.section("Examples"):
                for line in self.epilog.strip().splitlines():
                    formatter.write(f"{'':{formatter.current_indent}}{line.strip()}\n")


def _choices(param: click.Parameter) -> Collection[str]:
    """Return the words that an option takes, where they are known."""
    if "--quality" in param.opts:
        from featherfx.groom.keys.problems import Problems
        from featherfx.groom.presets.library import Library

        return Library((), Problems()).names("quality")
    return [str(each) for each in getattr(param.type, "choices", ())]


class Command(_WithExamples):
    """A command that takes --log and --verbose. sections: titles in its help, each before the
    option that it begins with."""

    def __init__(self, *args: Any, sections: Mapping[str, str] = {}, **options: Any) -> None:
        super().__init__(*args, **options)
        self.sections = {first: title for title, first in sections.items()}
        self.params += [_log_option(), _verbose_option()]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As always, but of what says which part is meant the last does not count silently, and an
        option that is a key of shots is named as such."""
        try:
            _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        except click.NoSuchOption as error:
            from featherfx.shot.read.keys import SHOT_FILE

            told = f"No such option {error.option_name}"
            key = error.option_name.lstrip("-").replace("-", "_")
            key = _MEANT.get(key, key)
            takers = [each.opts[-1] for each in self.params if key in _choices(each)]
            if takers:
                told = f"{told}. Did you mean '{takers[0]} {key}'?"
            elif any(f"--{key}" in each.opts for each in self.params):
                told = f"{told}. Did you mean '--{key}'?"
            elif key in SHOT_FILE.keys:
                told = f"{told}: {key} is a key of shots. Write it there."
            else:
                raise
            raise click.UsageError(told, ctx) from error
        for param in order:
            if getattr(param.type, "once", False) and order.count(param) > 1:
                name = param.opts[-1]
                text = f"{name} is given {order.count(param)} times. Give one {param.type.name}"
                raise click.UsageError(text, ctx)
        try:
            return super().parse_args(ctx, args)
        except click.MissingParameter as error:
            help_text = getattr(error.param, "help", None)
            raise click.MissingParameter(help_text, ctx, error.param) from error

    def invoke(self, ctx: click.Context) -> Any:
        """As always, where no output is an option by mistake, or an input of the work, and there is
        address space for it."""
        outputs, inputs = self._paths(ctx)
        for path in outputs:
            if str(path).startswith("-"):
                text = f"'{path}' looks like an option. Write './{path}' for a file of that name"
                raise click.UsageError(text, ctx)
        if inputs and any(path.is_file() for path in outputs):
            from featherfx.usd.write.output import refuse_inputs

            refuse_inputs(outputs, inputs)
        if ctx.find_root().invoked_subcommand not in _WITHOUT_USD:
            refuse_small_address_space()
        return super().invoke(ctx)

    def _paths(self, ctx: click.Context) -> tuple[list[Path], list[Path]]:
        """Paths that are written and that are read: these are not asked to be writable files."""
        outputs: list[Path] = []
        inputs: list[Path] = []
        for param in self.params:
            value = ctx.params.get(param.name or "")
            if isinstance(param.type, click.Path) and value is not None:
                reads = param.type.exists or not param.type.readable
                many = value if isinstance(value, tuple | list) else [value]
                (inputs if reads else outputs).extend(map(Path, many))
        return outputs, inputs

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        parts: dict[str, list[tuple[str, str]]] = {"Options": []}
        for each in self.get_params(ctx):
            if each.opts[-1] in self.sections:
                parts[self.sections[each.opts[-1]]] = []
            told = each.get_help_record(ctx) if isinstance(each, click.Option) else None
            if told is not None:
                parts[list(parts)[-1]].append(told)
        for title, rows in parts.items():
            with formatter.section(title):
                formatter.write_dl(rows)


class CommandGroup(_WithExamples, click.Group):
    """A group of such commands."""

    command_class = Command

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """As always; a name of an option is told to be one."""
        if args[0] in ("help", "version") and args[0] not in self.commands:
            text = f"No such command '{args[0]}'. Did you mean '--{args[0]}'?"
            raise click.UsageError(text, ctx)
        return super().resolve_command(ctx, args)


class _Forgiving(io.FileIO):
    """An open descriptor; what it does not take is lost."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data) or 0
        except OSError:
            return len(data)


def use_utf8() -> None:
    """Start this process again in Python's UTF-8 mode where the locale has another encoding: names
    in USD and TOML files are UTF-8."""
    if sys.getfilesystemencoding() == "utf-8" or os.environ.get("PYTHONUTF8") == "1":
        return
    os.environ["PYTHONUTF8"] = "1"
    os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])


def _secure_streams() -> None:
    """Let a bake outlive a stderr that is closed or full, and keep its number from files."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout is sys.__stdout__:
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.stderr is sys.__stderr__:
        raw = io.BufferedWriter(_Forgiving(2, "w", closefd=False))
        encoding = sys.stderr.encoding if sys.stderr else "utf-8"
        sys.stderr = io.TextIOWrapper(raw, encoding, "backslashreplace", line_buffering=True)


_begun = [time.perf_counter()]  # reading of the clock when this command began


def command_begin() -> float:
    """When this command began, as time.perf_counter tells time."""
    return _begun[0]


def _process_begin() -> float:
    """When this process began; where the system does not say it, when this file was imported."""
    try:
        with open("/proc/self/stat", "rb") as file:
            ticks = int(file.read().rpartition(b")")[2].split()[19])
        since = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return _begun[0]
    return min(time.perf_counter() - since, _begun[0])


def leave(code: Any) -> None:
    """End the process as Python does, but without taking apart all that it holds, which is a fifth
    of the time of a short bake. Returns where Python itself has to: other threads work on, a
    profiler waits for the end, or what was written last cannot be."""
    threads = [each for each in threading.enumerate() if not each.daemon]
    if not isinstance(code, int) or sys.getprofile() or sys.gettrace():
        return
    if threads != [threading.current_thread()]:
        return
    atexit._run_exitfuncs()
    try:
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()
    except (OSError, ValueError):
        return
    os._exit(code)


_came: list[int] = []  # interrupts of this run


@contextlib.contextmanager
def _noted_interrupts() -> Iterator[None]:
    """Interrupts are raised as always, and noted: libraries swallow what is raised in their
    callbacks."""
    _came.clear()
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield
        return

    def note(number: int, frame: Any) -> None:
        _came.append(number)
        usual(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)


def raise_interrupt() -> None:
    """Raise KeyboardInterrupt if one came before and was swallowed."""
    if _came:
        raise KeyboardInterrupt


class Program(CommandGroup):
    """The outermost group. Exit codes: 0 done, 1 wrong input or failed work, 2 wrong usage."""

    group_class = CommandGroup

    def main(self, *args: Any, **options: Any) -> Any:
        # with arguments it is called by a program that has been running for a while
        own = not args and options.get("args") is None
        _begun[0] = _process_begin() if own else time.perf_counter()
        spare_address_space()
        _secure_streams()
        given = args[0] if args else options.get("args")
        self.context_settings["obj"] = list(sys.argv[1:] if given is None else given)
        with _noted_interrupts():
            return super().main(*args, **options)

    def invoke(self, ctx: click.Context) -> Any:
        _warned.clear()
        _reads.clear()
        try:
            with warnings.catch_warnings(), listen_to_reads(_show_read):
                warnings.simplefilter("always", InputWarning)
                warnings.showwarning = _show_warning
                return super().invoke(ctx)
        except click.exceptions.Exit:
            raise
        except click.ClickException as error:
            LOGGER.error("%s", error.format_message())
            raise
        except InputError as error:
            from featherfx.groom.read.toml_text import located

            self._fail(ctx, "\n".join(map(located, error.problems)), error)
        except SimulationError as error:
            self._fail(ctx, as_sentence(str(error)), error)
        except KeyboardInterrupt as error:
            self._fail(ctx, str(error) or "interrupted", error)
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of our output has gone; click knows
                raise
            place = f"{error.filename}: " if error.filename else ""
            self._fail(ctx, f"{place}{error.strerror or error}", error)
        except MemoryError as error:
            self._fail(ctx, f"{ctx.invoked_subcommand}: {_NO_MEMORY}", error)
        except ModuleNotFoundError as error:
            if error.name != "pxr":
                raise
            self._fail(ctx, "USD is not installed: pip install usd-core, or use a host's", error)
        except Exception as error:
            if str(error) == "can't start new thread":
                self._fail(ctx, f"{ctx.invoked_subcommand}: {_NO_MEMORY}", error)
            if not _came:
                LOGGER.exception("a fault of the program")
                raise
            # a library has made another error of it
            self._fail(ctx, "interrupted", error)

    def _fail(self, ctx: click.Context, message: str, error: BaseException) -> None:
        trace = "".join(traceback.format_exception(error))
        LOGGER.info("%s", trace)
        if ctx.meta.get(_VERBOSE):
            click.echo(trace, err=True)
        for line in message.splitlines():
            tell(f"featherfx: {line}", logging.ERROR)
        ctx.exit(1)
