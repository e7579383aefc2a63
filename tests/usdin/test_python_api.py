"""The functions that programs call: lazy, complete, and without state between calls."""

import importlib
import inspect
import re
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest
from places import ROOT
from usdin_scenes import add_curves, arc, new_stage, write_shot

import featherfx
from featherfx.baking.options import BakeOptions
from featherfx.errors import InputError


def test_every_function_is_typed_and_says_what_it_does():
    for name in featherfx.__all__:
        function = getattr(featherfx, name)
        if name == "__version__":
            continue
        assert inspect.getdoc(function)
        if isinstance(function, type) and issubclass(function, Exception):
            continue
        signature = inspect.signature(function)
        assert signature.return_annotation is not inspect.Signature.empty
        for parameter in signature.parameters.values():
            assert parameter.annotation is not inspect.Parameter.empty


# of the solver and of files, which no program needs
INTERNAL = {"State", "Document", "Layout", "Cache"}
# of keywords, feathers and errors; and what a loop of one's own writes by
MORE = {"BakeOptions", "GroomOptions", "CacheWriter", "Documented", "FeatherKind", "Problem"}


def named_types(name):
    """Words in the annotations of what a function returns, or of the fields of a class."""
    public = getattr(featherfx, name)
    if isinstance(public, type):
        notes = vars(public).get("__annotations__", {})
        told = [str(note) for key, note in notes.items() if key[0] != "_"]
    else:
        told = [str(inspect.signature(public).return_annotation)]
    return set(re.findall(r"\w+", " ".join(told)))


def test_the_page_of_the_interface_has_every_name_and_type_and_no_module():
    page = (ROOT / "docs/api.md").read_text(encoding="utf-8")
    entries = re.findall(r"^::: featherfx\.(\S+)\.(\w+)$", page, re.M)
    for home, name in entries:
        shown = getattr(importlib.import_module(f"featherfx.{home}"), name)
        assert shown.__module__ == f"featherfx.{home}"
    names = {name for _, name in entries}
    assert page.count(":::") == len(names) == len(entries)
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "featherfx").rglob("*.py"))
    ours = {name for text in sources for name in re.findall(r"^class (\w+)", text, re.M)}
    public = set(featherfx.__all__) - {"__version__"}
    # fields of shots and qualities are keys, which the reference has
    named = set.union(*map(named_types, public - {"Shot", "Quality"})) & ours - INTERNAL
    assert public <= names
    assert names - public <= named | MORE
    assert named - names == set()


def test_keywords_are_those_of_the_options(tmp_path):
    names = set(inspect.signature(featherfx.bake).parameters)
    assert {each.name for each in fields(BakeOptions)} < names
    with pytest.raises(TypeError, match="'frame'"):
        featherfx.bake("shot.toml", frame=(1, 2))
    with pytest.raises(InputError, match=r"bake: subframes: 0 is not allowed\. Give 1 to "):
        featherfx.bake(write_shot(tmp_path, None), tmp_path / "a.usda", subframes=0)


def test_toml_grooms_do_not_load_usd(tmp_path):
    shot = write_shot(tmp_path, None)
    code = f"import sys, featherfx; featherfx.read_shot({str(shot)!r}); print('pxr' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_equal_calls_give_equal_results(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/c", [arc(), arc(0.1)])
    stage.Save()
    first, second = (featherfx.read_groom(tmp_path / "bird.usda") for _ in range(2))
    assert [f.kind for f in first.feathers] == [f.kind for f in second.feathers]
    for a, b in zip(featherfx.build(first), featherfx.build(second), strict=True):
        np.testing.assert_array_equal(a.points, b.points)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bird.usda"]


def test_build_takes_qualities_by_name_and_by_value(tmp_path):
    groom = featherfx.read_shot(write_shot(tmp_path, None)).groom
    draft = featherfx.read_quality("draft")
    assert featherfx.build(groom, draft)[0].rows == draft.rows
    assert featherfx.build(groom, "draft")[0].rows == draft.rows
    with pytest.raises(InputError, match="there is no such preset, did you mean 'draft'"):
        featherfx.build(groom, "drft")
