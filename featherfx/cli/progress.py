"""Progress of long work on stderr: a bar on a terminal, plain lines elsewhere, JSON if asked."""

from __future__ import annotations

import json
import sys
import time
from types import TracebackType
from typing import Any, Self

import click

from featherfx.cli.program import raise_interrupt

_SECONDS_BETWEEN_LINES = 1.0


class Progress:
    """Context manager; call it with the units of work done and their number.

    style: "auto", or "json" for lines {"progress": LABEL, "done": 3, "total": 24, "seconds": 1.5},
    one for each call: seconds since the start, so that a scheduler sees that work goes on.
    """

    def __init__(self, label: str, style: str = "auto") -> None:
        self.label, self.json = label, style == "json"
        self.begin = time.monotonic()
        self.terminal = sys.stderr.isatty()
        self.bar: Any = None
        self.done = 0
        self.last_line = float("-inf")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.bar is not None:
            self.bar.__exit__(kind, error, trace)

    def __call__(self, done: int, total: int) -> None:
        raise_interrupt()
        if self.json:
            seconds = round(time.monotonic() - self.begin, 3)
            line = {"progress": self.label, "done": done, "total": total, "seconds": seconds}
            click.echo(json.dumps(line), err=True)
            return
        if self.terminal:
            if self.bar is None:
                bar = click.progressbar(
                    length=total, label=self.label, file=sys.stderr, show_pos=True
                )
                self.bar = bar.__enter__()
            self.bar.update(done - self.done)
            self.done = done
            return
        now = time.monotonic()
        if done == total or now - self.last_line >= _SECONDS_BETWEEN_LINES:
            self.last_line = now
            click.echo(f"{self.label}: {done} of {total}", err=True)
