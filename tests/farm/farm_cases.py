"""Shots for jobs, and an engine without processes."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, SimulationError
from featherfx.farm.work import BEGUN, DONE, FAILED, QUIET, SHARE_PROGRESS, Order, OrderNews, work
from featherfx.files.folders import SHIPPED_PRESETS

SAMPLES = Path(__file__).resolve().parents[2] / "samples"


def shot_file(folder: Path, name: str, sample: str, more: str = "") -> Path:
    """A copy of a sample's shot under another name."""
    text = (SAMPLES / sample / "shot.toml").read_text()
    groom = (SAMPLES / sample / "groom.toml").as_posix()
    path = folder / f"{name}.toml"
    path.write_text(text.replace('"groom.toml"', f'"{groom}"') + more)
    return path


class SerialEngine:
    """Carries orders out in this process, one after the other; fail decides by an order and the
    number of times that it came which error it ends with (None: none)."""

    def __init__(self, workers: int = 2, fail: Any = lambda order, times: None) -> None:
        self.workers, self._fail = workers, fail
        self._news: deque[OrderNews] = deque()
        self._orders: deque[tuple[int, Order, str]] = deque()
        self.given: list[tuple[Order, str]] = []
        self.cancelled: list[int] = []
        self.shared: list[int] = []

    def meet(self) -> None:
        pass

    def submit(self, number: int, order: Order, avoid: str = "") -> None:
        self._orders.append((number, order, avoid))

    def cancel(self, number: int) -> None:
        self.cancelled.append(number)
        self._orders = deque(each for each in self._orders if each[0] != number)

    def share_out(self, busy: int) -> None:
        self.shared.append(busy)

    def hear(self) -> OrderNews:
        if not self._news and self._orders:
            self._carry_out(*self._orders.popleft())
        return self._news.popleft() if self._news else OrderNews(QUIET, value=self.workers)

    def _carry_out(self, number: int, order: Order, avoid: str) -> None:
        place = "b" if avoid == "a" else "a"
        self.given.append((order, place))
        self._news.append(OrderNews(BEGUN, number, place))
        times = sum(each == order for each, _ in self.given)
        error = self._fail(order, times)
        try:
            if error is not None:
                raise error
            done = work(
                order,
                lambda *done: self._news.append(OrderNews(SHARE_PROGRESS, number, place, done)),
            )
            self._news.append(OrderNews(DONE, number, place, done))
        except (InputError, SimulationError) as raised:
            self._news.append(OrderNews(FAILED, number, place, raised))


def options_of(**changed: Any) -> dict[str, Any]:
    """What a job gives its workers."""
    from dataclasses import asdict

    from featherfx.baking.options import BakeOptions

    return asdict(BakeOptions(preset_folders=(SHIPPED_PRESETS,), **changed))
