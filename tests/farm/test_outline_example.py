"""The outline of OpenCue in docs/farm.md, with a stand-in for pyoutline."""

from __future__ import annotations

import re
import sys
from types import ModuleType

from places import ROOT

import featherfx


class Recorded:
    """An Outline or a Shell that keeps what it is told."""

    def __init__(self, name: str, **told: object) -> None:
        self.name, self.told = name, told
        self.layers: list[Recorded] = []
        self.after: list[str] = []

    def add_layer(self, layer: Recorded) -> None:
        self.layers.append(layer)

    def depend_on(self, layer: Recorded) -> None:
        self.after.append(layer.name)


def test_the_outline_has_the_items_of_a_plan(tmp_path, monkeypatch):
    for name in ("outline", "outline.modules", "outline.modules.shell"):
        module = ModuleType(name)
        module.Outline = module.Shell = Recorded
        module.cuerun = None
        monkeypatch.setitem(sys.modules, name, module)
    featherfx.plan(ROOT / "samples/swan_wing/shot.toml", tmp_path / "wing.usdc", 3)
    monkeypatch.setattr(sys, "argv", ["outline.py", str(tmp_path / "wing.plan.json")])
    text = (ROOT / "docs/farm.md").read_text(encoding="utf-8")
    (block,) = (
        each for each in re.findall(r"```python\n(.*?)```", text, re.S) if "outline" in each
    )
    known = {"__name__": "outline_of_a_plan"}
    exec(compile(block, "docs/farm.md", "exec"), known)
    *shares, join = known["job"].layers
    assert [each.after for each in shares] == [[], [], []]
    assert join.after == [each.name for each in shares]
    assert [each.told["command"][1] for each in (*shares, join)] == ["bake"] * 3 + ["join"]
