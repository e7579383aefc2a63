"""`featherfx bench --peers`: its page, and what it says without the peer."""

import importlib.util

import numpy as np
import pytest
from commands import invoke

from featherfx.lab.bench import peers


def test_without_the_peer_the_command_says_what_to_install(monkeypatch, tmp_path):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "mujoco" else found(name, *a)
    )
    result = invoke("bench", "--peers", "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert "featherfx[peers]" in result.stderr
    assert not (tmp_path / "out").exists()


def test_stress_and_peers_exclude_each_other():
    assert invoke("bench", "--peers", "--stress").exit_code == 2


def test_page_holds_what_was_measured():
    rows = [peers._row("program", 80, peers.PeerRun([[[0.0, 3.0, 4.0]]], 0.5, 16), [[0.0] * 3])]
    table = peers.ResultTable("peers_iso", "Isotropic strip", "note", rows)
    assert rows[0][peers.ERROR] == 5.0
    assert rows[0][peers.COST] == pytest.approx(2.5)
    files = peers.peer_files([table], "0.1.0")
    assert {"peers.md", "peers_iso.csv"} <= files.keys()
    assert "| program | 80 | 16 | 5 | 2.5 |" in files["peers.md"].decode()


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("program", "module"), [("mujoco_sheets", "mujoco"), ("newton_vbd", "newton")]
)
def test_sheets_of_a_peer_fall_roughly_as_ours_do(program, module):
    pytest.importorskip(module)
    run = getattr(peers, program)(1.0 / 240.0, 2)
    assert run.steps == 48
    assert run.tips.shape == (2, 2, 3)
    assert run.tips[:, 1, 2].max() < -0.15
    assert np.abs(np.diff(run.tips, axis=0)).max() < 1e-3
