"""The files of docs/production_shot.md, on the creature that it names."""

import re
import warnings

import creature
import numpy as np
from commands import invoke
from places import ROOT

import featherfx
from featherfx.errors import InputWarning

PAGE = (ROOT / "docs/production_shot.md").read_text()


def test_the_page_shows_what_check_prints_of_two_mistakes(tmp_path, monkeypatch):
    groom = re.search(r"```toml\n(.*?)```", PAGE, re.S)[1]
    wrong = groom.replace("{ vertex = 117 }, d", "{ vertex = 99117 }, d").replace(
        '"covert"', '"cover"'
    )
    (tmp_path / "groom.toml").write_text(wrong)
    creature.skinned(tmp_path / "creature.usda")
    monkeypatch.chdir(tmp_path)
    printed = invoke("check", "groom.toml")
    lines = (printed.stdout + printed.stderr).splitlines()
    shown = re.search(r"one line each:\n\n```text\n(.*?)\n```", PAGE, re.S)[1]
    assert [line for line in lines if line.startswith("groom.toml:")] == shown.splitlines()


def test_files_of_the_page_fit_the_creature(tmp_path):
    """With a thin coat that is not laid over itself, which would take long."""
    groom, free, contact, _ = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    thin = groom.replace("count = 1500", "count = 40")
    (tmp_path / "groom.toml").write_text(thin.replace("[layout]\n", ""))
    (tmp_path / "shot.toml").write_text(free + contact)
    creature.skinned(tmp_path / "creature.usda")
    with warnings.catch_warnings():
        # such as of roots that are far from the skin
        warnings.simplefilter("error", InputWarning)
        found = featherfx.read_shot(tmp_path / "shot.toml")
    regions = [each.region for each in found.groom.feathers]
    counts = {name: regions.count(name) for name in set(regions)}
    assert counts == {"primaries": 20, "secondaries": 30, "coverts": 64, "coat": 40}
    assert (found.first_frame, found.last_frame) == (creature.FIRST, creature.LAST)
    # as it lies the coat is in the lee of itself, and a primary in the wind
    reached = dict(zip((each.id for each in found.groom.feathers), found.exposure, strict=True))
    coat = [share for name, share in reached.items() if name.startswith("coat")]
    assert np.median(coat) < 0.35
    assert reached["right_primary_09"] > 0.7
    # left and right mirror each other, and all fly as the body does
    positions = {each.id: each.position for each in found.groom.feathers}
    for name, place in positions.items():
        if name.startswith("right_"):
            other = positions[name.replace("right", "left")]
            np.testing.assert_allclose(other, place * [1, -1, 1], atol=1e-6)
    way = found.skin.frames(0.5).positions - found.skin.frames(0.25).positions
    assert abs(way[:, 0].mean() - 0.25 * creature.SPEED) < 0.1
