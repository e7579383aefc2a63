"""Orders to the workers of a Dask cluster: one that is there, or processes of this machine.

Workers take one order at a time, whatever their threads: a bake has threads of its own. While those
of this machine start, the first shot is looked at here.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import queue
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from featherfx.errors import InputError, Problem, SimulationError
from featherfx.farm.origin import forked
from featherfx.farm.work import (
    BEGUN,
    DONE,
    FAILED,
    LOST,
    PLAN,
    QUIET,
    SHARE_PROGRESS,
    Order,
    OrderNews,
    work,
)
from featherfx.files.process import allow_threads, count_cores

if TYPE_CHECKING:
    from distributed import Client, Future

# s to wait for a scheduler, and for its workers; between two pieces of news before it is QUIET;
# between two of one order's progress
_CALL, _MEET, _QUIET, _OFTEN = 10.0, 60.0, 30.0, 0.2

# what workers of this machine load before their first order, while others are looked at
_LOADED = ["featherfx.farm.ignore_sigint", "featherfx.farm.work", "featherfx.baking.frame_loop"]

_ONE_AT_A_TIME = threading.Lock()
_LOG = logging.getLogger("featherfx.farm")
# below "distributed.worker", so that a worker's own log holds these lines
_WORKER_LOG = logging.getLogger("distributed.worker.featherfx")


def is_at_work() -> bool:
    """Check that this process carries out an order."""
    return _ONE_AT_A_TIME.locked()


class Withdrawn(Exception):
    """The order was taken back."""


class DaskEngine:
    """An Engine of the workers that a client knows.

    connect: gives the client when workers are there. workers: their number. starting: whether they
    still start, so that the first look is taken here. cores: that they share, where all are
    processes of this machine.
    """

    def __init__(
        self,
        connect: Callable[[], Client],
        workers: int,
        starting: bool = False,
        cores: int | None = None,
    ) -> None:
        self._connect, self.workers, self._is_free = connect, workers, starting
        self._cores, self._threads = cores, 0
        self._topic = f"featherfx-{uuid.uuid4().hex}"
        self._looks: list[tuple[int, Order]] = []
        self._news: queue.SimpleQueue[OrderNews] = queue.SimpleQueue()
        self._futures: dict[int, Future] = {}
        # orders that some workers alone may take, with these
        self._bound: dict[int, tuple[Order, set[str]]] = {}

    @cached_property
    def _client(self) -> Client:
        client = self._connect()
        client.subscribe_topic(self._topic, self._heard)
        return client

    def meet(self) -> None:
        _ = self._client

    def _heard(self, event: tuple[float, dict[str, Any]]) -> None:
        told = {each: event[1][each] for each in OrderNews.__dataclass_fields__}
        self._news.put(OrderNews(**told))

    def _addresses(self) -> list[str]:
        return list(self._client.scheduler_info(n_workers=-1)["workers"])

    def submit(self, number: int, order: Order, avoid: str = "") -> None:
        if self._is_free and order.what == PLAN:
            self._is_free = False
            self._looks.append((number, order))
            return
        others = [each for each in self._addresses() if not avoid.startswith(f"{each} ")]
        self._bound.pop(number, None)
        if avoid and others:
            # strictly, since what others may take as well is stolen by whoever is idle
            self._bound[number] = order, set(others)
        future = self._client.submit(
            on_worker,
            number,
            order,
            self._topic,
            key=f"{self._topic}-{number}-{uuid.uuid4().hex}",
            workers=others if number in self._bound else None,
        )
        self._futures[number] = future
        future.add_done_callback(lambda done: self._ended(number, done))

    def _ended(self, number: int, future: Future) -> None:
        if self._futures.get(number) is future:
            self._bound.pop(number, None)
            self._news.put(self._outcome(number, future))

    def _free_those_whose_workers_are_gone(self) -> None:
        there = set(self._addresses()) if self._bound else set()
        for number, (order, others) in list(self._bound.items()):
            if not others & there and not self._futures[number].done():
                self.cancel(number)
                self.submit(number, order)

    def _outcome(self, number: int, future: Future) -> OrderNews:
        if future.status == "finished":
            return OrderNews(**future.result())
        if future.status == "error":
            from distributed import KilledWorker

            error = future.exception()
            return OrderNews(LOST if isinstance(error, KilledWorker) else FAILED, number, "", error)
        message = "the connection to the scheduler was lost. --resume goes on"
        return OrderNews(FAILED, number, "", InputError(Problem("scheduler", "", message)))

    def cancel(self, number: int) -> None:
        self._bound.pop(number, None)
        with contextlib.suppress(Exception):
            self._futures.pop(number).cancel()

    def share_out(self, busy: int) -> None:
        if self._cores is None:
            return
        threads = max(1, self._cores // max(1, min(busy, self.workers)))
        if threads != self._threads:
            self._threads = threads
            self._client.run(allow_threads, threads, on_error="ignore")

    def hear(self) -> OrderNews:
        if self._looks:
            number, order = self._looks.pop()
            with _ONE_AT_A_TIME:
                what, value = _carried_out(order, lambda done, total: None)
            return OrderNews(what, number, value=value)
        self._free_those_whose_workers_are_gone()
        try:
            return self._news.get(timeout=_QUIET)
        except queue.Empty:
            return OrderNews(QUIET, value=len(self._addresses()))


def on_worker(number: int, order: Order, topic: str) -> dict[str, Any]:
    """Carry out an order within a worker; returns the fields of its OrderNews."""
    from distributed import get_worker

    worker: Any = get_worker()
    key, own = worker.get_current_task(), f"{worker.address} (process {os.getpid()})"
    last = [0.0]

    def notify(done: int, total: int) -> None:
        task = worker.state.tasks.get(key)
        if task is None or task.state == "cancelled":
            raise Withdrawn
        now = time.monotonic()
        if now - last[0] > _OFTEN or done == total:
            last[0] = now
            tell(SHARE_PROGRESS, (done, total))

    def tell(what: str, value: Any = None) -> None:
        # Dask adds a key "worker"
        worker.log_event(topic, {"what": what, "number": number, "place": own, "value": value})

    place = f"{order.shot} {order.share}/{order.shares} to {order.output}"
    with _ONE_AT_A_TIME:
        _WORKER_LOG.info("%s %s", order.what, place)
        tell(BEGUN)
        what, value = _carried_out(order, notify)
        _WORKER_LOG.info("%s %s: %s", order.what, place, value if what == FAILED else what)
    return {"what": what, "number": number, "place": own, "value": value}


def _carried_out(order: Order, notify: Callable[[int, int], None]) -> tuple[str, Any]:
    try:
        return DONE, work(order, notify)
    except (InputError, SimulationError) as error:
        return FAILED, error
    except Withdrawn:
        return FAILED, None  # nobody listens


@contextlib.contextmanager
def opened(scheduler: str | None, workers: int | None) -> Iterator[DaskEngine]:
    """An engine of a scheduler's workers, or of processes of this machine.

    scheduler: address; None: none. workers: processes, by default one for each core; of a
    scheduler, how many to wait for. Raises InputError where Dask is not installed, no scheduler
    answers or no worker comes.
    """
    try:
        import distributed
    except ImportError:
        message = 'needs pip install "featherfx[dask]"'
        raise InputError(Problem("engine dask", "", message)) from None
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="featherfx-dask-"))
            count = workers or count_cores()
            connect = stack.enter_context(_local(distributed, count, folder))
            yield DaskEngine(connect, count, starting=True, cores=count_cores())
        else:
            client = stack.enter_context(_client(distributed, scheduler, workers or 1))
            there = client.scheduler_info(n_workers=-1)["workers"]
            yield DaskEngine(lambda: client, len(there))


@contextlib.contextmanager
def _local(distributed: Any, workers: int, folder: str) -> Iterator[Callable[[], Client]]:
    """Processes of this machine that nobody else can give work to (TLS, keys in memory); what is
    given waits until they are there."""
    with ThreadPoolExecutor(1) as beside, contextlib.ExitStack() as stack, forked():
        starting = beside.submit(
            distributed.LocalCluster,
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=None,
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            local_directory=folder,
            security=distributed.Security.temporary(),
            silence_logs=logging.CRITICAL,
            preload=_LOADED,
            env={"MALLOC_TRIM_THRESHOLD_": str(1 << 30)},
        )

        @cache
        def open_cluster() -> Any:
            try:
                return stack.enter_context(starting.result())
            except (RuntimeError, OSError) as error:
                message = f"no process of this machine starts ({error}). Use --engine local. In a"
                message += " script, call bake_many below if __name__ == '__main__'"
                raise InputError(Problem("engine dask", "", message)) from error

        try:
            yield lambda: stack.enter_context(distributed.Client(open_cluster()))
        finally:
            # closed with what is open, even where nobody has waited for it
            with contextlib.suppress(InputError):
                open_cluster()


def _connected(distributed: Any, address: str) -> Client:
    try:
        return distributed.Client(address, timeout=_CALL)
    except (OSError, ValueError, TimeoutError) as error:
        message = f"no scheduler answers there within {_CALL:g} s ({error})"
    # What is left of the client closes its loop when Python finds it: where that is while another
    # client opens one, both wait for ever.
    gc.collect()
    raise InputError(Problem("scheduler", "", f"'{address}': {message}"))


@contextlib.contextmanager
def _client(distributed: Any, address: str, workers: int) -> Iterator[Client]:
    client = _connected(distributed, address)
    with client:
        try:
            client.wait_for_workers(workers, timeout=_MEET)
        except TimeoutError:
            found = len(client.scheduler_info(n_workers=-1)["workers"])
            message = f"'{address}' has {found} workers after {_MEET:g} s, not {workers}"
            raise InputError(Problem("scheduler", "", message)) from None
        known = client.scheduler_info(n_workers=-1)["workers"].values()
        if any(each["nthreads"] > 1 for each in known):
            _LOG.warning("workers bake one share at a time; --nthreads 1 lets Dask know")
        yield client
