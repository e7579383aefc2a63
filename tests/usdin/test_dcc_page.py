"""The scripts of docs/dcc.md, run against stand-ins for the hosts, and what they rely on."""

import re
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from places import ROOT
from pxr import Usd, UsdGeom

import featherfx

PAGE = (ROOT / "docs/dcc.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.S)
HOSTS = ("hou", "maya", "bpy", "featherfx")


def blocks_of(host):
    return [block for block in BLOCKS if re.search(rf"^(import|from) {host}\b", block, re.M)]


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    path = tmp_path_factory.mktemp("dcc") / "wing.usdc"
    featherfx.bake(ROOT / "samples/swan_wing/shot.toml", path, frames=(1, 2), up_axis="Y")
    return path


def run(monkeypatch, block, cache, **modules):
    """Run a script with stand-ins as modules; returns its names."""
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    text = block.replace("/show/cache/wing.usdc", str(cache))
    names: dict[str, object] = {}
    exec(compile(text, "dcc.md", "exec"), names)
    return names


def test_every_script_belongs_to_a_host():
    assert sum(len(blocks_of(host)) for host in HOSTS) == len(BLOCKS) >= 6
    assert all(blocks_of(host) for host in HOSTS)


def test_the_bake_runs_as_written(monkeypatch, tmp_path, capsys):
    (block,) = blocks_of("featherfx")
    shot = ROOT / "samples/feather_pull/shot.toml"
    run(monkeypatch, block.replace("/show/shot.toml", str(shot)), tmp_path / "wing.usdc")
    assert capsys.readouterr().out == "1 feathers, 25 frames\n"
    run(monkeypatch, block.replace("/show/shot.toml", str(tmp_path / "none.toml")), tmp_path / "w")
    assert "there is no such file" in capsys.readouterr().out


def test_houdini_finds_meshes_rest_and_pieces(monkeypatch, cache):
    """The primitive pattern fits the feathers' paths; rest and featherId are there to be used."""
    stage = Usd.Stage.Open(str(cache))
    for block in blocks_of("hou"):
        hou = MagicMock()
        hou.node().createNode().createNode().inputLabels.return_value = (
            "Feathers", "Rest Geometry", "Animated Geometry"
        )  # fmt: skip
        run(monkeypatch, block, cache, hou=hou)
    (block,) = (each for each in blocks_of("hou") if "featherdeform" in each)
    (pattern,) = re.findall(r'parm\("primpattern"\)\.set\("(.*?)"\)', block)
    wanted = re.compile(pattern.replace("*", "[^/]+") + "$")
    chosen = [prim for prim in stage.Traverse() if wanted.match(str(prim.GetPath()))]
    assert len(chosen) == 20
    ids = set()
    for prim in chosen:
        mesh, primvars = UsdGeom.Mesh(prim), UsdGeom.PrimvarsAPI(prim)
        rest = primvars.GetPrimvar("rest").Get()
        assert len(rest) == len(mesh.GetPointsAttr().Get(2))
        ids |= set(primvars.GetPrimvar("featherId").Get())
    assert len(ids) == 20


def test_maya_is_given_options_of_its_import(monkeypatch, cache):
    cmds = MagicMock()
    for block in blocks_of("maya"):
        run(monkeypatch, block, cache, maya=SimpleNamespace(cmds=cmds))
    assert cmds.loadPlugin.call_count == 2
    assert cmds.mayaUSDImport.call_args.kwargs["file"] == str(cache)
    cmds.setAttr.assert_called_once()


def test_blender_finds_the_feathers_by_their_names(monkeypatch, cache, capsys):
    stage = Usd.Stage.Open(str(cache))
    prims = [SimpleNamespace(name=prim.GetName()) for prim in stage.Traverse()]
    scene = SimpleNamespace(objects=prims, frame_start=1, frame_end=2)
    bpy = MagicMock(context=SimpleNamespace(scene=scene))
    (block,) = blocks_of("bpy")
    run(monkeypatch, block, cache, bpy=bpy)
    assert bpy.ops.wm.usd_import.call_args.kwargs["filepath"] == str(cache)
    primaries = [each for each in prims if each.name.startswith("primary")]
    assert capsys.readouterr().out.startswith(f"{len(primaries)} feathers")
