"""What is set up once per content: the same bytes and warnings, whoever computed it first."""

from __future__ import annotations

import threading
import warnings
import weakref
from pathlib import Path

import pytest

import featherfx
from featherfx.baking import export, frame_loop, pipeline
from featherfx.errors import InputError, Problem
from featherfx.feather import build, shapes
from featherfx.mechanics import batch
from featherfx.shot.contact import pairs
from featherfx.shot.loop import placement
from featherfx.solver import damping
from featherfx.usd.write.cache_writer import CacheWriter

GROOM = """
name = "crowded"

[[row]]
id = "a"
kind = "swan_secondary"
count = 4
first = { position = [0.0, 0.0, 0.0], direction = [-1.0, 0.0, 0.0], up = [0, 0, 1] }
last = { position = [0.0, -0.06, 0.0], direction = [-1.0, 0.3, 0.0], up = [0, 0, 1] }
"""
SHOT = """
name = "crowd"
groom = "groom.toml"
frames = [1, 2]
quality = { base = "draft", coefficients = 1 }  # as many in any wind
wind = "breeze"

[contact]
"""


@pytest.fixture
def shot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path / "cache"))

    (tmp_path / "groom.toml").write_text(GROOM)
    (tmp_path / "shot.toml").write_text(SHOT)
    return tmp_path / "shot.toml"


def forgotten() -> None:
    """As a process that has just begun."""
    shapes.built_shapes.cache_clear()


def baked(shot: Path, name: str, **options) -> tuple[bytes, list[str]]:
    forgotten()
    path = shot.parent / name / "crowd.usdc"
    path.parent.mkdir()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        featherfx.bake(shot, path, **options)
    return path.read_bytes(), sorted(str(each.message) for each in caught)


def test_a_second_bake_computes_no_shape_model_or_pair_anew(shot, monkeypatch):
    first = baked(shot, "first")

    def computed(*_, **__):
        raise AssertionError("computed anew")

    with monkeypatch.context() as patch:
        for module, name in (
            (build, "build_feather"),
            (batch, "make_model"),
            (damping, "with_damping"),
            (pairs, "_near_pairs"),
        ):
            patch.setattr(module, name, computed)
        assert baked(shot, "second") == first
        # another wind touches none of these
        text = shot.read_text().replace('"breeze"', '{ base = "breeze", speed = 5.0 }')
        shot.write_text(text)
        assert baked(shot, "windy")[0] != first[0]
        forgotten()
        assert pipeline.check(shot) == []
        pipeline.plan(shot, shot.parent / "crowd.usdc", 1)
    shot.write_text(SHOT)
    monkeypatch.setenv("FEATHERFX_CACHE_SIZE", "0")
    assert baked(shot, "unkept") == first
    monkeypatch.delenv("FEATHERFX_CACHE_SIZE")
    for file in (shot.parent / "cache" / "content").iterdir():
        file.write_bytes(b"damaged")
    assert baked(shot, "damaged") == first


@pytest.mark.parametrize("output", [".", "there.usdc", "nowhere/crowd.usdc"])
def test_an_output_is_refused_before_feathers_are_laid_over_each_other(shot, monkeypatch, output):
    def laid(*_):
        raise AssertionError("laid out")

    monkeypatch.setattr(placement, "lay_out", laid)
    monkeypatch.setattr(export, "lay_out", laid)
    monkeypatch.chdir(shot.parent)
    told = r"no name of a file|exists already|does not exist"
    for name in ("there.usdc", "there.plan.json"):
        Path(name).touch()
    with pytest.raises(InputError, match=told):
        featherfx.bake(shot, output)
    with pytest.raises(InputError, match=told):
        pipeline.export_groom("groom.toml", output)
    with pytest.raises(InputError, match=told):
        pipeline.plan(shot, output, 2)
    # a shot that is wrong as well is told with it
    shot.write_text(SHOT.replace('"breeze"', '"breaze"'))
    with pytest.raises(InputError, match=f"(?s)breaze.*({told})"):
        featherfx.bake(shot, output)


def test_what_later_bakes_compare_is_found_beside_the_frames(shot, monkeypatch):
    threads, own = [], frame_loop.cache_tables

    def noted(*given):
        threads.append(threading.current_thread())
        return own(*given)

    monkeypatch.setattr(frame_loop, "cache_tables", noted)
    baked(shot, "one")
    assert len(threads) == 1
    assert threads[0] is not threading.main_thread()


def test_where_it_cannot_be_found_nothing_is_written(shot, monkeypatch):
    def failing(*_):
        raise InputError(Problem("shot.toml", "wind", "is no more"))

    monkeypatch.setattr(frame_loop, "cache_tables", failing)
    with pytest.raises(InputError, match="is no more"):
        baked(shot, "one")
    assert not (shot.parent / "one" / "crowd.usdc").exists()


def test_what_was_simulated_is_gone_when_the_writer_ends(shot, monkeypatch):
    simulations, standing = [], []
    simulate, end = frame_loop.simulate, CacheWriter._finish

    def noted(*given):
        simulation = simulate(*given)
        simulations.append(weakref.ref(simulation))
        return simulation

    def ended(writer):
        standing.extend(each() for each in simulations)
        end(writer)

    monkeypatch.setattr(frame_loop, "simulate", noted)
    monkeypatch.setattr(CacheWriter, "_finish", ended)
    baked(shot, "first")
    assert standing == [None]
