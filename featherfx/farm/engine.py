"""Interface that carries orders to workers and news back; Dask (cluster.py) implements it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from featherfx.farm.work import Order

BEGUN, PROGRESS, DONE, FAILED, LOST, QUIET = "begun", "progress", "done", "failed", "lost", "quiet"


@dataclass(frozen=True)
class OrderNews:
    """News about an order.

    what: BEGUN; PROGRESS, with value the samples done and their number; DONE, with an OrderResult;
    FAILED, with an exception; LOST: every worker that took it was lost; QUIET: there was no news
    for a while, with the number of workers. number: of the order. place: address of the worker,
    with the number of its process.
    """

    what: str
    number: int = -1
    place: str = ""
    value: Any = None


class Engine(Protocol):
    """workers: their number when it was opened."""

    workers: int

    def meet(self) -> None:
        """Wait until they are there."""

    def submit(self, number: int, order: Order, avoid: str = "") -> None:
        """Give an order to a worker, not to the one to avoid if there are others. One that is lost
        is replaced."""

    def cancel(self, number: int) -> None:
        """Take an order back, or end its work at the next sample."""

    def share_out(self, busy: int) -> None:
        """Let so many workers have the machine's cores, where all are of one machine."""

    def hear(self) -> OrderNews:
        """The next news; waits for it, some seconds at most."""
