"""A host's own USD: featherfx takes what is there, and says what it cannot take."""

from __future__ import annotations

import mmap
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pxr
import pytest
from places import ROOT, SAMPLES

import featherfx
from featherfx.errors import InputError
from featherfx.usd import types
from featherfx.usd.read.values import open_stage

WRITE = """
import importlib.metadata, sys
sys.path[:0] = sys.argv[1:4]
names = {each.name for each in importlib.metadata.distributions()}
assert "numba" in names and "usd-core" not in names, names
import featherfx
assert "pxr" not in sys.modules
assert featherfx.export_groom(sys.argv[4], sys.argv[5], quality="draft") == 1
assert featherfx.check(sys.argv[5]) == []
import pxr
print(pxr.__file__)
"""


@pytest.fixture(autouse=True)
def asked_anew():
    types.refuse_unfit_usd.cache_clear()
    yield
    types.refuse_unfit_usd.cache_clear()


def test_a_python_with_the_pxr_of_a_host_and_without_usd_core_is_enough(tmp_path):
    packages = Path(pxr.__file__).parents[1]
    for each in packages.iterdir():
        folder = "host" if each.name == "pxr" or each.name.endswith(".libs") else "packages"
        (tmp_path / folder).mkdir(exist_ok=True)
        if not each.name.startswith("usd_core-"):
            (tmp_path / folder / each.name).symlink_to(each)
    # a stage's plugins and libraries are found from where the host's pxr is
    groom, output = SAMPLES / "feather_pull/groom.toml", tmp_path / "out.usda"
    paths = [ROOT, tmp_path / "packages", tmp_path / "host", groom, output]
    run = subprocess.run(
        [sys.executable, "-I", "-S", "-c", WRITE, *map(str, paths)],
        capture_output=True,
        text=True,
        env=dict(os.environ),
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == str(tmp_path / "host/pxr/__init__.py")


def test_the_page_names_everything_that_is_needed_but_usd():
    page = (ROOT / "docs/dcc.md").read_text()
    told = re.search(r"pip install (\"click.*)", page)[1]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = [each for each in project["dependencies"] if not each.startswith("usd-core")]
    assert re.findall(r"\"(.*?)\"", told) == needed


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="only Linux tells")
def test_two_libraries_of_usd_in_one_process_are_told(tmp_path, caches):
    assert len(types.loaded_libraries()) == 1
    open_stage(caches["usda"])
    types.refuse_unfit_usd.cache_clear()
    second = tmp_path / "libpxr_tf.so"
    second.write_bytes(bytes(mmap.PAGESIZE))
    with (
        second.open("r+b") as file,
        mmap.mmap(file.fileno(), 0),
        pytest.raises(InputError, match=r"two installs of USD in one process"),
    ):
        open_stage(caches["usda"])
    open_stage(caches["usda"])


def test_an_old_usd_is_told(monkeypatch, caches):
    from pxr import Usd

    monkeypatch.setattr(Usd, "GetVersion", lambda: (0, 23, 11))
    told = r"is USD 23\.11, but 24\.3 is the oldest"
    with pytest.raises(InputError, match=told):
        open_stage(caches["usda"])
    # before anything of a shot is read, which takes none of USD
    with pytest.raises(InputError, match=told):
        featherfx.bake("none.toml")


def test_a_missing_usd_is_one_message():
    lines = "import sys; sys.modules['pxr'] = None; from featherfx.cli.main import main; main()"
    run = subprocess.run(
        [sys.executable, "-c", lines, "inspect", str(SAMPLES / "pigeon/body.usdc")],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    told = "featherfx: USD is not installed: pip install usd-core, or use a host's\n"
    assert (run.returncode, run.stderr) == (1, told)
