"""A bake that is killed continues; what it wrote is what an undisturbed bake writes."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES
from pxr import Sdf, Usd, UsdGeom

import featherfx
from featherfx.baking import frame_loop
from featherfx.baking.options import BakeOptions
from featherfx.baking.task import prepare
from featherfx.errors import InputError, Problem
from featherfx.solver.solver import Solver
from featherfx.usd.types import OutputError
from featherfx.usd.write.unfinished_cache import remove_cache

SHOT = SAMPLES / "feather_pull/shot.toml"
OPTIONS = {"layout": "clips", "chunk": 2, "quality": "draft"}
COMMAND = """
import sys, featherfx
featherfx.bake(sys.argv[1], sys.argv[2], layout=sys.argv[3], chunk=2, quality="draft", resume=True)
"""


def points(path: Path) -> dict[str, np.ndarray]:
    """(samples, V, 3) per prim."""
    stage = Usd.Stage.Open(str(path))
    found = {}
    for prim in stage.Traverse():
        attribute = UsdGeom.PointBased(prim).GetPointsAttr()
        if attribute:
            codes = attribute.GetTimeSamples()
            found[str(prim.GetPath())] = np.array([attribute.Get(code) for code in codes])
    return found


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("undisturbed") / "pull.usdc"
    featherfx.bake(SHOT, path, **OPTIONS)
    return path


@pytest.mark.parametrize(
    ("shot", "options", "chunk"),
    [("feather_pull", {}, 24), ("flapping_bird", {}, 8), ("flapping_bird", {"chunk": 5}, 5)],
)
def test_feathers_that_push_each_other_lose_fewer_frames(tmp_path, shot, options, chunk):
    task = prepare(SAMPLES / shot / "shot.toml", tmp_path / "o.usdc", BakeOptions(**options))
    assert task.options.chunk == chunk


def chunk_bytes(path: Path) -> dict[str, bytes]:
    """Of all complete chunks; those that are being written have names that begin with a dot."""
    folder = path.with_suffix(".clips")
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("[!.]*.usdc")}


def run_and_kill(path: Path, layout: str, seconds: float) -> bool:
    """Whether the bake came to its end before the kill."""
    process = subprocess.Popen([sys.executable, "-c", COMMAND, str(SHOT), str(path), layout])
    try:
        return process.wait(timeout=seconds) == 0
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.wait()
        return False


def kill_often(path: Path, layout: str, kills: int, seed: int) -> int:
    """Kill a bake at random times and check what is there; returns how many kills hit."""
    rng, hits, shortest = random.Random(seed), 0, 0.4
    for _ in range(kills):
        if run_and_kill(path, layout, rng.uniform(shortest, shortest + 2.0)):
            assert path.exists()
            break
        hits += 1
        for record in path.parent.rglob("0*.json"):
            layer = Sdf.Layer.OpenAsAnonymous(str(record.with_suffix(".usdc")))
            assert layer.endTimeCode == json.loads(record.read_text())["codes"][-1]
        if path.exists():
            assert points(path)
    return hits


@pytest.mark.parametrize("layout", ["clips", "flat"])
@pytest.mark.parametrize("kills", [2, pytest.param(25, marks=pytest.mark.slow)])
def test_killed_and_resumed_equals_undisturbed(tmp_path, undisturbed, layout, kills):
    path = tmp_path / "pull.usdc"
    hits = 0
    while hits < kills:
        hits += max(kill_often(path, layout, kills - hits, seed=kills + hits), 1)
        if path.exists() and hits < kills:
            # came to its end; once more from whatever chunks are there
            for file in path.parent.glob("*.usdc"):
                file.unlink()
    featherfx.bake(SHOT, path, **(OPTIONS | {"layout": layout}), resume=True)
    expected = points(undisturbed)
    found = points(path)
    assert list(found) == list(expected)
    for prim, values in expected.items():
        assert values.tobytes() == found[prim].tobytes()
    if layout == "clips":
        assert chunk_bytes(path) == chunk_bytes(undisturbed)
    else:
        assert [file.name for file in tmp_path.iterdir()] == ["pull.usdc"]


def stop_after(samples: int, path: Path | None = None):
    """Interrupts a bake after so many samples, and not before a chunk of the path is on disk."""

    def on_frame(done: int, total: int) -> None:
        if done > samples:
            end = time.monotonic() + 60.0
            while path is not None and not chunk_bytes(path) and time.monotonic() < end:
                time.sleep(0.01)
            raise KeyboardInterrupt

    return on_frame


@pytest.mark.parametrize("layout", ["clips", "flat", "payload"])
def test_an_interrupted_bake_takes_over_its_chunks(tmp_path, layout):
    path = tmp_path / "pull.usda"
    options = OPTIONS | {"layout": layout, "frames": (1, 9), "subframes": 2}
    with pytest.raises(KeyboardInterrupt, match=r"\d+ of 17 samples are kept"):
        featherfx.bake(SHOT, path, progress=stop_after(13), **options)
    assert not path.exists()
    result = featherfx.bake(SHOT, path, resume=True, **options).report
    assert result["samples_taken_over"] in (8, 12)
    whole = tmp_path / "whole" / "pull.usda"
    whole.parent.mkdir()
    featherfx.bake(SHOT, whole, **options)
    for prim, values in points(whole).items():
        assert values.tobytes() == points(path)[prim].tobytes()


@pytest.mark.parametrize("layout", ["clips", "flat"])
def test_the_frames_of_an_interrupted_bake_are_not_thrown_away(tmp_path, layout):
    path = tmp_path / "pull.usda"
    options = OPTIONS | {"layout": layout, "frames": (1, 8)}
    with pytest.raises(KeyboardInterrupt, match=r"(\d+) of 8 samples are kept") as stopped:
        featherfx.bake(SHOT, path, progress=stop_after(6), **options)
    kept = str(stopped.value).split()[1]
    left = {f: f.read_bytes() for f in tmp_path.rglob("*") if f.is_file()}
    with pytest.raises(InputError, match=f"holds {kept} samples .* --resume .* --overwrite"):
        featherfx.bake(SHOT, path, **options)
    assert {f: f.read_bytes() for f in tmp_path.rglob("*") if f.is_file()} == left
    result = featherfx.bake(SHOT, path, overwrite=True, **options).report
    assert result["samples_taken_over"] == 0
    assert len(points(path)) > 0


def test_a_finished_bake_is_left_alone(undisturbed, monkeypatch):
    before = {f: f.stat().st_mtime_ns for f in undisturbed.parent.rglob("*.usd*")}

    def simulate(*_, **__):
        raise AssertionError("simulated again")

    monkeypatch.setattr(Solver, "advance", simulate)
    monkeypatch.setattr(Solver, "equilibrium", simulate)
    featherfx.bake(SHOT, undisturbed, resume=True, **OPTIONS)
    assert {f: f.stat().st_mtime_ns for f in undisturbed.parent.rglob("*.usd*")} == before


def test_a_missing_chunk_of_a_finished_cache_is_baked_again(tmp_path):
    path = tmp_path / "pull.usda"
    options = OPTIONS | {"frames": (1, 6)}
    featherfx.bake(SHOT, path, **options)
    before = chunk_bytes(path)
    next(path.parent.rglob("0001.usdc")).unlink()
    featherfx.bake(SHOT, path, resume=True, **options)
    assert chunk_bytes(path) == before


@pytest.mark.parametrize("finished", [True, False])
def test_other_settings_are_never_mixed(tmp_path, finished):
    path = tmp_path / "pull.usda"
    options = OPTIONS | {"frames": (1, 6)}
    if finished:
        featherfx.bake(SHOT, path, **options)
    else:
        with pytest.raises(KeyboardInterrupt):
            featherfx.bake(SHOT, path, progress=stop_after(5, path), **options)
    before = chunk_bytes(path)
    other = options | {"quality": "preview", "up_axis": "Y"}
    with pytest.raises(InputError) as caught:
        featherfx.bake(SHOT, path, resume=True, **other)
    told = {problem.key: problem.message for problem in caught.value.problems}
    assert told["shot.quality.rows"] == "11 -> 21"
    assert told["up_axis"] == '"Z" -> "Y"'
    assert "frames" not in told
    assert chunk_bytes(path) == before
    featherfx.bake(SHOT, path, resume=True, overwrite=True, **other)
    assert not set(chunk_bytes(path)) & set(before)


def test_a_cache_of_unknown_settings_is_refused(tmp_path):
    path = tmp_path / "pull.usda"
    path.write_text("#usda 1.0\n")
    with pytest.raises(InputError, match="does not tell with which settings"):
        featherfx.bake(SHOT, path, resume=True, **OPTIONS)
    assert path.read_text() == "#usda 1.0\n"


def test_two_bakes_of_one_cache_do_not_meet(tmp_path):
    path = tmp_path / "pull.usda"
    options = OPTIONS | {"frames": (1, 4)}

    def second(done: int, total: int) -> None:
        if done == 3:
            with pytest.raises(InputError, match="another bake is writing this cache"):
                featherfx.bake(SHOT, path, **options)

    featherfx.bake(SHOT, path, progress=second, **options)
    assert len(chunk_bytes(path)) == 3


def test_a_comment_changes_nothing_but_a_value_does(tmp_path):
    shot, path = tmp_path / "shot.toml", tmp_path / "pull.usda"
    text = SHOT.read_text().replace('"groom.toml"', f'"{(SHOT.parent / "groom.toml").as_posix()}"')
    shot.write_text(text)
    options = OPTIONS | {"frames": (1, 2)}
    featherfx.bake(shot, path, **options)
    shot.write_text("# a comment\n" + text)
    assert featherfx.bake(shot, path, resume=True, **options).report["samples_taken_over"] == 2
    shot.write_text(text.replace("stiffness = 500", "stiffness = 501"))
    with pytest.raises(InputError, match=r"shot\.grip\[0\]\.stiffness: 500 -> 501"):
        featherfx.bake(shot, path, resume=True, **options)


def test_a_writer_that_cannot_be_built_ends_the_bake(tmp_path, monkeypatch):
    """It is built beside the simulation, where nothing is gone on with."""

    def refused(task):
        raise OutputError(Problem(str(task.path), "", "cannot be written"))

    monkeypatch.setattr(frame_loop, "new_writer", refused)
    for resume in (False, True):
        with pytest.raises(OutputError, match="cannot be written"):
            featherfx.bake(SHOT, tmp_path / "pull.usdc", **OPTIONS, resume=resume)
    assert not list(tmp_path.iterdir())


def test_a_removal_that_is_cut_off_leaves_no_record_of_a_missing_chunk(tmp_path, monkeypatch):
    path = tmp_path / "pull.usda"
    with pytest.raises(KeyboardInterrupt):
        featherfx.bake(SHOT, path, progress=stop_after(7), **OPTIONS | {"frames": (1, 9)})
    assert list(tmp_path.rglob("0*.json"))
    remove = Path.unlink

    def remove_and_look(file: Path, missing_ok: bool = False) -> None:
        remove(file, missing_ok)
        for record in tmp_path.rglob("[0-9]*.json"):
            assert record.with_suffix(".usdc").is_file()

    monkeypatch.setattr(Path, "unlink", remove_and_look)
    remove_cache(path)
    assert not list(tmp_path.rglob("0*"))
