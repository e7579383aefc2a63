"""What a job does after what, what it tries again, and the bytes of its caches."""

from __future__ import annotations

import pickle
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from commands import invoke
from farm.farm_cases import SerialEngine, options_of, shot_file

import featherfx
from featherfx.errors import InputError, Problem, SimulationError
from featherfx.farm import job as job_module
from featherfx.farm.job import Job
from featherfx.farm.work import _PATHS_VARIABLE, BAKE, MERGE, PLAN, Shares, mapped, outputs_of
from featherfx.files.atomic_write import Lock
from featherfx.usd.types import OutputError
from featherfx.usd.write.unfinished_cache import lock_file

OPTIONS = {"frames": (1, 3), "chunk": 1, "layout": "flat"}


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Bytes of single bakes, by layout."""
    found = {}
    for layout in ("flat", "clips"):
        folder = tmp_path_factory.mktemp(layout)
        featherfx.bake(
            shot_file(folder, "wing", "swan_wing"),
            folder / "wing.usdc",
            **{**OPTIONS, "layout": layout},
        )
        found[layout] = tree(folder)
    return found


def tree(folder: Path) -> dict[str, bytes]:
    files = sorted(each for each in folder.rglob("*") if each.is_file() and each.suffix != ".toml")
    return {str(each.relative_to(folder)): each.read_bytes() for each in files}


def job(folder: Path, engine: SerialEngine, shares: int | None = 3, **options: object) -> Job:
    shot = shot_file(folder, "wing", "swan_wing")
    out = folder / "out"
    out.mkdir(exist_ok=True)
    chosen = options_of(**{**OPTIONS, **options})
    return Job([shot], [out / "wing.usdc"], chosen, engine, shares, lambda done, total: None)


@pytest.mark.parametrize("layout", ["flat", "clips"])
def test_merged_shares_have_the_bytes_of_a_single_bake(tmp_path, single, layout):
    engine, counted = SerialEngine(), []
    work = job(tmp_path, engine, layout=layout)
    work._notify = lambda done, total: counted.append((done, total))
    (told,) = work.run()
    assert tree(tmp_path / "out") == single[layout]
    # two workers merge a run of the three chunks each, then one all of them
    steps = [(order.what, order.share or order.piece) for order, _ in engine.given]
    baked = [(BAKE, 1), (BAKE, 2), (BAKE, 3)]
    assert steps == [(PLAN, 0), *baked, (MERGE, 1), (MERGE, 2), (MERGE, 0)]
    assert [share["feathers"] for share in told["shares"]] == [7, 7, 6]
    # the last of the shares has the cores of all, as has what completes the whole
    assert engine.shared[0] == 3
    assert {1, 2, 3} <= set(engine.shared)
    assert engine.shared[-1] == 0
    # frames of all shares are counted once
    assert counted == sorted(counted)
    assert counted[-1] == (3, 3)


def test_what_is_most_work_is_given_out_first(tmp_path):
    """A shot of 20 feathers before one of a single feather; shares of 7, 7 and 6 in their order."""
    refused = InputError(Problem("shot", "", "is not baked here"))
    engine = SerialEngine(fail=lambda order, times: refused if order.what == BAKE else None)
    shots = [shot_file(tmp_path, name, name) for name in ("feather_pull", "swan_wing")]
    outputs = [shot.with_suffix(".usdc") for shot in shots]
    with pytest.raises(InputError):
        Job(shots, outputs, options_of(**OPTIONS), engine, 1, lambda done, total: None).run()
    names = [Path(order.shot).stem for order, _ in engine.given if order.what == BAKE]
    assert names == ["swan_wing", "feather_pull"]


def test_what_took_longest_before_is_given_out_first(tmp_path, monkeypatch):
    """Once all shares of a shot were baked, whole; a share that was not says nothing."""
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path / "cache"))
    done, shot = job_module.OrderResult, tmp_path / "wing.toml"

    class Timed(SerialEngine):
        def _carry_out(self, number, order, avoid):
            super()._carry_out(number, order, avoid)
            took = {1: 3.0, 2: 9.0, 3: 6.0}.get(order.share, 1.0)
            if isinstance(self._news[-1].value, done):
                times = {"wall_seconds": 1.0, "processor_seconds": took}
                news = self._news.pop()
                self._news.append(replace(news, value=replace(news.value, times=times)))

    def order_of(engine, **options):
        job(tmp_path, engine, **options).run()
        return [order.share for order, _ in engine.given if order.what == BAKE]

    assert order_of(Timed()) == [1, 2, 3]
    assert job_module.read_share_times(shot, [7, 7, 6]) == [1.0, 3.0, 2.0]
    assert order_of(Timed(), overwrite=True) == [2, 3, 1]
    # of other shares nothing is known
    assert job_module.read_share_times(shot, [10, 10]) == []
    assert order_of(Timed(), shares=2, overwrite=True) == [1, 2]


def test_what_cannot_be_written_is_tried_by_another_worker_and_then_given_up(tmp_path, single):
    full = OutputError(Problem("wing", "", "no space left on device"))

    def once(order, times):
        return full if (order.what, order.share, times) == (BAKE, 2, 1) else None

    engine = SerialEngine(fail=once)
    job(tmp_path, engine).run()
    assert tree(tmp_path / "out") == single["flat"]
    second = [place for order, place in engine.given if order.share == 2]
    assert second == ["a", "b"]

    always = SerialEngine(fail=lambda order, times: full if order.share == 2 else None)
    with pytest.raises(InputError, match=r"no space left on device \(wing 2/3 on"):
        job(tmp_path, always, overwrite=True).run()
    # what was there stays, and the shares that were baked wait for --resume
    assert set(tree(tmp_path / "out")) > {"wing.usdc", ".wing.usdc.shares/shares.json"}
    with pytest.raises(InputError, match="a job has begun it"):
        job(tmp_path, SerialEngine()).run()


def test_a_job_goes_on_with_what_another_has_begun(tmp_path, single):
    def no_third(order, times):
        return SimulationError("left", 0.0, "it broke", 2) if order.share == 3 else None

    with pytest.raises(InputError, match="it broke"):
        job(tmp_path, SerialEngine(fail=no_third)).run()
    with pytest.raises(InputError, match="--resume goes on, --overwrite bakes anew"):
        job(tmp_path, SerialEngine()).run()
    # the number of shares stays that of the job that began, whatever is asked for
    (told,) = job(tmp_path, SerialEngine(), shares=5, resume=True).run()
    assert [share["samples_taken_over"] for share in told["shares"]] == [3, 3, 0]
    assert tree(tmp_path / "out") == single["flat"]


def test_merging_that_fails_is_done_again(tmp_path, single):
    """Of a run of chunks, and of the whole; one worker merges in one piece."""
    full = OutputError(Problem("wing", "", "no space left on device"))

    def once(order, times):
        return full if (order.what, order.piece, times) in ((MERGE, 1, 1), (MERGE, 0, 1)) else None

    engine = SerialEngine(fail=once)
    job(tmp_path, engine, shares=2).run()
    assert tree(tmp_path / "out") == single["flat"]
    merged = [order.piece for order, _ in engine.given if order.what == MERGE]
    assert sorted(merged) == [0, 0, 1, 1, 2]
    one_worker = SerialEngine(workers=1)
    (tmp_path / "out" / "wing.usdc").unlink()
    job(tmp_path, one_worker, shares=2).run()
    assert tree(tmp_path / "out") == single["flat"]
    assert [order.piece for order, _ in one_worker.given if order.what == MERGE] == [0]


def test_other_shots_go_on_and_nothing_begins_while_one_is_wrong(tmp_path):
    good, other = shot_file(tmp_path, "a", "feather_pull"), shot_file(tmp_path, "b", "swan_wing")
    outputs = outputs_of([good, other], tmp_path)
    assert [each.name for each in outputs] == ["a.usdc", "b.usdc"]

    def broken(what):
        def fail(order, times):
            wrong = (Path(order.shot).stem, order.what) == ("b", what)
            return SimulationError("left", 0.0, "it broke", 2) if wrong else None

        return fail

    for what, there in ((PLAN, []), (BAKE, ["a.usdc"])):
        engine = SerialEngine(fail=broken(what))
        chosen = options_of(**OPTIONS)
        with pytest.raises(InputError, match="it broke"):
            Job([good, other], outputs, chosen, engine, 1, lambda done, total: None).run()
        assert sorted(each.name for each in tmp_path.glob("*.usdc")) == there


def test_an_output_that_another_bake_writes_is_refused(tmp_path):
    work, engine = job(tmp_path, SerialEngine()), SerialEngine()
    held = Lock(lock_file(tmp_path / "out" / "wing.usdc"))
    with pytest.raises(InputError, match="another bake is writing this cache"):
        work.run()
    # nor are the shares of a job that runs removed
    shares = Shares(tmp_path / "out" / "wing.usdc")
    shares.begin(3)
    with pytest.raises(InputError, match="another bake is writing this cache"):
        job(tmp_path, SerialEngine(), overwrite=True).run()
    assert shares.begun() == 3
    held.release()
    shares.remove()
    job(tmp_path, engine).run()
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == ["wing.usdc"]


def test_outputs_of_shots_of_one_file_name_take_the_shots_names(tmp_path):
    first, second = tmp_path / "1" / "shot.toml", tmp_path / "2" / "shot.toml"
    for k, path in enumerate((first, second)):
        path.parent.mkdir()
        path.write_text(f'name = "wing {k}"')
    found = outputs_of([first, second], tmp_path)
    assert [each.name for each in found] == ["wing_0.usdc", "wing_1.usdc"]
    with pytest.raises(InputError, match=r"would be wing_0\.usdc, as .*1/shot\.toml is"):
        outputs_of([first, first], tmp_path)
    with pytest.raises(InputError, match="Name a folder for 2 shots"):
        outputs_of([first, second], tmp_path / "x.usdc")


def test_paths_are_those_of_the_worker(monkeypatch):
    monkeypatch.setenv(_PATHS_VARIABLE, "/show=/mnt/show:/tmp=/scratch")
    assert mapped("/show/a.toml") == "/mnt/show/a.toml"
    assert mapped("/shows/a.toml") == "/shows/a.toml"
    assert mapped("/tmp") == "/scratch"


@pytest.mark.parametrize(
    "error",
    [
        OutputError(Problem("a", "b", "c"), Problem("d", "", "e")),
        SimulationError("left", 0.25, "it broke", 7.0),
    ],
)
def test_errors_go_from_process_to_process(error):
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is type(error)
    assert (str(found), vars(found)) == (str(error), vars(error))


def test_the_command_bakes_a_folder_of_shots(tmp_path, monkeypatch, single):
    shots = [shot_file(tmp_path, name, "swan_wing") for name in ("wing", "other")]
    out = tmp_path / "out"
    opened: list[tuple[object, object]] = []

    @contextmanager
    def serial(scheduler, workers):
        opened.append((scheduler, workers))
        yield SerialEngine()

    monkeypatch.setattr("featherfx.farm.job.opened", serial)
    monkeypatch.setattr("featherfx.farm.origin.begin", lambda: None)
    given = ["bake", *map(str, shots), "-o", str(out), "--frames", "1-3", "--chunk", "1"]
    given += ["--layout", "flat", "--engine", "dask", "--workers", "2"]
    result = invoke(*given, "--quality", "nothing")
    assert result.exit_code == 1
    assert not out.exists()
    opened.clear()
    result = invoke(*given)
    assert result.exit_code == 0, result.stderr
    assert opened == [(None, 2)]
    assert sorted(tree(out)) == ["other.usdc", "wing.usdc"]
    assert tree(out)["wing.usdc"] == single["flat"]["wing.usdc"]
    assert "featherfx: wing 2/2: done on a in" in result.stderr
    assert f"{out / 'other.usdc'}: 20 feathers, 3 frames" in result.stderr
    result = invoke(*given)
    assert result.exit_code == 1
    assert result.stderr.count("exists already. Choose another name or --overwrite") == 2


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["a.toml", "b.toml"], "are for --engine dask"),
        (["a.toml", "--workers", "2"], "are for --engine dask"),
        (["a.toml", "--engine", "dask", "--plan", "2"], "Leave out --engine dask"),
    ],
)
def test_options_that_do_not_go_together_are_wrong_usage(given, told):
    result = invoke("bake", *given)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
