"""Plugins for hosts: how they are installed, and what they do, with stand-ins for the hosts."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
import types
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from commands import invoke
from places import ROOT

from featherfx._version import __version__
from featherfx.baking import install as plugins
from featherfx.usd.write.cache_writer import CacheWriter

SOURCE = ROOT / "featherfx" / "plugins"
CACHE = "/show/wing.usdc"

# what a bake tells, as it was recorded, then how it ends
BAKE = """#!{python}
import signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(1))
print("arguments:", *sys.argv[1:], file=sys.stderr)
for done in range(3):
    print('{{"progress": "frames", "phase": "simulating", "done": %d, "total": 2, "seconds": 1.5,'
          ' "left": 0.5}}' % done, file=sys.stderr, flush=True)
    time.sleep({pause})
print("featherfx: shot.toml: wind: 'x' is not a wind", file=sys.stderr)
print("printed")
sys.exit({code})
"""


@pytest.fixture
def host(monkeypatch):
    """The shared layer, imported as a host does."""
    monkeypatch.syspath_prepend(SOURCE / "shared")
    yield importlib.import_module("featherfx_host")
    sys.modules.pop("featherfx_host", None)


def stand_in(tmp_path, monkeypatch, code=0, pause=0.0):
    """A command that tells what a bake told."""
    file = tmp_path / "stand_in.py"
    file.write_text(BAKE.format(python=sys.executable, code=code, pause=pause))
    file.chmod(0o755)
    monkeypatch.setenv("FEATHERFX_COMMAND", str(file))


def below(folder):
    return sorted(each.relative_to(folder).as_posix() for each in folder.rglob("*"))


@pytest.mark.parametrize("name", plugins.HOSTS)
def test_a_plugin_is_installed_whole_once_and_replaced_if_asked(tmp_path, name):
    result = invoke("plugins", "install", name, "--into", tmp_path)
    assert result.exit_code == 0, result.stderr
    folder = Path(result.stdout.strip())
    assert folder == tmp_path / f"featherfx_{name}"
    assert (folder / "featherfx_host.py").is_file()
    assert json.loads((folder / "featherfx_command.json").read_text())[0] == sys.executable
    assert not [each for each in tmp_path.rglob("*") if each.name.startswith(".")]
    finder = plugins.HOSTS[name].finder
    if finder:
        text = (tmp_path / finder).read_text()
        assert folder.as_posix() in text
        assert "@" not in text
    first = below(tmp_path)
    again = invoke("plugins", "install", name, "--into", tmp_path)
    assert again.exit_code == 1
    assert f"is there already, version {__version__}" in again.stderr
    (folder / "stale.py").write_text("")
    assert invoke("plugins", "install", name, "--into", tmp_path, "--overwrite").exit_code == 0
    assert below(tmp_path) == first


def test_the_list_tells_where_plugins_go_and_which_are_there(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    for name in ("HOUDINI_USER_PREF_DIR", "MAYA_APP_DIR"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "houdini19.5").mkdir()
    (tmp_path / "houdini21.0").mkdir()
    (tmp_path / "houdini9.1").mkdir()
    known = {each["host"]: each for each in json.loads(invoke("plugins", "list", "--json").stdout)}
    assert set(known) == {"houdini", "maya", "usdview", "usdvalidation"}
    assert known["houdini"]["folder"] == str(tmp_path / "houdini21.0/packages")
    assert known["maya"]["folder"] is None
    refused = invoke("plugins", "install", "maya")
    assert refused.exit_code == 1
    assert (
        refused.stderr
        == "featherfx: plugins: maya: no folder of Maya was found. Name one with --into.\n"
    )
    assert invoke("plugins", "install", "houdini").exit_code == 0
    known = {each["host"]: each for each in json.loads(invoke("plugins", "list", "--json").stdout)}
    assert known["houdini"]["installed"] == __version__
    assert known["usdview"]["installed"] is None


def test_nothing_is_half_installed(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    refused = invoke("plugins", "install", "maya", "--into", tmp_path / "file")
    assert refused.exit_code == 1
    told = f"{tmp_path / 'file'}: cannot be written (File exists). Nothing was installed."
    assert refused.stderr == f"featherfx: {told}\n"
    # what others have stays
    (tmp_path / "others/featherfx_maya").mkdir(parents=True)
    assert (
        "none of featherfx"
        in invoke("plugins", "install", "maya", "--into", tmp_path / "others", "--overwrite").stderr
    )
    (tmp_path / "mod").mkdir()
    (tmp_path / "mod/featherfx.mod").write_text("mine")
    assert (
        "is not of this plugin"
        in invoke("plugins", "install", "maya", "--into", tmp_path / "mod").stderr
    )
    assert below(tmp_path / "mod") == ["featherfx.mod"]

    def full(path, text):
        raise OSError(28, "No space left on device", str(path))

    # the file that names the plugin cannot be written
    monkeypatch.setattr(plugins, "write_text", full)
    result = invoke("plugins", "install", "maya", "--into", tmp_path / "new")
    assert result.exit_code == 1
    assert f"{tmp_path / 'new'}: cannot be written (No space left on device)" in result.stderr
    assert below(tmp_path / "new") == []

    def full_disk(*_, **__):
        raise shutil.Error([("here", "there", "[Errno 28] No space left on device")])

    monkeypatch.setattr(plugins.shutil, "copytree", full_disk)
    result = invoke("plugins", "install", "usdview", "--into", tmp_path / "new")
    assert "cannot be written ([Errno 28] No space left on device)" in result.stderr
    assert below(tmp_path / "new") == []


def test_a_run_tells_progress_and_gives_what_was_printed(host, tmp_path, monkeypatch):
    stand_in(tmp_path, monkeypatch)
    run = host.bake("shot.toml", CACHE, "--quality", "draft")
    assert [host.share_done(told) for told in run] == [0.0, 0.5, 1.0]
    assert run.finish() == "printed\n"
    expected = f"arguments: bake shot.toml -o {CACHE} --resume --progress json --quality draft"
    assert run.messages[0] == expected


def test_a_run_that_fails_or_is_stopped_says_so(host, tmp_path, monkeypatch):
    stand_in(tmp_path, monkeypatch, code=1)
    with pytest.raises(host.HostError, match="'x' is not a wind"):
        host.bake("shot.toml", CACHE).finish()
    stand_in(tmp_path, monkeypatch, pause=20.0)
    run = host.bake("shot.toml", CACHE)
    next(iter(run))
    run.cancel()
    with pytest.raises(host.HostError, match="bake again to go on"):
        run.finish()
    monkeypatch.setenv("FEATHERFX_COMMAND", str(tmp_path / "none"))
    with pytest.raises(host.HostError, match="cannot be started"):
        host.bake("shot.toml", CACHE)


def test_the_real_command_answers_the_shared_layer(host, tmp_path, monkeypatch):
    monkeypatch.delenv("FEATHERFX_COMMAND", raising=False)
    target, _ = plugins.install("usdview", tmp_path)
    monkeypatch.setattr(host, "__file__", str(target / "featherfx_host.py"))
    monkeypatch.setattr(host, "_HOST_ONLY", ("PYTHONHOME",))  # the checkout is on the path here
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    told = host.report(ROOT / "samples/pigeon/body.usdc")
    assert {"mesh", "skeleton"} <= {each["kind"] for each in told["prims"]}
    with pytest.raises(host.HostError, match=r"no\.toml: there is no such file"):
        host.bake("no.toml", tmp_path / "no.usdc").finish()


def test_houdini_bakes_follows_and_loads(host, tmp_path, monkeypatch):
    stand_in(tmp_path, monkeypatch)
    hou = MagicMock()
    hou.OperationInterrupted = type("OperationInterrupted", (Exception,), {})
    hou.ui.selectFile.side_effect = ["$HIP/shot.toml", CACHE]
    hou.text.expandString.side_effect = lambda text: text
    module = hosted("houdini/scripts/python", "featherfx_houdini", {"hou": hou}, monkeypatch)
    assert module.bake_shot() == CACHE
    bar = hou.InterruptableOperation.return_value.__enter__.return_value
    assert [call.args[0] for call in bar.updateProgress.call_args_list] == [0.0, 0.5, 1.0]
    hou.node("/stage").createNode().parm().set.assert_called_with(CACHE)
    # an interrupt stops the bake, and loads nothing
    stand_in(tmp_path, monkeypatch, pause=5.0)
    hou.ui.selectFile.side_effect = ["shot.toml", CACHE]
    hou.node.reset_mock()
    bar.updateProgress.side_effect = hou.OperationInterrupted
    assert module.bake_shot() is None
    assert "bake again to go on" in hou.ui.displayMessage.call_args.args[0]
    hou.node.assert_not_called()


def test_maya_bakes_follows_and_loads(host, tmp_path, monkeypatch):
    stand_in(tmp_path, monkeypatch)
    cmds = MagicMock()
    cmds.fileDialog2.side_effect = [["shot.toml"], [CACHE]]
    cmds.upAxis.return_value = "y"
    cmds.progressWindow.return_value = False
    cmds.createNode.side_effect = lambda kind, name, **_: name
    maya = types.SimpleNamespace(cmds=cmds)
    modules = {"maya": maya, "maya.cmds": cmds}
    module = hosted("maya/scripts", "featherfx_maya", modules, monkeypatch)
    assert module.bake_shot() == "wingShape"
    cmds.setAttr.assert_called_with("wingShape.filePath", CACHE, type="string")
    told = [
        call.kwargs["progress"]
        for call in cmds.progressWindow.call_args_list
        if "progress" in call.kwargs
    ]
    assert told == [0, 50, 100]
    assert cmds.progressWindow.call_args.kwargs == {"endProgress": True}
    module.make_menu()
    labels = [call.kwargs["label"] for call in cmds.menuItem.call_args_list]
    assert labels == ["Bake shot...", "Load cache...", "Add to shelf"]


# in a process of its own: USD keeps what is registered
VIEWED = """
import sys, types
from unittest.mock import MagicMock
from pxr import Plug, Tf, Usd, UsdGeom, Vt, Sdf

sys.path[:0] = sys.argv[1:3]
plugin = types.ModuleType("pxr.Usdviewq.plugin")
class PluginContainer: pass
PluginContainer.__module__ = plugin.__name__
plugin.PluginContainer = PluginContainer
package = types.ModuleType("pxr.Usdviewq")
package.__path__ = []
sys.modules |= {"pxr.Usdviewq": package, "pxr.Usdviewq.plugin": plugin}
Tf.Type.Define(PluginContainer)
(known,) = Plug.Registry().RegisterPlugins(sys.argv[1])
known.Load()
made = Tf.Type.FindByName("featherfx_usdview.FeatherfxContainer").pythonClass()
registry, builder = MagicMock(), MagicMock()
made.registerPlugins(registry, None)
made.configureView(registry, builder)
menu = builder.findOrCreateMenu
menu.assert_called_with("featherfx")
assert menu.return_value.addItem.call_count == 4
commands = {call.args[0]: call.args[2] for call in registry.registerCommandPlugin.call_args_list}
stage = Usd.Stage.CreateInMemory()
mesh = UsdGeom.Mesh.Define(stage, "/m")
kind = Sdf.ValueTypeNames.Vector3fArray
UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("barbDirection", kind).Set([(1, 0, 0), (0, -1, 0)], 3)
api = types.SimpleNamespace(stage=stage, frame=3, UpdateGUI=lambda: None)
colour = lambda: UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor").Get()
commands["featherfx.directions"](api)
assert [tuple(each) for each in colour()] == [(1, 0.5, 0.5), (0.5, 0, 0.5)]
assert not stage.GetRootLayer().GetAttributeAtPath("/m.primvars:displayColor")
commands["featherfx.plain"](api)
assert colour() is None
"""

VALIDATED = """
import json, sys
from pxr import Plug, Usd, UsdGeom
try:
    from pxr import UsdValidation
    UsdValidation.ValidationRegistry.RegisterPluginStageValidator
except (ImportError, AttributeError):
    print("USD without validators in Python"); sys.exit()
sys.path.insert(0, sys.argv[1])
Plug.Registry().RegisterPlugins(sys.argv[1])
names = [f"featherfxValidators:{n}" for n in ("CacheStage", "CacheGeometry", "CacheInstances")]
rules = UsdValidation.ValidationRegistry().GetOrLoadValidatorsByName(names)
assert len(rules) == 3, rules
context = UsdValidation.ValidationContext(rules)
stage = Usd.Stage.Open(sys.argv[2])
assert [e.GetMessage() for e in context.Validate(stage)] == []
mesh = UsdGeom.Mesh(next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)))
mesh.GetExtentAttr().Set([(0, 0, 0), (1e-3, 1e-3, 1e-3)])
mesh.GetFaceVertexIndicesAttr().Set([0, 1, 10**6] * len(mesh.GetFaceVertexCountsAttr().Get()))
stage.ClearDefaultPrim()
found = context.Validate(stage)
print(json.dumps(sorted({e.GetName() for e in found})))
sites = [site.GetProperty() for error in found for site in error.GetSites() if site.IsProperty()]
assert mesh.GetPath() in {each.GetPrimPath() for each in sites}
# what can be mended is, and nothing else
root = stage.GetPrimAtPath("/" + mesh.GetPath().pathString.split("/")[1])
for left in (["faceVertexIndices", "kind"], ["faceVertexIndices"]):
    for error in found:
        for fixer in error.GetFixersByErrorName():
            target = stage.GetEditTarget()
            assert fixer.CanApplyFix(error, target, Usd.TimeCode.Default())
            assert fixer.ApplyFix(error, target, Usd.TimeCode.Default())
    assert stage.GetDefaultPrim() == root
    if "kind" in left:
        Usd.ModelAPI(root).SetKind("")
    found = context.Validate(stage)
    assert sorted({e.GetName() for e in found}) == left, found
assert Usd.ModelAPI(root).GetKind() == "component"
# of two root prims none is meant
stage.ClearDefaultPrim()
stage.DefinePrim("/other")
error = next(e for e in context.Validate(stage) if e.GetName() == "defaultPrim")
(fixer,) = error.GetFixersByErrorName()
assert not fixer.CanApplyFix(error, stage.GetEditTarget(), Usd.TimeCode.Default())
"""


def in_python(program, *arguments):
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_usdview_takes_the_container():
    in_python(VIEWED, SOURCE / "usdview", SOURCE / "shared")


def test_usd_validators_find_what_check_finds(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "tests/usd")
    import feathers

    cache = tmp_path / "feathers.usdc"
    with CacheWriter(cache, feathers.entries(), (1, 2), 24.0) as writer:
        for number in (1, 2):
            writer.write(feathers.frame(number))
    told = in_python(VALIDATED, SOURCE / "usdvalidation", cache).strip()
    if told.startswith("USD without"):
        pytest.skip(told)
    assert json.loads(told) == ["defaultPrim", "extent", "faceVertexIndices"]


def hosted(folder, name, modules, monkeypatch):
    """A host's module, imported with stand-ins for what the host has."""
    for each, module in modules.items():
        monkeypatch.setitem(sys.modules, each, module)
    monkeypatch.syspath_prepend(SOURCE / folder)
    monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module(name)
