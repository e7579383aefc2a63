"""What is installed works by itself: wheel and sdist, samples, doctor, logs, completion."""

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
from commands import invoke
from places import ROOT

from featherfx._version import __version__
from featherfx.baking import install
from featherfx.baking.install import copy_sample, sample_names
from featherfx.errors import InputError

LOG_LINE = re.compile(r"\d{4}-\d\d-\d\d [\d:,]{12} \[\d+\] (INFO|WARNING|ERROR) ")


def files_below(folder):
    return {
        each.relative_to(folder).as_posix(): each.read_bytes()
        for each in folder.rglob("*")
        if each.is_file() and "__pycache__" not in each.parts
    }


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist of the checkout."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", folder],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    return folder


def test_an_unpacked_wheel_has_all_that_it_needs(built, tmp_path):
    (wheel,) = built.glob("*.whl")
    inside = tmp_path / "site"
    with zipfile.ZipFile(wheel) as file:
        file.extractall(inside)
    assert files_below(inside / "featherfx/_presets") == files_below(ROOT / "presets")
    plugins = files_below(inside / "featherfx/plugins")
    assert plugins == files_below(ROOT / "featherfx/plugins")
    assert len(plugins) > 5
    # without it type checkers pass over the annotations of what is installed
    assert (inside / "featherfx/py.typed").is_file()
    code = "from featherfx.cli.main import main\n"
    for command in ("sample pigeon -o bird", "sample breeze", "check breeze/shot.toml"):
        code += f"assert main({command.split()}, standalone_mode=False) in (None, 0)\n"
    environment = {**os.environ, "PYTHONPATH": str(inside)}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    assert files_below(tmp_path / "bird") == files_below(ROOT / "samples/pigeon")
    (licence,) = inside.glob("*.dist-info/licenses/LICENSE")
    assert licence.read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_an_sdist_builds_and_tests_itself(built):
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    wanted = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"}
    wanted |= {"samples/swan_wing/shot.toml", "tests/test_architecture.py", "docs/usd.md"}
    assert wanted <= names


def test_the_citation_and_the_changelog_are_of_this_version():
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_a_sample_is_copied_into_a_new_or_empty_folder(tmp_path):
    (tmp_path / "empty").mkdir()
    for name, folder in (("breeze", "empty"), ("breeze", "new/one")):
        result = invoke("sample", name, "-o", tmp_path / folder)
        assert result.exit_code == 0, result.stderr
        assert result.stdout.split() == [
            str(tmp_path / folder / file) for file in ("groom.toml", "shot.toml")
        ]
        assert files_below(tmp_path / folder) == files_below(ROOT / "samples/breeze")
    assert not list(tmp_path.rglob(".*"))


def test_a_folder_that_holds_something_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    for place in (tmp_path, tmp_path / "mine.txt"):
        result = invoke("sample", "breeze", "-o", place)
        assert result.exit_code == 1
        assert result.stderr.startswith(f"featherfx: {place}: is ")
    assert [each.name for each in tmp_path.iterdir()] == ["mine.txt"]


def test_a_sample_that_there_is_not_is_told_with_those_there_are(tmp_path):
    assert invoke("sample", "swan").exit_code == 2
    with pytest.raises(InputError, match=f"'swan' is not one of {sample_names()[0]}"):
        copy_sample("swan", tmp_path / "swan")
    assert not (tmp_path / "swan").exists()


def test_the_doctor_bakes_and_reads_back():
    result = invoke("doctor", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["version"] == __version__
    assert found["self_test"]["ok"]
    assert found["problems"] == []
    assert set(found["samples"]) == {each.name for each in (ROOT / "samples").iterdir()}
    if found["packages"] is not None:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        assert set(found["extras"]) <= set(project["optional-dependencies"])
    text = invoke("doctor", "--no-test").stdout
    assert f"featherfx {__version__}" in text
    assert "self-test" not in text


def test_the_doctor_tells_what_is_missing_too_old_and_unusable(tmp_path, monkeypatch):
    wanted = ["numpy>=999", "nowhere-to-be-had>=1", 'click>=8; extra == "more"', "usd-core>=24"]
    monkeypatch.setattr(install.importlib.metadata, "requires", lambda name: wanted)
    monkeypatch.setattr(
        install.importlib.metadata, "metadata", lambda name: MetadataOf(["more", "less"])
    )
    monkeypatch.setattr(install, "shipped", lambda name: tmp_path)
    result = invoke("doctor", "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 1
    assert any(each.startswith("numpy: is ") for each in found["problems"])
    assert "nowhere-to-be-had: is not installed, nowhere-to-be-had>=1 is needed" in result.stderr
    assert found["extras"]["more"] == {"installed": True, "missing": []}
    assert f"{tmp_path}: holds no presets" in result.stderr
    assert found["self_test"] is None


class MetadataOf:
    def __init__(self, extras):
        self.extras = extras

    def get_all(self, key):
        assert key == "Provides-Extra"
        return self.extras


def test_a_log_has_command_warnings_errors_and_is_appended_to(tmp_path):
    log = tmp_path / "run.log"
    shot = tmp_path / "missing.toml"
    for _ in range(2):
        assert invoke("bake", shot, "--log", log).exit_code == 1
    lines = log.read_text().splitlines()
    assert sum(f"arguments: bake {shot} --log {log}" in line for line in lines) == 2
    assert sum(" ERROR featherfx: " in line and "missing.toml" in line for line in lines) == 2
    assert sum(line.endswith("INFO Traceback (most recent call last):") for line in lines) == 2
    assert all(LOG_LINE.match(line) for line in lines if "INFO ended after" in line)
    # wrong usage, too
    assert invoke("bake", "--log", log).exit_code == 2
    assert "Missing argument" in log.read_text()


@pytest.mark.parametrize("place", ["shot.toml", "folder", "none/run.log"])
def test_a_log_never_writes_into_something_else(tmp_path, place):
    (tmp_path / "shot.toml").write_text("name = 'mine'\n")
    (tmp_path / "folder").mkdir()
    result = invoke("presets", "list", "--log", tmp_path / place)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"featherfx: {tmp_path / place}: ")
    assert len(result.stderr.splitlines()) == 1
    assert (tmp_path / "shot.toml").read_text() == "name = 'mine'\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_names_this_program(shell):
    result = invoke("completion", shell)
    assert result.exit_code == 0
    assert f"_FEATHERFX_COMPLETE={shell}_complete" in result.stdout


def test_samples_are_completed():
    env = {
        **os.environ,
        "_FEATHERFX_COMPLETE": "bash_complete",
        "COMP_WORDS": "featherfx sample sw",
        "COMP_CWORD": "2",
    }
    program = "from featherfx.cli.main import main; main(prog_name='featherfx')"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=env, capture_output=True, text=True
    )
    assert done.stdout.split() == ["plain,swan_wing"]
