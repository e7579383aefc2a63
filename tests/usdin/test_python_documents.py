"""Shots and grooms in memory: made of tables, changed, saved, baked, and read back."""

import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import featherfx as ffx
from featherfx.groom.read.toml_text import toml_text

SAMPLES = Path(__file__).parents[2] / "samples"
FEATHER = {
    "id": "a",
    "kind": "swan_primary",
    "position": np.zeros(3),
    "direction": (1, 0, 0),
    "up": [0, 0, 1],
}


def one_feather(**more):
    return ffx.Groom.from_dict({"name": "one", "feather": [FEATHER | more]})


@pytest.fixture(scope="module")
def shot():
    return ffx.read_shot(SAMPLES / "swan_wing/shot.toml").with_quality("draft")


def test_the_package_lists_what_it_has_and_all_of_it_is_documented():
    assert dir(ffx) == sorted(ffx.__all__)
    assert all(getattr(ffx, name).__doc__ for name in ffx.__all__ if name != "__version__")


SNIPPET = """
import featherfx as ffx
shot = ffx.read_shot("shot.toml")
shot = shot.with_overrides({"*primary_*": {"rachis.youngs_modulus": 6e9}}).with_quality("draft")
cache = ffx.bake(shot, "out.usdc", progress=True)      # a Shot or a path; returns an open cache with .report
points = cache["left_primary_03"].points(12)            # (V, 3) m; also cache.ids, len(cache), iteration, .velocities
for frame in ffx.simulate(shot, frames=(1, 3)):         # a mapping of ids to numpy views
    print(frame.number, frame.points["left_primary_03"].shape)
groom = ffx.Groom.from_dict({"name": "one", "feather": [{"id": "a", "kind": "swan_primary", "position": [0, 0, 0], "direction": [1, 0, 0], "up": [0, 0, 1]}]})
problems, costs = ffx.check(shot), ffx.stats(shot)
"""  # noqa: E501


def test_the_example_of_a_program_runs(tmp_path, monkeypatch, capsys):
    shutil.copytree(SAMPLES / "swan_wing", tmp_path, dirs_exist_ok=True)
    path = tmp_path / "shot.toml"
    path.write_text(path.read_text().replace("frames = [1, 24]", "frames = [1, 12]"))
    monkeypatch.chdir(tmp_path)
    known = {}
    exec(SNIPPET, known)
    assert "frames: 12 of 12" in capsys.readouterr().err
    cache, frame = known["cache"], known["frame"]
    assert cache.report["feathers"] == len(cache) == len(list(cache)) == 20
    track = cache["left_primary_03"]
    assert known["points"].shape == track.points(3).shape == frame.points["left_primary_03"].shape
    assert frame.points["left_primary_03"] == pytest.approx(track.points(3), abs=1e-6)
    assert frame.velocities["left_primary_03"] == pytest.approx(track.velocities(3), abs=1e-4)
    assert cache.ids == tuple(frame.points)
    assert known["problems"] == ffx.check(known["groom"]) == []
    assert known["costs"]["feathers"] == 20
    assert repr(known["shot"]) == "Shot('swan_wing', 20 feathers, frames 1 to 12)"
    assert all(len(repr(each)) < 80 for each in (frame, track, known["groom"]))
    with pytest.raises(ffx.InputError, match=r"frame: 25 is not in the cache\. Give 1 to 12"):
        track.points(25)


def test_long_calls_tell_how_far_they_are(tmp_path, capsys):
    told = []
    shot = ffx.read_shot(SAMPLES / "swan_wing/shot.toml", progress=lambda *done: told.append(done))
    assert told[-1] == (1, 1)
    ffx.stats(shot.groom, progress=True)
    cache = ffx.bake(shot.with_quality("draft"), tmp_path / "a.usdc", frames=(1, 2))
    for call in (
        lambda: ffx.retime(cache.path, tmp_path / "b.usdc", speed=0.5, progress=True),
        lambda: ffx.export(cache.path, tmp_path / "c.obj", progress=True),
        lambda: ffx.check(cache.path, progress=True),
    ):
        capsys.readouterr()
        call()
        (*_, last) = capsys.readouterr().err.splitlines()
        assert re.fullmatch(r"\w+: (\d+) of \1", last)

    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ffx.export(cache.path, tmp_path / "d.usdc", condensed=True, progress=interrupt)
    assert not list(tmp_path.glob("d*"))


def test_nothing_changes_in_place_and_equal_values_are_equal(shot):
    again = ffx.read_shot(shot.source).with_quality("draft")
    assert again == shot
    assert again.groom.joints[0] == shot.groom.joints[0]
    assert shot.wind == again.wind != shot.replace(wind="breeze").wind
    arrays = (shot.gravity, shot.wind.direction, shot.groom.feathers[0].rotation)
    for each in (*arrays, shot.groom.joints[0].position):
        with pytest.raises(ValueError, match="read-only"):
            each[0] = 0.0
    own = np.zeros(3)
    assert replace(shot, gravity=own) != shot
    own[2] = 1.0  # of who gave it


def test_overrides_act_as_those_of_a_file(shot):
    changed = shot.with_overrides({"*primary_*": {"rachis.youngs_modulus": 6e9}})
    other = shot.with_overrides({"*primary_*": {"rachis_material": {"youngs_modulus": 6e9}}})
    kinds = [[each.kind for each in one.groom.feathers] for one in (changed, other)]
    assert kinds[0] == kinds[1]
    for before, after in zip(shot.groom.feathers, changed.groom.feathers, strict=True):
        moduli = before.kind.rachis_material.youngs_modulus, 6e9
        assert after.kind.rachis_material.youngs_modulus == moduli["primary" in after.id]
    assert changed.quality.name == "draft"


def test_a_table_with_a_base_replaces_an_earlier_override(shot):
    stiff = {"rachis_material": {"youngs_modulus": 6e9}}
    first = shot.with_overrides({"*": stiff})
    again = first.with_overrides({"*": {"rachis_material": {"base": "keratin_rachis"}}})
    assert again.to_dict()["overrides"] == {"*": {"rachis_material": {"base": "keratin_rachis"}}}
    softer = first.with_overrides({"*": {"rachis.shear_modulus": 1e9}})
    merged = stiff["rachis_material"] | {"shear_modulus": 1e9}
    assert softer.to_dict()["overrides"] == {"*": {"rachis_material": merged}}


def test_a_saved_shot_is_the_same_from_another_folder(shot, tmp_path):
    changed = shot.replace(frames=(2, 9), wind={"base": "breeze", "speed": 0.1 + 0.2})
    changed = changed.with_overrides({"left_primary_*": {"length": 0.4}})
    file = changed.to_toml(tmp_path / "deep.toml")
    again = ffx.read_shot(file)
    assert again.wind.speed == 0.1 + 0.2
    assert (again.first_frame, again.last_frame) == (2, 9)
    assert [f.kind for f in again.groom.feathers] == [f.kind for f in changed.groom.feathers]
    with pytest.raises(ffx.InputError, match="exists already"):
        changed.to_toml(file)
    with pytest.raises(ffx.InputError, match=r"ends in \.toml"):
        changed.to_toml(tmp_path / "a.usda")


def test_the_groom_of_a_shot_is_changed_with_what_the_shot_overrides(shot, tmp_path):
    stiff = shot.with_overrides({"*primary_*": {"rachis.youngs_modulus": 6e9}})
    groom = stiff.groom.replace(variation=None)
    again = shot.replace(groom=groom).groom
    assert [each.kind for each in again.feathers] == [each.kind for each in groom.feathers]
    moduli = {each.kind.rachis_material.youngs_modulus for each in again.feathers}
    assert moduli == {6e9, shot.groom.feathers[0].kind.rachis_material.youngs_modulus}
    assert ffx.read_groom(shot.groom.to_toml(tmp_path / "groom.toml")).name == shot.groom.name


def test_a_shot_may_hold_its_groom(tmp_path):
    shot = ffx.Shot.from_dict({"name": "s", "groom": one_feather(), "frames": (1, 2)})
    again = ffx.read_shot(shot.to_toml(tmp_path / "s.toml"))
    assert again.groom.feathers[0].kind == shot.groom.feathers[0].kind
    tables = shot.to_dict()
    tables["groom"]["feather"][0]["kind"] = "swan_primry"
    with pytest.raises(ffx.InputError, match=r"<memory>: groom\.feather\[0\]\.kind: no feather"):
        ffx.Shot.from_dict(tables)
    assert shot.to_dict()["groom"]["feather"][0]["kind"] == "swan_primary"


def test_tables_of_samples_and_presets_outlive_being_written():
    files = [*SAMPLES.rglob("*.toml"), *SAMPLES.with_name("presets").rglob("*.toml")]
    assert len(files) > 80
    for file in files:
        tables = tomllib.loads(file.read_text(encoding="utf-8"))
        assert tomllib.loads(toml_text(tables)) == tables, file


def test_texts_and_numbers_outlive_being_written():
    tables = {"a b": {"": [1e-7, 0.1, 10**17, True, -0.0, 'q"\\\n\x7f\x00'], "c.d": [{"e": {}}]}}
    assert tomllib.loads(toml_text(tables)) == tables


def test_what_has_no_tables_and_what_toml_cannot_hold_is_refused(shot):
    bare = replace(shot, gravity=np.zeros(3))
    for way in (bare.to_dict, lambda: bare.with_overrides({}), lambda: bare.replace(frames=(1, 2))):
        with pytest.raises(ffx.InputError, match="fields were replaced"):
            way()
    with pytest.raises(ffx.InputError, match=r"feather\[0\]\.up: type object is nothing"):
        one_feather(up=object())
    with pytest.raises(ffx.InputError, match="did you mean 'draft'"):
        shot.with_quality("drft")


def test_a_changed_shot_bakes_as_the_file_that_it_is_saved_to(tmp_path):
    groom = one_feather()
    shot = ffx.Shot.from_dict({"name": "s", "groom": groom, "frames": (1, 2), "quality": "draft"})
    memory = ffx.bake(shot, tmp_path / "memory.usdc")
    file = ffx.bake(shot.to_toml(tmp_path / "s.toml"), tmp_path / "file.usdc")
    np.testing.assert_array_equal(memory["a"].points(2), file["a"].points(2))
    again = ffx.bake(shot, tmp_path / "memory.usdc", resume=True)
    assert again.report["samples_taken_over"] == 2
