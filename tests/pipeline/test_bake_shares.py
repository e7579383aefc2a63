"""Work for several machines: shares of the feathers, the plan that lists them, progress lines."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from commands import invoke
from places import SAMPLES
from pxr import Sdf, Usd, UsdGeom

import featherfx
from featherfx.baking import pipeline
from featherfx.errors import InputError
from featherfx.shot.contact.partition import share_numbers

WING = SAMPLES / "swan_wing/shot.toml"
OPTIONS = {"frames": (1, 3), "chunk": 2}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "wing.usda"
    featherfx.bake(WING, path, **OPTIONS)
    return path


def poses(path: Path) -> dict[str, list[np.ndarray]]:
    """Points at frames and between them, by prim."""
    stage = Usd.Stage.Open(str(path))
    found = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointBased):
            points = UsdGeom.PointBased(prim).GetPointsAttr()
            found[str(prim.GetPath())] = [np.array(points.Get(c)) for c in (1, 2, 2.5, 3)]
    return found


def test_shares_baked_at_once_make_up_the_whole(tmp_path, whole):
    path = tmp_path / "wing.usda"
    command = [sys.executable, "-m", "featherfx", "bake", str(WING), "-o", str(path)]
    command += ["--frames", "1-3", "--chunk", "2", "--layout", "clips", "--feathers", "1/2"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as other:
        featherfx.bake(WING, path, feathers=(2, 2), layout="clips", **OPTIONS)
    assert other.returncode == 0
    assert not path.exists()
    assert pipeline.join(path, 2) == 20
    found, expected = poses(path), poses(whole)
    assert found.keys() == expected.keys()
    for prim, values in expected.items():
        for one, other in zip(values, found[prim], strict=True):
            np.testing.assert_array_equal(one, other)
    assert pipeline.check(path) == []
    stage, one = Usd.Stage.Open(str(path)), Usd.Stage.Open(str(whole))
    hints = [s.GetDefaultPrim().GetAttribute("extentsHint").Get() for s in (stage, one)]
    np.testing.assert_array_equal(*hints)
    assert Usd.ModelAPI(stage.GetDefaultPrim()).GetKind() == "component"


def test_shares_of_followers_take_their_guides_along(tmp_path):
    shot = tmp_path / "shot.toml"
    text = WING.read_text().replace('"groom.toml"', f'"{WING.with_name("groom.toml")}"')
    shot.write_text(text + "\n[[detail]]\nlevel = 'guided'\nevery = 4\n")
    featherfx.bake(shot, tmp_path / "wing.usda", layout="clips", **OPTIONS)
    shared = tmp_path / "shared" / "wing.usda"
    shared.parent.mkdir()
    for k in (1, 2, 3):
        featherfx.bake(shot, shared, feathers=(k, 3), layout="clips", **OPTIONS)
    assert pipeline.join(shared, 3) == 20
    found, expected = poses(shared), poses(tmp_path / "wing.usda")
    assert found.keys() == expected.keys()
    for prim, values in expected.items():
        for one, other in zip(values, found[prim], strict=True):
            np.testing.assert_array_equal(one, other)


def test_shares_of_other_settings_or_missing_ones_are_not_joined(tmp_path):
    path = tmp_path / "wing.usda"
    featherfx.bake(WING, path, feathers=(1, 3), **OPTIONS)
    featherfx.bake(WING, path, feathers=(2, 3), up_axis="Y", **OPTIONS)
    with pytest.raises(InputError, match=r"3of3\.usda: is missing"):
        pipeline.join(path, 3)
    featherfx.bake(WING, path, feathers=(3, 3), **OPTIONS)
    with pytest.raises(InputError, match=r'2of3\.usda: up_axis: was "Y", but "Z"'):
        pipeline.join(path, 3)
    assert not path.exists()


def test_a_share_that_holds_nothing_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"21/21 is no share\. Give I/N, I from 1"):
        featherfx.bake(WING, tmp_path / "wing.usda", feathers=(21, 21), **OPTIONS)
    assert list(tmp_path.iterdir()) == []


def test_the_items_of_a_plan_do_what_the_bake_does(tmp_path, whole):
    path = tmp_path / "wing.usda"
    result = invoke(
        "bake",
        WING,
        "-o",
        path,
        "--frames",
        "1-3",
        "--chunk",
        "2",
        "--layout",
        "payload",
        "--plan",
        2,
    )
    assert result.exit_code == 0, result.stderr
    items = json.loads((tmp_path / "wing.plan.json").read_text())["items"]
    assert [item["name"] for item in items] == ["bake_1", "bake_2", "join"]
    assert items[2]["after"] == ["bake_1", "bake_2"]
    for item in items:
        assert item["command"][0] == "featherfx"
        result = invoke(*item["command"][1:])
        assert result.exit_code == 0, result.stderr
    for prim, values in poses(whole).items():
        np.testing.assert_array_equal(values, poses(path)[prim])


def test_a_plan_takes_presets_along(tmp_path, monkeypatch):
    """Workers find the presets that the plan was made with, and none of their own."""
    given, own, home, worker = (tmp_path / name for name in ("given", "own", "home", "worker"))
    for folder, gust in (
        (given, 0.1),
        (own, 0.2),
        (home / "featherfx/presets", 0.3),
        (worker, 0.4),
    ):
        (folder / "wind").mkdir(parents=True)
        (folder / "wind/mine.toml").write_text(f'base = "breeze"\ngust = {gust}\n')
    (worker / "wind/breeze.toml").write_text('base = "breeze"\nspeed = 33.0\n')
    monkeypatch.setenv("FEATHERFX_PRESETS", str(own))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    shot, path = tmp_path / "shot.toml", tmp_path / "pull.usda"
    groom = (SAMPLES / "feather_pull/groom.toml").as_posix()
    shot.write_text(f'name = "pull"\ngroom = "{groom}"\nframes = [1, 4]\nwind = "mine"\n')
    result = invoke("bake", shot, "-o", path, "--presets", given, "--frames", "1-1", "--plan", 1)
    assert result.exit_code == 0, result.stderr
    template = json.loads((tmp_path / "pull.openjd.json").read_text())
    folders = template["parameterDefinitions"][2:-2]
    assert [each["default"] for each in folders] == ["given", "own", "home/featherfx/presets"]
    assert {(each["type"], each["objectType"]) for each in folders} == {("PATH", "DIRECTORY")}
    arguments = template["steps"][0]["script"]["actions"]["onRun"]["args"]
    named = [arguments[k + 1] for k, each in enumerate(arguments) if each == "--presets"]
    assert named == [*(f"{{{{Param.Presets{k}}}}}" for k in (1, 2, 3)), "shipped"]
    # a worker of other presets, and none of the planner's
    monkeypatch.setenv("FEATHERFX_PRESETS", str(worker))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    item = json.loads((tmp_path / "pull.plan.json").read_text())["items"][0]
    result = invoke(*item["command"][1:])
    assert result.exit_code == 0, result.stderr
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "pull.1of1.usda"))
    settings = layer.customLayerData["featherfx"]["settings"]
    assert settings["shot.wind.gust"] == "0.1"
    assert float(settings["shot.wind.speed"]) < 33.0


def test_a_plan_takes_the_search_path_of_usd_along(tmp_path, monkeypatch):
    """Items have it as it is here, the template as parameters, which a farm maps to its own."""
    folders, variable = [tmp_path / "assets", Path("/shared/assets")], "PXR_AR_DEFAULT_SEARCH_PATH"
    pipeline.plan(WING, tmp_path / "bare.usda", 2)
    assert "environment" not in json.loads((tmp_path / "bare.plan.json").read_text())
    monkeypatch.setenv(variable, os.pathsep.join(map(str, folders)))
    pipeline.plan(WING, tmp_path / "wing.usda", 2)
    items = json.loads((tmp_path / "wing.plan.json").read_text())
    assert items["environment"] == {variable: os.pathsep.join(map(str, folders))}
    template = json.loads((tmp_path / "wing.openjd.json").read_text())
    first, second = template["parameterDefinitions"][2:4]
    assert (first["name"], first["type"], first["default"]) == ("Search1", "PATH", "assets")
    assert second["name"] == "Search2"
    assert "default" not in second
    _, search = template["jobEnvironments"]
    joined = os.pathsep.join(["{{Param.Search1}}", "{{Param.Search2}}"])
    assert search["variables"] == {variable: joined}


def test_the_template_is_an_open_job_description(tmp_path):
    """Required keys, names, references and ranges of jobtemplate-2023-09."""
    path = tmp_path / "wing.usda"
    pipeline.plan(WING, path, 4, ["--subframes", "2"])
    with pytest.raises(InputError, match="exists already"):
        pipeline.plan(WING, path, 4)
    template = json.loads((tmp_path / "wing.openjd.json").read_text())
    names = {"specificationVersion", "name", "parameterDefinitions", "jobEnvironments", "steps"}
    assert template.keys() == names
    assert template["specificationVersion"] == "jobtemplate-2023-09"
    assert 0 < len(template["name"]) <= 128
    defined = {"Param." + each["name"] for each in template["parameterDefinitions"]}
    shot, output, shares, packages = template["parameterDefinitions"]
    assert packages == {"name": "Packages", "type": "STRING", "default": ""}
    assert {shot["type"], output["type"]} == {"PATH"}
    # a default has to lie below the template's folder
    assert output["default"] == "wing.usda"
    assert "default" not in shot
    assert shares["minValue"] <= shares["default"] == 4 <= shares["maxValue"] == 20
    names = [step["name"] for step in template["steps"]]
    assert len(set(names)) == len(names) == 2
    for number, step in enumerate(template["steps"]):
        assert all(each["dependsOn"] in names[:number] for each in step.get("dependencies", []))
        parameters = step.get("parameterSpace", {}).get("taskParameterDefinitions", [])
        known = defined | {"Task.Param." + each["name"] for each in parameters}
        action = step["script"]["actions"]["onRun"]
        texts = [action["command"], *action["args"], *(each["range"] for each in parameters)]
        used = [name for text in texts for name in re.findall(r"{{(.*?)}}", text)]
        assert set(used) <= known
        assert all(isinstance(text, str) and text for text in texts)
        assert action["timeout"] == (86_400, 3_600)[number]
    assert template["steps"][0]["script"]["actions"]["onRun"]["args"][-2:] == ["--subframes", "2"]


@pytest.mark.nightly
def test_a_job_installs_the_packages_that_it_names_and_none_where_it_names_none(tmp_path):
    """The script of the template's environment, with a wheel that has nothing but a command."""
    pipeline.plan(WING, tmp_path / "wing.usda", 2)
    template = json.loads((tmp_path / "wing.openjd.json").read_text())
    (environment,) = template["jobEnvironments"]
    (file,) = environment["script"]["embeddedFiles"]
    action = environment["script"]["actions"]["onEnter"]
    arguments = ["{{Env.File.Install}}", "{{Param.Packages}}", "{{Session.WorkingDirectory}}"]
    assert action["args"] == arguments
    assert action["timeout"] > 0
    script, wheel = tmp_path / file["filename"], tmp_path / "told-1.0-py3-none-any.whl"
    script.write_text(file["data"])
    with ZipFile(wheel, "w") as archive:
        archive.writestr("told.py", "def main():\n    print('told')\n")
        about = "told-1.0.dist-info"
        archive.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: told\nVersion: 1.0\n")
        archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        archive.writestr(f"{about}/entry_points.txt", "[console_scripts]\ntold = told:main\n")
        archive.writestr(f"{about}/RECORD", "")

    def run(packages: str) -> str:
        command = [sys.executable, script, packages, tmp_path / "session"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return done.stdout

    assert run("") == ""
    assert not (tmp_path / "session").exists()
    path = run(f"--no-index '{wheel}'").splitlines()[-1].removeprefix("openjd_env: PATH=")
    found = shutil.which("told", path=path)
    assert found is not None
    assert Path(found).is_relative_to(tmp_path / "session")
    assert subprocess.run([found], capture_output=True, text=True).stdout == "told\n"


def test_progress_lines_are_json(tmp_path):
    result = invoke(
        *("bake", SAMPLES / "feather_pull/shot.toml", "-o", tmp_path / "a.usdc"),
        *("--frames", "1-2", "--subframes", 2, "--progress", "json"),
    )
    assert result.exit_code == 0, result.stderr
    lines = [json.loads(line) for line in result.stderr.splitlines() if line.startswith("{")]
    frames = [line for line in lines if line["progress"] == "frames"]
    assert [(line["done"], line["total"]) for line in frames] == [(0, 3), (1, 3), (2, 3), (3, 3)]
    phases = list(dict.fromkeys(line["phase"] for line in lines if line["phase"] != "compiling"))
    # roots that move at the first frame are led into their motion
    told = ["reading", "building", "simulating", "settling", "writing", "finishing", "judging"]
    assert [name for name in phases if name != "preroll"] == told
    for before, line in pairwise(lines):
        assert before["seconds"] <= line["seconds"]
        assert 0 <= line["done"] <= line["total"]
        assert line["left"] is None or line["left"] >= 0.0


def test_frames_before_those_that_are_wanted_are_told(tmp_path):
    shot = SAMPLES / "feather_pull/shot.toml"
    wanted = ("--frames", "5-6", "--progress", "json")
    result = invoke("bake", shot, "-o", tmp_path / "a.usdc", *wanted)
    assert result.exit_code == 0, result.stderr
    lines = [json.loads(line) for line in result.stderr.splitlines() if line.startswith("{")]
    earlier = [line for line in lines if line["progress"] == "earlier"]
    assert {line["total"] for line in earlier} == {4}
    assert earlier[-1]["done"] == 4
    frames = [line["done"] for line in lines if line["progress"] == "frames"]
    assert frames == [0, 1, 2]


def test_followers_are_cut_so_that_few_guides_are_simulated_twice(tmp_path):
    shot = tmp_path / "shot.toml"
    text = WING.read_text().replace('"groom.toml"', f'"{WING.with_name("groom.toml")}"')
    shot.write_text(text + "\n[[detail]]\nlevel = 'guided'\nevery = 4\n")
    read = featherfx.read_shot(shot)
    shares = [share_numbers(read, k, 2) for k in (1, 2)]
    assert sorted(np.concatenate(shares)) == list(range(20))
    assert abs(len(shares[0]) - len(shares[1])) <= 2
    # a wing each, but for a feather; dealt out in turn, each would need the guides of both wings
    for share, other in zip(shares, ("left_", "right_"), strict=True):
        ids = [read.groom.feathers[k].id for k in share]
        assert sum(each.startswith(other) for each in ids) <= 1
    for count in (3, 7, 20):
        found = [share_numbers(read, k, count) for k in range(1, count + 1)]
        assert sorted(np.concatenate(found)) == list(range(20))
        assert min(map(len, found)) >= 1


def test_progress_lines_are_those_of_open_job_description(tmp_path):
    shot = SAMPLES / "feather_pull/shot.toml"
    given = ("bake", shot, "-o", tmp_path / "a.usdc", "--frames", "1-2", "--progress", "openjd")
    lines = invoke(*given).stdout.splitlines()
    told = [line.split(": ") for line in lines]
    assert [value for name, value in told if name == "openjd_progress"] == ["0.0", "50.0", "100.0"]
    phases = [value for name, value in told if name == "openjd_status"]
    assert [each for each in phases if each in ("reading", "finishing")] == ["reading", "finishing"]
    result = invoke(*given)
    assert result.exit_code == 1
    *others, fail = result.stdout.splitlines()
    assert fail.startswith("openjd_fail: ")
    assert fail.endswith("exists already. Choose another name or --overwrite")
    parsed = as_a_session_reads_it([*lines, *others, fail])
    whole = [f"openjd_{name.lower()}: {value}" for name, value in parsed]
    assert whole == [*lines, *others, fail]


def as_a_session_reads_it(lines: list[str]) -> list[tuple[str, Any]]:
    """Kinds and values of lines, by the package that runs such jobs."""
    name = "openjd.sessions._action_filter"
    sessions = pytest.importorskip(name, reason="no openjd-sessions")
    found: list[tuple[str, Any]] = []
    listener = sessions.ActionMonitoringFilter(
        session_id="one", callback=lambda kind, value, _: found.append((kind.name, value))
    )
    for line in lines:
        record = logging.makeLogRecord({"msg": line, "session_id": "one"})
        listener.filter(record)
    return found


def test_a_template_may_have_a_task_bake_several_shares(tmp_path):
    path = tmp_path / "wing.usda"
    given = ("--frames", "1-1", "--quality", "draft", "--jobs", 2)
    tasks = ("--task-shares", 2, "--task-hours", 1.5)
    planned = invoke("bake", WING, "-o", path, *given, "--plan", 5, *tasks)
    assert planned.exit_code == 0, planned.stderr
    template = json.loads((tmp_path / "wing.openjd.json").read_text())
    assert template["extensions"] == ["TASK_CHUNKING"]
    step = template["steps"][0]
    assert step["hostRequirements"]["amounts"] == [{"name": "amount.worker.vcpu", "min": 2}]
    (share,) = step["parameterSpace"]["taskParameterDefinitions"]
    assert share["type"] == "CHUNK[INT]"
    assert step["script"]["actions"]["onRun"]["timeout"] == 5_400
    assert share["chunks"] == {"defaultTaskCount": 2, "rangeConstraint": "CONTIGUOUS"}
    # what a session makes of the last chunk but one
    names = {
        "{{Task.Param.Share}}": "3-4",
        "{{Param.Shares}}": "5",
        "{{Param.Shot}}": str(WING),
        "{{Param.Output}}": str(path),
    }
    arguments = step["script"]["actions"]["onRun"]["args"]
    for name, value in names.items():
        arguments = [each.replace(name, value) for each in arguments]
    assert not any("{{" in each for each in arguments)
    result = invoke(*arguments)
    assert result.exit_code == 0, result.stderr
    assert sorted(each.name for each in tmp_path.glob("wing.*of5.usda")) == [
        "wing.3of5.usda",
        "wing.4of5.usda",
    ]


def test_the_reference_implementation_takes_both_templates(tmp_path, monkeypatch):
    """Where its package openjd-model is installed."""
    model = pytest.importorskip("openjd.model")
    monkeypatch.setenv("PXR_AR_DEFAULT_SEARCH_PATH", str(tmp_path / "assets"))
    for number, more in enumerate(({}, {"task_shares": 2})):
        path = tmp_path / f"wing{number}.usda"
        pipeline.plan(WING, path, 4, ["--jobs", "2"], **more)
        template = json.loads(path.with_suffix(".openjd.json").read_text())
        model.decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
        if more:
            with pytest.raises(model.DecodeValidationError):
                model.decode_job_template(template=template, supported_extensions=[])


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--task-shares", "2"), "--task-shares and --task-hours go with --plan"),
        (("--task-hours", "2"), "--task-shares and --task-hours go with --plan"),
        (("--feathers", "1-2/4", "--report", "r.json"), "several --feathers write no --report"),
        (("--feathers", "3-2/4"), "is not a share such as"),
        (("--feathers", "1-5/4"), "is not a share such as"),
        (("--feathers", "1/2", "--feathers", "2/2"), "--feathers is given 2 times. Give one I/N"),
        (("--frames", "1-2", "--frames", "5-6"), "--frames is given 2 times. Give one A-B"),
    ],
)
def test_several_shares_that_make_no_sense_are_wrong_usage(more, told):
    result = invoke("bake", WING, *more)
    assert result.exit_code == 2
    assert told in result.stderr
