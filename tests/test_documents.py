"""The documents: examples in Python run as they stand, and the site builds without warnings."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import featherfx
from featherfx.baking.install import copy_sample
from featherfx.errors import InputError
from featherfx.usd.read.cache import Cache

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """What is known after the examples of docs/python.md, and the folder in which they ran."""
    folder, before = tmp_path_factory.mktemp("python"), Path.cwd()
    copy_sample("feather_pull", folder / "feather_pull")
    text = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    assert len(blocks) == 6
    known = {}
    os.chdir(folder)
    try:
        for block in blocks:
            exec(compile(block, "docs/python.md", "exec"), known)
    finally:
        os.chdir(before)
    return known, folder


def test_the_loop_of_the_page_writes_what_a_bake_writes(ran):
    _, folder = ran
    baked, own = Cache(folder / "pull.usdc"), Cache(folder / "own.usdc")
    for code in (1.0, 2.0, 3.0):
        np.testing.assert_array_equal(baked.points(0, code), own.points(0, code))


def test_a_simulation_goes_on_from_a_checkpoint_with_other_loads(ran):
    known, _ = ran
    shot, half = known["shot"], known["half"]
    on, whole, fallen = (
        [frame.rows[0] for frame in featherfx.simulate(each, frames=(6, 8), start=start)]
        for each, start in ((shot, half), (shot, None), (known["fallen"], half))
    )
    np.testing.assert_array_equal(on, whole)
    # the grip holds the tip; the middle of the shaft sinks
    middle = shot.quality.rows // 2
    sunk = on[-1][middle, 0, 2] - fallen[-1][middle, 0, 2]
    assert 1e-6 < sunk < 1e-3


def test_a_checkpoint_of_another_grid_is_refused(ran):
    known, folder = ran
    shot = featherfx.read_shot(folder / "feather_pull/shot.toml")
    with pytest.raises(InputError, match="start: is of other feathers or another quality"):
        featherfx.simulate(shot, start=known["half"])


@pytest.mark.slow
def test_the_notebook_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    copy_sample("feather_pull", tmp_path / "feather_pull")
    monkeypatch.chdir(tmp_path)
    cells = json.loads((ROOT / "docs/notebook.ipynb").read_text(encoding="utf-8"))["cells"]
    assert all(each["outputs"] == [] for each in cells if each["cell_type"] == "code")
    known = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "docs/notebook.ipynb", "exec"), known)
    assert len(capsys.readouterr().out.splitlines()) == 24
    # the wind from below lifts the softer one higher
    assert known["after"][-1] > known["before"][-1] + 1.0


@pytest.mark.nightly
def test_the_site_builds_without_warnings(tmp_path):
    missing = [name for name in ("mkdocs", "mkdocstrings") if not importlib.util.find_spec(name)]
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed (extra docs)")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", tmp_path / "site"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    page = (tmp_path / "site/api/index.html").read_text(encoding="utf-8")
    assert "featherfx.api.simulate" in page
    assert (tmp_path / "site/search/search_index.json").is_file()
