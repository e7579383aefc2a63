"""The log of a command (`--log FILE`), and what is told on stderr and logged.

Every line has time, process, level and text. Logs are appended to, so that a task that is tried
again has one log; a file that is something else is refused.
"""

from __future__ import annotations

import logging
import platform
import re
import shlex
import time
from pathlib import Path

import click

from featherfx._version import __version__
from featherfx.errors import InputError, Problem

LOGGER = logging.getLogger("featherfx")
LOGGER.addHandler(logging.NullHandler())  # else Python prints what nobody takes
_FORMAT = "%(asctime)s [%(process)d] %(levelname)s %(message)s"
_OURS = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} \[\d+\] [A-Z]+ ")


class _Lines(logging.FileHandler):
    """A log; what a full disk does not take is lost, and the work goes on."""

    def handleError(self, record: logging.LogRecord) -> None:
        pass


def open_log(ctx: click.Context, _: click.Parameter, path: Path | None) -> None:
    """Log this run to a file until its context ends. Raises InputError for a file that is no log
    and OSError for one that cannot be written to."""
    if path is None:
        return
    if path.exists() and not path.is_file():
        raise InputError(Problem(str(path), "", "is not a regular file, so no log"))
    if path.is_file() and path.stat().st_size:
        with path.open("rb") as file:
            if not _OURS.match(file.read(80)):
                raise InputError(Problem(str(path), "", "holds something else than a log"))
    handler = _Lines(path, encoding="utf-8", errors="backslashreplace")
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
    """A line on stderr, and in the log."""
    click.echo(line, err=True)
    LOGGER.log(level, "%s", line)
