"""The registry of packages: its names exist, and a shot imports only what it asks for."""

import subprocess
import sys
from dataclasses import replace
from operator import attrgetter

import pytest
from places import SAMPLES

from featherfx.packages import MOTION_SOURCES, PACKAGES, brought, is_asked, load_name
from featherfx.shot.loop.run import ShotLoad, Stage
from featherfx.shot.patterns import Shelter
from featherfx.shot.read.read import read_shot

SAMPLE = SAMPLES / "feather_pull" / "shot.toml"


@pytest.fixture(scope="module")
def shot():
    """One feather that a grip pulls."""
    return read_shot(SAMPLE)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda each: each.name)
def test_names_and_tables_of_a_package_exist(package, shot):
    assert all(issubclass(load_name(name), Stage) for name in package.stages)
    assert all(issubclass(load_name(name), ShotLoad) for name in package.loads)
    rest = set(package._fields) - {"name", "offers", "tables", "stages", "loads"}
    assert all(callable(load_name(name)) for what in rest for name in getattr(package, what))
    for table in package.tables:
        attrgetter(table)(shot)


def test_motions_exist():
    assert all(callable(load_name(name)) for name in MOTION_SOURCES.values())


def test_a_table_asks_for_its_package(shot):
    asked = [each.name for each in PACKAGES if is_asked(each, shot)]
    assert asked == ["core", "grips"]
    sheltered = replace(shot, shelters=(Shelter(share=0.5),))
    asked = [each.name for each in PACKAGES if is_asked(each, sheltered)]
    assert asked == ["core", "grips", "shelter"]
    assert len(brought(sheltered, "loads")) == len(brought(shot, "loads")) + 1


def test_a_lone_feather_loads_no_package_that_it_does_not_ask_for():
    code = (
        "import sys; from featherfx.shot.read.read import read_shot;"
        " from featherfx.shot.loop.simulate import simulate; from pathlib import Path;"
        f" simulate(read_shot(Path({str(SAMPLE)!r})));"
        " print(sorted({m.split('.')[2] for m in sys.modules if m.startswith('featherfx.shot.')}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for package in ("coat", "contact", "direction", "hooks", "partition"):
        assert f"'{package}'" not in done.stdout
