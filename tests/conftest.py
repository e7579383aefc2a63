"""Puts this folder on the import path, for the helpers that several packages' tests share, and has
compiled once, by all cores, what every process of a run would else compile for itself."""

import gc
import os
import subprocess
import sys

import pytest

# all that steps and contact need
STEPS = """
import tempfile
from pathlib import Path
from featherfx import bake
with tempfile.TemporaryDirectory() as folder:
    shot, output = Path("samples/flapping_bird/shot.toml"), Path(folder) / "bird.usdc"
    bake(shot, output, frames=(1, 2), quality="draft")
"""
# rooms whose tests call kernels that no other does: compiled by one process, not by several at once
ALONE = frozenset({"mechanics", "nodal", "render", "solver"})

# tests that run each night: the lab and its reference model, images, browsers, foreign and damaged
# files, clusters
NIGHTLY = frozenset({"lab", "nodal", "render"}) | frozenset(
    f"{each}.py"
    for each in (
        *("view/test_view_page", "view/test_view_live"),
        *("usdin/test_usd_broken_files", "usdin/test_usd_odd_values"),
        *("usdin/test_usd_groom_faults", "farm/test_cluster"),
        *("plugins/test_houdini_nodes", "contact/test_contact_stress"),
    )
)

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("FEATHERFX_COMPILERS", "1")


def pytest_collection_modifyitems(items):
    for item in items:
        folder, file = item.path.parts[-2:]
        if folder in NIGHTLY or f"{folder}/{file}" in NIGHTLY:
            item.add_marker(pytest.mark.nightly)


def pytest_xdist_setupnodes(config, specs):
    subprocess.run([sys.executable, "-c", STEPS], cwd=config.rootpath, check=True)


def pytest_xdist_make_scheduler(config, log):
    from xdist.scheduler import LoadFileScheduling

    class Rooms(LoadFileScheduling):
        def _split_scope(self, nodeid):
            room = nodeid.split("/")[1]
            return room if room in ALONE else super()._split_scope(nodeid)

    return Rooms(config, log)


def pytest_collection_finish(session):
    # what is imported by now stays: a twentieth of the tests' time went to looking through it
    gc.collect()
    gc.freeze()
