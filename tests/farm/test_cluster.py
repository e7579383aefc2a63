"""Jobs on a Dask cluster, within this process and, marked slow, on processes that are killed."""

from __future__ import annotations

import gc
import logging
import os
import resource
import signal
import threading
from pathlib import Path

import pytest
from farm.farm_cases import options_of, shot_file

import featherfx
from featherfx.errors import InputError
from featherfx.farm import cluster as room
from featherfx.farm.job import Job
from featherfx.files.process import allow_threads, count_cores, limit_threads

distributed = pytest.importorskip("distributed")
OPTIONS = {"frames": (1, 3), "chunk": 2}


def test_two_shots_on_a_cluster_have_the_bytes_of_single_bakes(tmp_path, caplog):
    shots = [shot_file(tmp_path, "a", "feather_pull"), shot_file(tmp_path, "b", "swan_wing")]
    for shot in shots:
        featherfx.bake(shot, tmp_path / f"{shot.stem}.usdc", **OPTIONS)
    out = tmp_path / "out"
    out.mkdir()
    there = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    )
    told: list[tuple[float, float]] = []
    with there, caplog.at_level(logging.INFO, "featherfx.farm"):
        result = featherfx.bake_many(
            shots,
            out,
            scheduler=there.scheduler_address,
            workers=2,
            report=out / "report.json",
            progress=lambda *done: told.append(done),
            **OPTIONS,
        )
    for shot in shots:
        name = f"{shot.stem}.usdc"
        assert (out / name).read_bytes() == (tmp_path / name).read_bytes()
    assert sorted(each.name for each in out.iterdir()) == ["a.usdc", "b.usdc", "report.json"]
    assert [len(each["shares"]) for each in result["shots"]] == [1, 2]
    assert told[-1] == (6, 6)
    assert any("b 2/2: on inproc://" in line for line in caplog.messages)
    seconds = result["seconds"]
    assert list(seconds) == ["starting", "looking", "baking", "merging", "ending"]
    assert sum(seconds.values()) == pytest.approx(result["wall_seconds"])
    assert min(seconds.values()) >= 0.0
    shares = [share["wall_seconds"] for shot in result["shots"] for share in shot["shares"]]
    assert seconds["baking"] >= max(shares)


def test_a_wrong_shot_is_told_before_any_worker_is_there(tmp_path):
    def never():
        raise AssertionError("has waited for workers")

    shot = shot_file(tmp_path, "a", "feather_pull", "colour = 3\n")
    engine = room.DaskEngine(never, 2, starting=True)
    job = Job([shot], [tmp_path / "a.usdc"], options_of(), engine, None, lambda done, total: None)
    with pytest.raises(InputError, match="colour"):
        job.run()


def test_a_scheduler_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "_CALL", 0.3)
    shot = shot_file(tmp_path, "a", "feather_pull")
    for address in ("tcp://127.0.0.1:9", "nowhere:1:2", "carrier-pigeon://home"):
        with pytest.raises(InputError, match=f"scheduler: '{address}': no scheduler answers"):
            featherfx.bake_many([shot], tmp_path, scheduler=address)
        # closed by now; where Python finds it while the next one opens, that never does
        assert not any(type(each) is distributed.Client for each in gc.get_objects())


@pytest.mark.parametrize("error", [RuntimeError("Nanny failed to start."), OSError(28, "full")])
def test_processes_that_do_not_start_are_one_message(tmp_path, monkeypatch, error):
    def fail(**_):
        raise error

    monkeypatch.setattr(distributed, "LocalCluster", fail)
    shot = shot_file(tmp_path, "a", "feather_pull")
    with pytest.raises(InputError, match="engine dask: no process of this machine starts"):
        featherfx.bake_many([shot], tmp_path, workers=1)


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A shot and the bytes of its single bake."""
    folder = tmp_path_factory.mktemp("wing")
    shot = shot_file(folder, "wing", "swan_wing")
    featherfx.bake(shot, folder / "wing.usdc", chunk=2)
    return shot, (folder / "wing.usdc").read_bytes()


class Killer(logging.Handler):
    """Kills the worker that has the first share, so many times, once a chunk of it is there."""

    def __init__(self, folder: Path, kills: int) -> None:
        super().__init__()
        self.folder, self.left, self.seen = folder, kills, 0

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if "1/2: on " in text and self.left:
            self.left -= 1
            process = int(text.rpartition("process ")[2].rstrip(")"))
            threading.Thread(target=self.kill, args=(process,)).start()

    def kill(self, process: int) -> None:
        def records() -> int:
            return len(list(self.folder.glob(".wing.usdc.shares/*.1of2.clips/*/0*.json")))

        while records() <= self.seen:
            pass
        self.seen = records()
        os.kill(process, signal.SIGKILL)


@pytest.mark.slow
def test_a_worker_that_is_killed_twice_costs_its_unfinished_chunks(tmp_path, wing):
    shot, expected = wing
    log, killer = logging.getLogger("featherfx.farm"), Killer(tmp_path, 2)
    log.setLevel(logging.INFO)
    log.addHandler(killer)
    try:
        result = featherfx.bake_many([shot], tmp_path, workers=2, shares=2, chunk=2)
    finally:
        log.removeHandler(killer)
    assert (tmp_path / "wing.usdc").read_bytes() == expected
    assert [each.name for each in tmp_path.iterdir()] == ["wing.usdc"]
    first = result["shots"][0]["shares"][0]
    assert len(first["workers_lost"]) == 2
    assert first["samples_taken_over"] >= 4


class FewWorkers:
    """A client whose workers a test takes away; what it is asked to do stays undone."""

    def __init__(self, *workers):
        self.workers, self.asked, self.cancelled = list(workers), [], []
        self.threads = []

    def subscribe_topic(self, topic, heard):
        pass

    def scheduler_info(self, n_workers):
        return {"workers": dict.fromkeys(self.workers)}

    def run(self, function, threads, on_error):
        assert (function, on_error) == (allow_threads, "ignore")
        self.threads.append(threads)

    def submit(self, *order, key, workers):
        self.asked.append(workers)
        return Undone(lambda: self.cancelled.append(key))


class Undone:
    def __init__(self, cancel):
        self.cancel = cancel

    def done(self):
        return False

    def add_done_callback(self, told):
        pass


def test_an_order_is_bound_to_others_while_one_of_them_is_there(monkeypatch):
    monkeypatch.setattr(room, "_QUIET", 0.01)
    client = FewWorkers("full", "one", "other")
    engine = room.DaskEngine(lambda: client, 3)
    engine.submit(0, None)
    engine.submit(1, None, avoid="full (process 7)")
    assert client.asked == [None, ["one", "other"]]
    client.workers.remove("one")
    engine.hear()
    assert len(client.asked) == 2
    client.workers.remove("other")
    engine.hear()
    engine.hear()
    assert client.asked[2:] == [None]
    assert len(client.cancelled) == 1


def test_cores_are_shared_out_among_the_workers_that_have_something_to_do():
    client = FewWorkers("one", "other", "third")
    engine = room.DaskEngine(lambda: client, 3, cores=6)
    for busy in (5, 3, 2, 2, 1, 0, 4):
        engine.share_out(busy)
    assert client.threads == [2, 3, 6, 2]
    elsewhere = FewWorkers("one")
    room.DaskEngine(lambda: elsewhere, 1).share_out(1)
    assert elsewhere.threads == []


def test_a_worker_ends_at_once_unless_it_is_at_work(monkeypatch):
    from featherfx.farm import ignore_sigint

    ended = []
    monkeypatch.setattr(os, "_exit", ended.append)
    try:
        with room._ONE_AT_A_TIME:
            ignore_sigint.dask_teardown(None)
        assert ended == []
        ignore_sigint.dask_teardown(None)
        assert ended == [0]
    finally:
        ignore_sigint._loading.close()


def test_one_worker_of_this_machine_takes_what_a_job_tells_it(tmp_path):
    """And an interrupt from a terminal, which all processes get, is for the command."""
    with room.opened(None, 1) as engine:
        engine.share_out(1)
        client = engine._client
        assert list(client.run(limit_threads, 1000).values()) == [count_cores()]
        assert list(client.run(signal.getsignal, signal.SIGINT).values()) == [signal.SIG_IGN]


def _small_files() -> None:
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, most))


@pytest.mark.slow
def test_a_disk_that_is_full_on_one_worker_is_left_to_the_other(tmp_path, wing, caplog):
    shot, expected = wing
    there = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    )
    with there, distributed.Client(there) as client:
        full = next(iter(client.scheduler_info()["workers"]))
        client.run(_small_files, workers=[full])
        featherfx.bake_many([shot], tmp_path, scheduler=there.scheduler_address, workers=2, chunk=2)
    assert (tmp_path / "wing.usdc").read_bytes() == expected
    assert f"failed on {full}" in caplog.text


@pytest.mark.slow
def test_two_jobs_to_one_output_do_not_meet(tmp_path, wing):
    shot, expected = wing
    refused: list[BaseException] = []

    def second() -> None:
        try:
            featherfx.bake_many([shot], tmp_path, workers=1, shares=2, chunk=2)
        except InputError as error:
            refused.append(error)

    begun: list[threading.Thread] = []

    def begin(done: float, total: float) -> None:
        if not begun:
            begun.append(threading.Thread(target=second))
            begun[0].start()

    featherfx.bake_many([shot], tmp_path, workers=2, shares=2, chunk=2, progress=begin)
    begun[0].join()
    assert (tmp_path / "wing.usdc").read_bytes() == expected
    assert len(refused) == 1
