"""Puts this folder on the import path, for the helpers that several packages' tests share, and has
compiled once, by all cores, what every process of a run would else compile for itself."""

import os
import subprocess
import sys

STEPS = """
import tempfile
from pathlib import Path
from featherfx import bake
with tempfile.TemporaryDirectory() as folder:
    shot, output = Path("samples/swan_wing/shot.toml"), Path(folder) / "wing.usdc"
    bake(shot, output, frames=(1, 2), quality="draft")
"""

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("FEATHERFX_COMPILERS", "1")


def pytest_xdist_setupnodes(config, specs):
    subprocess.run([sys.executable, "-c", STEPS], cwd=config.rootpath, check=True)
