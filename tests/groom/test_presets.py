"""Presets: found, extended, overridden, shown, and what is said when they are wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.groom.keys.anatomy import TRACTS
from featherfx.groom.keys.problems import Problems
from featherfx.groom.presets.library import Library
from featherfx.groom.presets.presets import check_preset, load_preset
from featherfx.shot.read.reference import describe_preset, list_presets, show
from tests import bird_counts


@pytest.fixture(autouse=True)
def no_user_presets(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("FEATHERFX_PRESETS", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / f"{name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def messages(error: InputError) -> str:
    return "\n".join(str(problem) for problem in error.problems)


def test_every_shipped_preset_is_sound_and_says_what_it_is() -> None:
    listed, library = list_presets(), Library((), Problems())
    for each in listed:
        check_preset(each.family, each.path, library)
    assert library.problems.listed() == []
    assert all(len(each.summary) > 10 for each in listed)
    gull = next(each for each in listed if str(each) == "wing/gull")
    told = "Wing of a herring gull: long and narrow, 10 primaries and 24 flight feathers of the arm"
    assert gull.summary == told
    names = {str(each) for each in listed}
    assert {
        "feather/swan_primary",
        "feather/swan_secondary",
        "feather/body_contour",
        "feather/covert",
        "feather/tail_feather",
        "feather/ornamental_plume",
        "material/vane/swan_vane",
        "material/vane/guinea_fowl_vane",
        "material/rachis/keratin_rachis",
        "quality/draft",
        "quality/preview",
        "quality/final",
        "wind/calm",
        "wind/breeze",
        "wind/gust",
        "wind/storm",
        "motion/hold",
        "motion/flap",
        "motion/shake",
    } <= names


def test_swan_vane_holds_the_published_moduli() -> None:
    _, tree = load_preset("swan_vane")
    assert tree["modulus_along_barbs"].value == 3.6e8
    assert tree["modulus_across_barbs"].value == 4.8e4
    assert tree["shear_modulus"].value == 2.78e4
    ratio = tree["barb_bending_in_plane"].value / tree["barb_bending_normal"].value
    assert ratio == pytest.approx((0.14 * 0.5e-3 / 120e-6) ** 2, rel=0.01)


def test_show_names_the_file_of_each_value() -> None:
    lines = show("covert").splitlines()
    by_key = {line.split(" = ")[0]: line for line in lines if " = " in line}
    assert by_key["length"].endswith("# m, presets/feather/covert.toml")
    assert by_key["rachis.taper"].endswith("presets/feather/body_contour.toml")
    assert by_key["vane_material.modulus_along_barbs"].endswith(
        "Pa, presets/material/vane/swan_vane.toml"
    )
    assert by_key["rachis.twist"].endswith("deg, default")


@pytest.mark.parametrize("name", [f"{preset.family}/{preset.name}" for preset in list_presets()])
def test_shown_preset_is_toml_that_gives_the_same_preset(tmp_path: Path, name: str) -> None:
    text = show(name)
    write(tmp_path / name.rpartition("/")[0], "copied", text)
    shown = show(f"{name.rpartition('/')[0]}/copied", [tmp_path])
    copied = [line.partition("  #")[0] for line in shown.splitlines()[1:]]
    assert copied == [line.partition("  #")[0] for line in text.splitlines()[1:]]


@pytest.mark.parametrize("name", ["pigeon", "swan", "ostrich"])
def test_tracts_of_a_bird_have_counts_lengths_and_sources(name: str) -> None:
    found = json.loads(invoke("presets", "show", f"bird/{name}", "--json").stdout)
    assert set(TRACTS) <= set(found["tracts"])
    for tract, each in found["tracts"].items():
        assert (each["count"] or 0) > 0 or each["relative_density"] == 0.0, tract
        assert each["length"] == found["values"]["tracts"][tract]["length"]
        assert bool(each["cites"]) == (name == "swan")
    assert found["sources"]["tracts"]["breast"]["length"].endswith(f"{name}.toml")


def test_a_bird_of_ones_own_cites_and_has_no_counts(tmp_path: Path) -> None:
    (tmp_path / "bird").mkdir()
    text = 'base = "pigeon"\n[tracts.breast]\ncites = ["Wetmore 1936, Auk 53: 159"]\n'
    (tmp_path / "bird" / "dove.toml").write_text(text)
    breast = describe_preset("bird/dove", [tmp_path])["tracts"]["breast"]
    assert list(breast["cites"]) == ["Wetmore 1936, Auk 53: 159"]
    assert breast["count"] is None


@pytest.mark.nightly
def test_counts_of_tracts_are_what_grows(tmp_path: Path) -> None:
    counts = json.loads(bird_counts.COUNTS.read_text())
    assert bird_counts.count_feathers("sparrow", tmp_path) == counts["sparrow"]


def test_user_folder_wins_and_may_extend_the_shipped_preset(tmp_path: Path) -> None:
    path = write(tmp_path / "wind", "breeze", 'base = "breeze"\nspeed = 4\n')
    _, tree = load_preset("breeze", [tmp_path])
    assert (tree["speed"].value, tree["speed"].source) == (4.0, str(path))
    assert (tree["gust"].value, tree["gust"].source) == (0.2, "presets/wind/breeze.toml")


def test_order_of_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, name in enumerate(("given", "variable", "config/featherfx/presets"), 1):
        write(tmp_path / name / "wind", "mine", f'base = "calm"\nspeed = {number}\n')
    assert load_preset("mine")[1]["speed"].value == 3.0
    monkeypatch.setenv("FEATHERFX_PRESETS", str(tmp_path / "variable"))
    assert load_preset("mine")[1]["speed"].value == 2.0
    assert load_preset("mine", [tmp_path / "given"])[1]["speed"].value == 1.0


def test_cycle_is_printed(tmp_path: Path) -> None:
    for name, base in (("a", "b"), ("b", "c"), ("c", "a")):
        write(tmp_path / "wind", name, f'base = "{base}"\n')
    with pytest.raises(InputError) as caught:
        load_preset("a", [tmp_path])
    assert "preset cycle: a -> b -> c -> a" in messages(caught.value)


def test_preset_of_itself_is_a_cycle(tmp_path: Path) -> None:
    write(tmp_path / "wind", "alone", 'base = "alone"\n')
    with pytest.raises(InputError, match="preset cycle: alone -> alone"):
        load_preset("alone", [tmp_path])


@pytest.mark.parametrize("name", ["swan_primry", "feather/swan_primry"])
def test_unknown_preset_suggests_the_nearest(name: str) -> None:
    with pytest.raises(InputError, match="did you mean 'swan_primary'"):
        load_preset(name)


def test_unknown_base_suggests_the_nearest(tmp_path: Path) -> None:
    path = write(tmp_path / "wind", "mine", 'base = "breez"\n')
    with pytest.raises(InputError) as caught:
        load_preset("mine", [tmp_path])
    found = caught.value.problems
    assert [(each.source, each.key) for each in found] == [(str(path), "base")]
    assert "did you mean 'breeze'" in found[0].message


def test_new_base_of_a_material_drops_the_old_changes(tmp_path: Path) -> None:
    write(
        tmp_path / "feather",
        "first",
        'base = "covert"\nvane_material = { base = "swan_vane", shear_modulus = 1.0 }\n',
    )
    write(tmp_path / "feather", "second", 'base = "first"\nvane_material = "plume_vane"\n')
    write(
        tmp_path / "feather", "third", 'base = "first"\nvane_material.modulus_across_barbs = 2.0\n'
    )
    assert load_preset("second", [tmp_path])[1]["vane_material"]["shear_modulus"].value == 600.0
    third = load_preset("third", [tmp_path])[1]["vane_material"]
    assert (third["shear_modulus"].value, third["modulus_across_barbs"].value) == (1.0, 2.0)


def test_all_faults_of_a_preset_and_its_base_come_at_once(tmp_path: Path) -> None:
    write(tmp_path / "wind", "below", "speed = -1\nguts = 0.2\n")
    write(tmp_path / "wind", "above", 'base = "below"\nspeed = "fast"\ndirection = [0, 0]\n')
    with pytest.raises(InputError) as caught:
        load_preset("above", [tmp_path])
    text = messages(caught.value)
    assert "above.toml: speed: 'fast' is not a number" in text
    assert "above.toml: direction: has 2 items. Give 3" in text
    assert "below.toml: speed: -1 is out of range. Give 0 to 150 m/s" in text
    assert "below.toml: guts: unknown key, did you mean 'gust'?" in text


def test_key_of_another_motion_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "motion", "odd", 'base = "shake"\nturn = 1\n')
    with pytest.raises(InputError, match="turn: does not apply to a motion of kind shake"):
        load_preset("odd", [tmp_path])


def test_missing_keys_are_named_with_their_range(tmp_path: Path) -> None:
    write(tmp_path / "material" / "rachis", "bare", "youngs_modulus = 2e9\n")
    with pytest.raises(InputError) as caught:
        load_preset("bare", [tmp_path])
    assert len(caught.value.problems) == 3
    assert "cortex_fraction: missing, expects a number, 0.01 to 1" in messages(caught.value)


VANE_FAULTS = [
    ("leading.outline = [[0, 0], [0.8, 0.2], [0.2, 0.2], [1, 0]]", "the outline crosses itself"),
    ("leading.outline = [[0, 0], [1, 0]]", "has 2 points. Give 3 to 200"),
    ("leading.outline = [[0, 0], [0.5, -0.1], [1, 0]]", "-0.1 is out of range. Give 0 to 1.5"),
    ("leading.guides = []", "there is an outline but no guide"),
    ("trailing.rounded_base = 1.5", "1.5 is out of range. Give 0 to 1"),
    # a vane without it would feel no wind
    ("vane_material.modulus_across_barbs = 0", "0 is out of range. Give 1e-06 to 1e+10 Pa"),
    ('trailing.rounded_tip = "soft"', "'soft' is not a number"),
    (
        "leading.guides = [{position = 0.5, angle = 40}, {position = 0.5, angle = 41}]",
        "0.5 is not above the guide before it (0.5)",
    ),
    (
        "trailing.guides = [{position = 0.4, angle = 20}, {position = 0.45, angle = 80}]",
        "the barbs of guides 0 and 1 cross within the vane",
    ),
    (
        "trailing.guides = [{position = 0.4, angle = 30, curl = 0}, "
        "{position = 0.42, angle = 30, curl = -60}]",
        "the barbs of guides 0 and 1 cross within the vane",
    ),
    ("leading.outline = []\ntrailing.outline = []", "both vanes are empty"),
    ("leading.outline = [[0, 0], [0.5, 0], [1, 0]]", "leading.outline: is 0 wide everywhere"),
    (
        "vane_material.hook_yield_across = 2e4",
        "vane_material.hook_strength: 19200 is out of range. Give at least the yield stress",
    ),
    (
        "trailing.hooked.rachis = [[0.2, 0], [0.2, 1]]",
        "trailing.hooked.rachis[1][0]: 0.2 is not above the point before it (0.2)",
    ),
    (
        "trailing.splits.places = [[0.5, 0]]",
        "trailing.splits.places[0][1]: 0 is out of range. Give 0.01 to 1",
    ),
    ("trailing.splits.places = [[1.0, 0.5]]", "1 lies outside the vane, which reaches from 0 to 1"),
    (
        "trailing.splits = {places = [[0.5, 0.5], [0.51, 0.4]], width = 0.02}",
        "trailing.splits.places[1][0]: 0.51 crosses the split at 0.5",
    ),
    ("trailing.splits = {count = 40, width = 0.03}", "40 splits cross one another"),
    ("trailing.splits = {count = 2, where = [0.6, 0.6]}", "0.6 is not above the first, 0.6"),
    ("leading = {outline = [], splits = {count = 1}}", "there is no vane on this side"),
    ("rachis.course = [[0.5, 0, 5, 0], [0.5, 0, 9, 0]]", "rachis.course[1][0]: 0.5 is not above"),
    (
        'vane_material = { ribbon = true, hooks = "open" }',
        "vane_material.hooks: 'open' is not for vane_material.ribbon = true",
    ),
    (
        "vane_material.ribbon = true\nleading.splits.count = 1",
        "leading.splits: is not for vane_material.ribbon = true",
    ),
    ("vane_material = { ribbon = true, bending_across = 0 }", "Give a value above 0 N m"),
    (
        "vane_material = { ribbon = true, poissons_ratio = 0.6 }",
        "0.6 is out of range. Give 0 to 0.5",
    ),
    (
        "vane_material = { ribbon = true, across_barbs_profile.rachis = [[0, 2]] }",
        "vane_material.across_barbs_profile: is not for vane_material.ribbon = true",
    ),
    (
        "vane_material.along_barbs_profile.barb = [[0.5, 1], [0.5, 2]]",
        "along_barbs_profile.barb[1][0]: 0.5 is out of order or range. Give 0 to 1",
    ),
    ("rachis.diameter_profile = [[1.5, 1]]", "rachis.diameter_profile[0][0]: 1.5 is out of order"),
    (
        "rachis_material.modulus_profile = [[0, 1], [1, 0]]",
        "rachis_material.modulus_profile[1][1]: 0 is out of range. Give 0.001 to 1000",
    ),
    ("vane_material.thickness_profile.rachis = [[0]]", "rachis[0]: has 1 item. Give 2"),
    ("leading.hooked.barb = [[0.5, 1.2]]", "1.2 is out of range. Give 0 to 1"),
    ("rachis.diameter_tip = 0.02", "Give up to diameter_base = 0.0054 m"),
]


@pytest.mark.parametrize(("line", "message"), VANE_FAULTS)
def test_shapes_that_cannot_be_built(tmp_path: Path, line: str, message: str) -> None:
    from featherfx.shot.read.read import check_file

    path = write(tmp_path / "feather", "bad", f'base = "swan_primary"\n{line}\n')
    found = [str(each) for each in check_file(path)]
    assert len(found) >= 1
    assert any(message in each and each.startswith(str(path)) for each in found), found


def test_one_vane_alone_is_fine(tmp_path: Path) -> None:
    from featherfx.shot.read.read import check_file

    path = write(tmp_path / "feather", "sided", 'base = "swan_primary"\nleading.outline = []\n')
    assert check_file(path) == []


def test_chains_of_presets_have_a_length(tmp_path: Path) -> None:
    write(tmp_path / "wind", "p0", 'base = "calm"\n')
    for number in range(1, 400):
        write(tmp_path / "wind", f"p{number}", f'base = "p{number - 1}"\n')
    assert load_preset("p50", [tmp_path])[1]["speed"].value == 0.0
    with pytest.raises(InputError, match="more than 64 presets extend each other"):
        load_preset("p399", [tmp_path])
