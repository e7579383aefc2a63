"""Progress of long work on stderr: a bar on a terminal, plain lines elsewhere, JSON if asked.

Lines of Open Job Description go to stdout, where its sessions look for them.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from contextlib import AbstractContextManager
from typing import Any, Self

import click

from featherfx.cli.program import LOGGER, command_begin, raise_interrupt
from featherfx.phases import Account, PhaseState, time_left

_SECONDS_BETWEEN_LINES = 1.0
# of phases: those that are over sooner are not worth a line, others not one every second
_SHORT_PHASE, _SECONDS_BETWEEN_PHASE_LINES = 1.0, 2.0
_SECONDS_BETWEEN_JSON_LINES = 0.25
# s that are left, below which it is not said
_SOON = 1.0


class Progress:
    """Context manager; hears of every phase of the work in it (featherfx/phases.py). Call it with
    the units of work done and their number where the work itself is counted by its caller.

    label: of these units. style: "auto"; "openjd" for lines as Open Job Description has them
    (openjd_progress: per cent of the units, openjd_status: the phase, openjd_fail: why it ended);
    or "json" for lines

        {"progress": LABEL, "phase": NAME, "done": 3, "total": 24, "seconds": 1.5, "left": 10.5}

    one for each call, and for phases one at begin and end and at most four a second between. LABEL
    is the phase, for units the given one. seconds: since the start, so that a scheduler sees that
    work goes on. left: s to the end of the phase, null: not known. working: phases whose time the
    units take.
    """

    def __init__(
        self, label: str, style: str = "auto", working: tuple[str, ...] = ("simulating", "writing")
    ) -> None:
        self.label, self.style, self.working = label, style, working
        self.json = style != "auto"  # a line of its own for each piece of news
        self.account = Account(self._hear, command_begin())
        self.terminal = sys.stderr.isatty()
        self.lock = threading.RLock()
        self.bar: Any = None
        self.shown, self.bar_done = "", 0
        self.marks: list[tuple[float, float]] = []
        self.last_line, self.last_json = float("-inf"), ("", 0.0, 0.0)
        self.announced: set[str] = set()
        self.status = self.logged = ""

    def __enter__(self) -> Self:
        self.account.__enter__()
        return self

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        self._close_bar()
        self.account.__exit__()
        if self.style == "openjd" and isinstance(error, Exception):
            click.echo(f"openjd_fail: {'; '.join(str(error).splitlines())}")
        if isinstance(error, KeyboardInterrupt) and not str(error) and self.account.failed:
            raise KeyboardInterrupt(f"interrupted during {self.account.failed}") from error

    def __call__(self, done: float, total: float) -> None:
        raise_interrupt()
        spent = self.account.spent(*self.working) or self.account.elapsed
        # the first unit may cost nothing, as the frame that all feathers are settled at; the second
        # loads what all others need
        if len(self.marks) < 3:
            self.marks.append((done, spent))
        LOGGER.info("%s: %g of %g", self.label, done, total)
        first, since = self.marks[-1]
        left = self.account.left(self.working[0])
        if left is None:
            left = 0.0 if done == total else time_left(first, done, total, spent - since)
        with self.lock:
            if self.json:
                self._json_line(self.label, self.working[0], done, total, left)
            elif self.terminal:
                self._bar(self.label, done, total, left)
            else:
                now = time.monotonic()
                if done == total or now - self.last_line >= _SECONDS_BETWEEN_LINES:
                    self.last_line = now
                    self._line(self.label, done, total, left)

    def say(self, line: str) -> None:
        """A line of its own, beside the bar."""
        with self.lock:
            self._close_bar()
            click.echo(json.dumps({"message": line}) if self.style == "json" else line, err=True)

    def _hear(self, told: PhaseState) -> None:
        if threading.current_thread() is threading.main_thread():
            raise_interrupt()
        with self.lock:
            # begin and end of phases that take time; parts of one name, as kernels are, once
            if told.ended and told.seconds >= _SHORT_PHASE:
                LOGGER.info("%s: %.2f s", told.name, told.seconds)
            elif not told.ended and told.name != self.logged:
                LOGGER.info("%s begins", told.name)
            self.logged = told.name
            if told.name == "compiling" and not self.json:
                # say once that there is compiling, before the first kernel
                if told.name not in self.announced and told.left and told.left > _SOON:
                    self._close_bar()
                    click.echo(f"compiling, once, {about(told.left)}", err=True)
                self.announced.add(told.name)
            if self.json:
                self._json_phase(told)
            elif self.terminal:
                if told.ended:
                    self._close_bar()
                else:
                    self._bar(told.name, told.done, told.total or 1, told.left)
            elif not told.ended and told.seconds >= _SHORT_PHASE and told.total:
                now = time.monotonic()
                if now - self.last_line >= _SECONDS_BETWEEN_PHASE_LINES:
                    self.last_line = now
                    self._line(told.name, told.done, told.total, told.left)

    def _json_phase(self, told: PhaseState) -> None:
        now, total = time.monotonic(), told.total or 1
        done = told.done if told.total else int(told.ended)
        name, last, when = self.last_json
        is_news = (name, last) != (told.name, done)
        if is_news and (
            told.ended or name != told.name or now - when > _SECONDS_BETWEEN_JSON_LINES
        ):
            self.last_json = told.name, done, now
            self._json_line(told.name, told.name, done, total, told.left)

    def _json_line(
        self, label: str, phase: str, done: float, total: float, left: float | None
    ) -> None:
        if self.style == "openjd":
            if label == self.label:
                click.echo(f"openjd_progress: {100.0 * done / max(total, 1):.1f}")
            elif phase != self.status:
                self.status = phase
                click.echo(f"openjd_status: {phase}")
            return
        line = {
            "progress": label,
            "phase": phase,
            "done": int(done) if done == int(done) else done,
            "total": int(total) if total == int(total) else total,
            "seconds": round(self.account.elapsed, 3),
            "left": None if left is None else round(left, 2),
        }
        click.echo(json.dumps(line), err=True)

    def _line(self, label: str, done: float, total: float, left: float | None) -> None:
        more = f", {about(left)} left" if left is not None and left > _SOON else ""
        click.echo(f"{label}: {done:g} of {total:g}{more}", err=True)

    def _bar(self, label: str, done: float, total: float, left: float | None) -> None:
        if self.bar is None or self.shown != label:
            self._close_bar()
            bar: AbstractContextManager[Any] = click.progressbar(
                length=round(total),
                label=label,
                file=sys.stderr,
                show_pos=True,
                show_eta=False,
                item_show_func=lambda each: str(each) if each else None,
            )
            self.bar, self.shown, self.bar_done = bar.__enter__(), label, 0
        told = f"{about(left)} left" if left is not None and left > _SOON else None
        self.bar.update(round(done) - self.bar_done, told)
        self.bar_done = round(done)

    def _close_bar(self) -> None:
        if self.bar is not None:
            self.bar.__exit__(None, None, None)
            self.bar = None


def about(seconds: float) -> str:
    """A time for people."""
    if seconds < 45:
        return f"about {max(round(seconds), 1)} s"
    minutes = seconds / 60
    if minutes < 1.5:
        return "about a minute"
    return f"about {minutes:.0f} min" if minutes < 90 else f"about {minutes / 60:.1f} h"
