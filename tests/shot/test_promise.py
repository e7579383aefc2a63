"""Errors that are asked for: measured on a sample, kept, and the same for every part of a shot."""

import json
from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.api import read_quality
from featherfx.baking.pipeline import bake
from featherfx.errors import InputError
from featherfx.files.disk_cache import nothing_kept
from featherfx.groom.keys.preset import Quality
from featherfx.lab.bench.promise import errors, fixed_quality, random_shot, run
from featherfx.shot.loop import calibration, grids, window_runs
from featherfx.shot.loop.grids import stratify
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import (
    TIME,
    common_tolerance,
    first_grid,
    resolve_options,
    simulation_quality,
    stepped_down,
)
from featherfx.shot.patterns import Detail
from featherfx.shot.read.read import read_shot
from featherfx.shot.read.reference import list_presets
from featherfx.shot.types import part_of

PULL = SAMPLES / "feather_pull/shot.toml"
GROOM = """name = "g"
[[row]]
id = "covert"
kind = "covert"
count = 12
first = { position = [0, 0, 0], direction = [1, 0.2, 0], up = [0, 0, 1] }
last = { position = [0, 3, 0], direction = [1, -0.2, 0.1], up = [0, 0, 1] }
[[feather]]
id = "contour"
kind = "body_contour"
position = [0, 5, 0]
direction = [1, 0, 0.5]
up = [0, 0, 1]
"""
SHOT = """name = "s"
groom = "g.toml"
frames = [1, 5]
quality = { error = 1.0 }
[wind]
base = "gust"
speed = 3
direction = [-0.2, 0.1, 1]
"""


@pytest.fixture
def gust(tmp_path):
    """A contour feather and twelve coverts in a gust."""
    (tmp_path / "g.toml").write_text(GROOM)
    (tmp_path / "s.toml").write_text(SHOT)
    return read_shot(tmp_path / "s.toml")


def options_of(shot):
    """Options of all feathers of a shot, measured anew."""
    grids._known.clear()
    with nothing_kept():
        return resolve_options(shot, drawn_feathers(shot), root_motion(shot))


def test_the_error_is_kept_and_measured(gust):
    """Beside three times the rows, columns and coefficients and a tenth of the tolerance."""
    shot = part_of(gust, np.array([0, 3]))
    found = run(shot)
    grid = tuple(3 * max(getattr(o, n) for o in found.options) for n in ("rows", "columns"))
    fine = fixed_quality((*grid, 4), 0.1 * TIME[4], shot.quality)
    worst = 100.0 * max(errors(found, run(replace(shot, quality=fine))))
    assert worst <= found.report["error_promised"] == 1.0
    assert 0.2 * worst < found.report["error_measured"] <= 1.0


def test_less_error_takes_finer_settings(gust):
    taken = [
        sum(each.rows / each.tolerance for each in options_of(replaced).full)
        for replaced in (
            replace(part_of(gust, np.array([3])), quality=gust.quality.with_error(error))
            for error in (4.0, 1.0, 0.5)
        )
    ]
    assert taken == sorted(taken)
    assert taken[-1] > 2.0 * taken[0]


def test_one_sample_of_each_kind_and_load_stands_for_its_stratum(gust):
    found = options_of(gust)
    contour, *coverts = found.measured
    assert len(set(coverts)) < 12
    assert contour not in coverts
    bent = [calibration.Deflection(0.01 + 1e-5 * k, 0.01) for k in range(13)]
    strata = stratify(gust, np.arange(13), bent, np.zeros(13, dtype=bool))
    assert sorted(np.concatenate([each.members for each in strata]).tolist()) == list(range(13))
    assert all(each.members[-1] in each.sample for each in strata)


def test_only_feathers_that_are_solved_are_measured(gust):
    """Of others nothing is known: no window simulates them."""
    rigid = Detail(feathers="covert_*", level="rigid")
    found = options_of(replace(gust, details=(rigid,)))
    *coverts, contour = sorted(found.measured, key=lambda each: -each.error)
    assert contour.error < 0.01
    assert {each.error for each in coverts} == {np.inf}
    none = options_of(replace(gust, details=(replace(rigid, feathers="*"),)))
    assert set(none.measured) == {coverts[0]}


def test_what_is_measured_depends_on_the_shot_alone(gust):
    whole = options_of(gust).feathers
    some = simulate(gust, 2, wanted=[2, 12], frames=(3, 4))
    assert some.options == [whole[2], whole[12]]


@pytest.fixture(scope="module")
def fluttering():
    """An ostrich plume, of which every grid has its own flutter."""
    kinds = sorted(each.path.stem for each in list_presets() if each.family == "feather")
    return part_of(random_shot(9100, kinds), np.array([1]))


@pytest.mark.nightly
def test_finer_grids_that_take_too_long_are_not_tried(fluttering, monkeypatch):
    monkeypatch.setattr(calibration, "_MAX_MEAN_WORK", 0.0)
    (measured,) = options_of(fluttering).measured
    assert measured.space == first_grid(fluttering.quality.promised).space
    assert measured.error > fluttering.quality.promised


@pytest.mark.nightly
def test_mean_pose_and_swing_are_measured_of_what_flutters(fluttering):
    shot, found = fluttering, options_of(fluttering)
    begun = first_grid(shot.quality.promised)
    (measured,) = found.measured
    assert not measured.is_unique
    assert measured.space > begun.space
    assert 0.2 * shot.quality.promised < measured.error <= shot.quality.promised
    simulation = simulate(shot, frames=(shot.first_frame, shot.first_frame))
    list(simulation)
    assert simulation.report["undefined"] == {"ostrich_plume": ["f1"]}
    assert simulation.report["error_measured"] == 100.0 * measured.error


def test_presets_promise_errors_and_have_tolerances_where_feathers_push_each_other(gust):
    shot = random_shot(2, ["covert"])
    alone = replace(shot, contact=None)
    for name, error, tolerance in (
        ("draft", 0.03, 1e-3),
        ("preview", 0.015, 1.5e-4),
        ("final", 0.005, 2e-5),
    ):
        quality = read_quality(name)
        held = simulation_quality(replace(shot, quality=quality))
        assert held.promised == pytest.approx(error)
        assert held.tolerance == tolerance == common_tolerance(replace(shot, quality=quality))
        assert simulation_quality(replace(alone, quality=quality)).promised == pytest.approx(error)
        assert replace(quality, tolerance=1e-6).pushing.tolerance == 1e-6
        assert quality.with_error(1.0).pushing.promised == 0.01


def test_rows_and_columns_that_are_asked_for_overrule_the_error(gust):
    quality = replace(read_quality("draft"), simulated_rows=7, simulated_columns=3, coefficients=1)
    for own in options_of(replace(gust, quality=quality)).full:
        assert (own.rows, own.columns, own.coefficients) == (7, 3, 1)


def test_an_error_that_a_number_holds_up_is_told_as_an_error(gust):
    """Barbs that may not bend err by the same on every grid: that is no second answer."""
    shot = part_of(gust, np.array([12]))
    stiff = options_of(replace(shot, quality=replace(shot.quality, coefficients=0))).measured[0]
    assert stiff.is_unique
    assert stiff.error > shot.quality.promised > options_of(shot).measured[0].error


def test_tolerances_are_stepped_down_by_less_than_a_third():
    for tolerance in (1e-5, 3.3e-5, 1e-3):
        assert 0.7 * tolerance < stepped_down(tolerance) <= tolerance


def test_one_tolerance_for_all_is_at_most_a_part_of_each_length(gust):
    draft = Quality(name="draft", tolerance=1e-3, coefficients=1)
    lengths = np.array([placement.kind.length for placement in gust.groom.feathers])

    def tolerances(shot):
        return np.array([each.tolerance for each in options_of(replace(shot, quality=draft)).full])

    most = np.minimum(1e-3, 0.01 * lengths)
    assert (most < 1e-3).any()
    found = tolerances(gust)
    assert (found <= most).all()
    assert (found > 0.7 * most).all()
    # who pushes each other takes common steps
    pushing = replace(gust, contact=random_shot(2, ["covert"]).contact)
    assert (tolerances(pushing) == 1e-3).all()


def test_an_error_alone_is_a_quality_and_a_tolerance_alone_promises_none(tmp_path):
    def quality_of(text):
        (tmp_path / "shot.toml").write_text(
            f'name = "s"\ngroom = "{PULL.parent / "groom.toml"}"\nframes = [1, 2]\n{text}\n'
        )
        return read_shot(tmp_path / "shot.toml").quality

    assert quality_of("quality = { error = 0.8 }").promised == 0.008
    assert quality_of("quality = { rows = 9 }").promised == 0.005
    given = quality_of("quality = { tolerance = 1e-4 }")
    assert given.promised is None
    assert given.with_error(1.0).promised == 0.01
    with pytest.raises(InputError, match="error"):
        quality_of("quality = { error = 0 }")


def test_no_error_is_promised_where_feathers_push_each_other_or_none_is_asked_for(gust):
    contact = random_shot(2, ["covert"]).contact

    def promised(shot):
        options = options_of(shot)
        return options.promised_error, options.why_not_promised

    some = part_of(gust, np.array([0, 1]))
    assert promised(some) == (pytest.approx(0.01), "")
    error, why = promised(replace(some, contact=contact))
    assert error is None
    assert "push each other" in why
    error, why = promised(replace(some, quality=Quality(name="q", tolerance=1e-4)))
    assert error is None
    assert "a tolerance and no error" in why


def test_errors_of_feathers_that_push_each_other_are_measured(tmp_path, monkeypatch):
    """One covert lies on another."""
    rows = GROOM.partition("[[feather]]")[0].replace("3, 0], direction", "0.006, 0], direction")
    (tmp_path / "g.toml").write_text(rows.replace("count = 12", "count = 2"))
    text = SHOT.replace("[1, 5]", "[1, 2]").replace("error = 1.0", "error = 5.0")
    (tmp_path / "s.toml").write_text(text + "[contact]\nsteps = 4\n")
    report = tmp_path / "report.json"
    bake(tmp_path / "s.toml", tmp_path / "s.usdc", report=report)
    found = json.loads(report.read_text())
    assert found["contact"]["pairs"] == 1
    assert found["error_promised"] == 5.0
    assert 0.0 < found["error_measured"] < 10.0
    assert "error_not_promised" not in found
    # where shorter steps lead ever farther
    monkeypatch.setattr(window_runs, "simulate_window", lambda shot, window: [None, None])
    monkeypatch.setattr(window_runs, "run_distance", lambda one, other: 0.1)
    with nothing_kept():
        before = {"undefined": {"covert": ["covert_01"], "down": ["d"]}}
        told = window_runs.add_contact_error(read_shot(tmp_path / "s.toml"), before)
    assert told["undefined"] == {"covert": ["covert_01", "covert_02"], "down": ["d"]}
    assert told["error_measured"] is None


def test_errors_in_contact_that_cannot_be_measured_are_told(gust):
    shot = replace(part_of(gust, np.array([0])), contact=random_shot(2, ["covert"]).contact)
    off = {"contact": {"feathers_whose_contacts_yielded": 1}}
    for report, why in ((off, "left out"), ({"undefined": {}}, "no two feathers")):
        told = window_runs.add_contact_error(shot, {"error_not_promised": "before", **report})
        assert why in told["error_not_promised"]


def test_neighbours_of_two_kinds_are_measured_once(tmp_path, monkeypatch):
    lines = ['name = "two"']
    for kind, place in (("covert", "[0, 0, 0]"), ("body_contour", "[0, 0, 0.001]")):
        lines += ["[[feather]]", f'id = "{kind}"', f'kind = "{kind}"', f"position = {place}"]
        lines += ["direction = [1, 0, 0]", "up = [0, 0, 1]"]
    (tmp_path / "g.toml").write_text("\n".join(lines))
    grid = "simulated_rows = 7, simulated_columns = 3, coefficients = 1"
    lines = ['name = "two"', 'groom = "g.toml"', "frames = [1, 2]", "[contact]"]
    lines.insert(3, f'quality = {{ base = "draft", {grid} }}')
    (tmp_path / "s.toml").write_text("\n".join(lines))
    runs = []
    monkeypatch.setattr(window_runs, "simulate_window", lambda *given: runs.append(given) or [1, 1])
    monkeypatch.setattr(window_runs, "run_distance", lambda one, other: 0.0)
    with nothing_kept():
        found = window_runs.add_contact_error(read_shot(tmp_path / "s.toml"), {"undefined": {}})
    assert found["error_measured"] == 0.0
    assert len(runs) == 3  # as it is, finer in time, finer in space


def test_a_bake_takes_an_error_and_reports_it(tmp_path):
    report = tmp_path / "report.json"
    bake(PULL, tmp_path / "p.usdc", frames=(1, 2), report=report)
    found = json.loads(report.read_text())
    assert found["error_promised"] == 1.5
    assert 0.0 < found["error_measured"] < 1.5
    assert found["undefined"] == {}
    assert found["strain_worst"].keys() >= {"feather", "frame"}
    with pytest.raises(InputError, match=r"error: 30\.0 is not allowed. Give 0\.01 to 20"):
        bake(PULL, tmp_path / "p.usdc", error=30.0)
