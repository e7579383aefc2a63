"""Errors that are asked for: what is simulated for them, and whether they are kept."""

import json
from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.baking.pipeline import bake
from featherfx.errors import InputError
from featherfx.groom.keys.preset import Quality
from featherfx.lab.bench.front import Setting, at, errors, fine, run
from featherfx.lab.bench.scenes import scene
from featherfx.shot.detail.detail import simulated_settings
from featherfx.shot.detail.promise import chosen_for, common_tolerance, front, stepped_down
from featherfx.shot.read.read import read_shot
from featherfx.shot.share import part_of

PULL = SAMPLES / "feather_pull/shot.toml"


def work(chosen):
    known = front()
    grid = known.rows.cost[chosen.rows] * known.columns.cost[chosen.columns]
    return grid * known.coefficients.cost[chosen.coefficients] * chosen.tolerance ** (-1 / 3)


def test_less_error_and_softer_feathers_take_more_work():
    for shaft, barb in ((1e-3, 1e-3), (0.05, 0.02), (0.1, 0.05)):
        taken = [work(chosen_for(error, shaft, barb)) for error in (0.02, 0.01, 0.005, 0.0025)]
        assert taken == sorted(taken)
        assert taken[-1] > 2.0 * taken[0]
    assert work(chosen_for(0.01, 0.5, 0.1)) > work(chosen_for(0.01, 0.01, 0.01))


def test_what_is_chosen_is_expected_to_keep_the_error():
    known = front()
    for error in (0.02, 0.01, 0.005):
        chosen = chosen_for(error, 0.03, 0.02)
        space = (
            known.rows.expected(chosen.rows, 0.03)
            + known.columns.expected(chosen.columns, 0.02)
            + known.coefficients.expected(chosen.coefficients, 0.02)
        )
        assert np.hypot(space, known.of_steps(chosen.tolerance)) <= error


def test_more_rows_columns_and_coefficients_miss_less_and_cost_more():
    for table in front()[:3]:
        numbers = sorted(table.cost)
        assert [table.factor[n] for n in numbers] == sorted(table.factor.values(), reverse=True)
        assert table.cost[numbers[-1]] > table.cost[numbers[0]] > 0.0
        assert 0.0 <= table.exponent <= 1.0


def test_tolerances_are_stepped_down_by_less_than_a_third():
    for tolerance in (1e-5, 3.3e-5, 1e-3):
        assert 0.7 * tolerance < stepped_down(tolerance) <= tolerance


def test_one_tolerance_for_all_is_at_most_a_part_of_each_length():
    shot = scene("gust")
    draft = Quality(name="draft", tolerance=1e-3, coefficients=1)
    lengths = np.array([placement.kind.length for placement in shot.groom.feathers])

    def tolerances(shot):
        settings = simulated_settings(replace(shot, quality=draft), [], None)
        return np.array([each.tolerance for each in settings])

    most = np.minimum(1e-3, 0.01 * lengths)
    assert (most < 1e-3).any()
    assert (most == 1e-3).any()
    found = tolerances(shot)
    assert (found <= most).all()
    assert (found > 0.7 * most).all()
    # who pushes each other takes common steps
    pushing = replace(shot, contact=scene("contact").contact)
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


def test_what_concerns_all_feathers_has_a_tolerance_either_way():
    shot = replace(read_shot(PULL), quality=Quality(name="q", tolerance=3e-4))
    assert common_tolerance(shot) == 3e-4
    assert 1e-7 < common_tolerance(replace(shot, quality=Quality(name="q", error=1.0))) < 1e-2


def test_the_error_is_kept_and_estimated():
    """Against a reference three times as fine in every way; a covert and a contour feather."""
    shot = part_of(scene("gust"), np.array([1, 3]))
    shot = replace(shot, last_frame=shot.first_frame + 4)
    promised = 1.0
    found = run(replace(shot, quality=shot.quality.with_error(promised)))
    measured = 100.0 * np.array(errors(found, run(fine(shot))))
    assert measured.max() <= promised
    assert found.report["error_promised"] == promised
    assert measured.max() / 3.0 <= found.report["error_estimated"] <= 3.0 * promised


def test_a_bake_takes_an_error_and_reports_it(tmp_path):
    report = tmp_path / "report.json"
    bake(PULL, tmp_path / "p.usdc", frames=(1, 2), report=report)
    told = json.loads(report.read_text())
    assert "error_promised" not in told
    assert 0.0 < told["error_estimated"] < 6.0
    report.unlink()
    bake(PULL, tmp_path / "o.usdc", frames=(1, 2), error=2.0, report=report)
    told = json.loads(report.read_text())
    assert told["error_promised"] == 2.0
    assert 0.0 < told["error_estimated"] < 6.0
    with pytest.raises(InputError, match=r"error: 30\.0; allowed: 0\.01 to 20"):
        bake(PULL, tmp_path / "p.usdc", error=30.0)


def test_a_small_feather_in_a_gust_is_not_lost_in_its_first_step():
    """Out of balance, a step of a whole frame goes to rest, 6.7 % of the length away, without an
    error that would tell."""
    shot = part_of(scene("gust"), np.array([3]))
    shot = replace(shot, last_frame=shot.first_frame + 1)
    loose, exact = (run(at(shot, Setting(tolerance=tolerance))) for tolerance in (0.03, 1e-5))
    assert max(errors(loose, exact)) < 0.02
