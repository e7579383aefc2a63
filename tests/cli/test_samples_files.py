"""groom, check, presets and preview on the samples."""

import re

import pytest
from commands import invoke
from places import ROOT

from featherfx.api import scene_readers
from featherfx.shot.read.read import read_shot

WING = ROOT / "samples/swan_wing/groom.toml"


@pytest.fixture(scope="module")
def rest(tmp_path_factory):
    output = tmp_path_factory.mktemp("groom") / "wing.usdc"
    result = invoke("groom", WING, "-o", output, "--quality", "draft")
    assert result.exit_code == 0, result.stderr
    assert result.stderr.splitlines()[-1] == f"{output}: 20 feathers at rest"
    return output


def test_groom_is_sound_and_has_no_time(rest):
    from featherfx.usd.read.cache import Cache

    assert invoke("check", rest).exit_code == 0
    cache = Cache(rest)
    assert not cache.has_frames
    assert len(cache.feathers) == 20


# whole birds that are read alone
FULL = ROOT / "samples/pigeon/full.toml"
BIRDS = {FULL, ROOT / "samples/pigeon/groom.toml", *ROOT.glob("samples/first_bird/*.toml")}
BIRDS |= {*ROOT.glob("samples/owl_flight/*.toml")}
BIRDS |= {*ROOT.glob("samples/flock/*.toml")}
CHECKED = sorted({*ROOT.glob("samples/*/*.toml")} - BIRDS)
# layouts of whole birds, and whether feathers keep apart at the start, take many seconds
LONG = {*ROOT.glob("samples/peacock/*.toml"), *ROOT.glob("samples/pigeon/*.toml")}


@pytest.mark.parametrize(
    "file",
    [pytest.param(each, marks=[pytest.mark.nightly] * (each in LONG)) for each in CHECKED],
    ids=str,
)
def test_samples_pass_the_check(file):
    result = invoke("check", file)
    assert result.exit_code == 0, result.stdout


def test_the_full_pigeon_is_sound():
    shot = read_shot(FULL, (), scene_readers())
    assert len(shot.groom.feathers) > 2000


def test_files_of_the_first_wing_pass_the_check(tmp_path):
    text = (ROOT / "docs/first_wing.md").read_text()
    groom, overrides, shot = re.findall(r"```toml\n(.*?)```", text, re.S)
    (tmp_path / "groom.toml").write_text(groom + overrides)
    (tmp_path / "shot.toml").write_text(shot)
    result = invoke("check", tmp_path / "groom.toml", tmp_path / "shot.toml")
    assert result.exit_code == 0, result.stdout


def test_shipped_presets_pass_the_check():
    files = sorted(ROOT.glob("presets/**/*.toml"))
    assert len(files) > 15
    result = invoke("check", *files)
    assert result.exit_code == 0, result.stdout


def test_check_tells_every_problem_of_every_file(tmp_path):
    text = WING.read_text()
    bad = tmp_path / "groom.toml"
    bad.write_text(text.replace("count", "cuont", 1) + "\nhue = 3\n")
    result = invoke("check", bad, tmp_path / "gone.toml", tmp_path / "x.abc", WING)
    assert result.exit_code == 1
    for part in ("cuont", "hue", "gone.toml: there is no such file", "x.abc"):
        assert part in result.stdout
    assert "Traceback" not in result.output


def test_check_tries_the_motion(tmp_path):
    groom = ROOT / "samples/breeze/groom.toml"
    shot = (ROOT / "samples/breeze/shot.toml").read_text()
    shot = shot.replace('"hold"', '"flap"').replace('"groom.toml"', f'"{groom}"')
    (tmp_path / "shot.toml").write_text(shot)
    result = invoke("check", tmp_path / "shot.toml")
    assert result.exit_code == 1
    assert "shoulder" in result.stdout


def test_presets_are_listed_and_shown(tmp_path):
    listed = invoke("presets", "list").stdout
    assert "swan_primary" in listed
    assert "storm" in listed
    shown = invoke("presets", "show", "swan_vane").stdout
    assert "swan_vane.toml" in shown
    assert "modulus_along_barbs" in shown
    folder = tmp_path / "wind"
    folder.mkdir()
    (folder / "breeze.toml").write_text('# Mine.\nbase = "breeze"\nspeed = 4.5\n')
    mine = invoke("presets", "show", "breeze", "--presets", tmp_path).stdout
    assert "speed = 4.5" in mine


def test_an_unknown_preset_names_the_nearest():
    result = invoke("presets", "show", "swan_vanee")
    assert result.exit_code == 1
    assert "swan_vane" in result.stderr
    # of one family those of that family alone
    told = invoke("presets", "show", "quality/zzz").stderr
    assert "known: draft, final" in told
    assert "swan" not in told
    assert "did you mean 'quality'?" in invoke("presets", "show", "qualty/draft").stderr


def test_preview_draws(rest, tmp_path):
    from PIL import Image

    output = tmp_path / "wing.png"
    result = invoke("preview", rest, "-o", output, "--size", "96x64", "--view", "top")
    assert result.exit_code == 0, result.stderr
    with Image.open(output) as picture:
        assert picture.size == (96, 64)
        assert len(picture.getcolors(maxcolors=96 * 64)) > 20
