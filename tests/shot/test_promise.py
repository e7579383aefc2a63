"""Errors that are asked for: what is simulated for them, and whether they are kept."""

import json
from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.api import read_quality
from featherfx.baking.pipeline import bake
from featherfx.errors import InputError
from featherfx.feather.placed_feathers import build_feathers
from featherfx.groom.keys.preset import Quality
from featherfx.lab.bench.front import Setting, at, errors, fine, run
from featherfx.lab.bench.scenes import scene
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options.error_model import (
    Deflection,
    choose_for_error,
    error_model,
    planned_error,
    stepped_down,
)
from featherfx.shot.options.load_estimate import estimate_deflections, estimate_loads
from featherfx.shot.options.options import common_tolerance, resolve_options, simulation_quality
from featherfx.shot.read.read import read_shot
from featherfx.shot.subset import part_of

PULL = SAMPLES / "feather_pull/shot.toml"


def work(chosen):
    *grid, tolerance = chosen
    known = error_model()
    return known.work.by(grid) * tolerance**-known.work.steps


def full_options(shot):
    """Options of all feathers of a shot in full detail."""
    return resolve_options(shot, build_feathers(shot.groom.feathers, 11, 4), root_motion(shot)).full


def test_less_error_and_softer_feathers_take_more_work():
    for shaft, barb in ((1e-3, 1e-3), (0.05, 0.02), (0.1, 0.05)):
        bends = Deflection(shaft, barb, 0.0)
        taken = [work(choose_for_error(error, bends)) for error in (0.04, 0.02, 0.01, 0.005)]
        assert taken == sorted(taken)
        assert taken[-1] > 2.0 * taken[0]
    assert work(choose_for_error(0.01, Deflection(0.5, 0.1, 0.0))) > work(
        choose_for_error(0.01, Deflection(0.01, 0.01, 0.0))
    )


def test_what_is_chosen_is_expected_to_keep_the_error():
    known = error_model()
    for error, shaft, air in ((0.02, 0.03, 0.0), (0.01, 0.03, 0.4), (0.005, 0.1, 0.8)):
        bends = Deflection(shaft, 0.02, air)
        chosen = choose_for_error(error, bends)
        space = known.before.by(chosen[:3], 0.02)
        assert not known.calms(bends)
        assert np.hypot(space, known.steps.by(chosen[3], air)) <= 1.001 * planned_error(error)


def test_barbs_that_are_bent_as_far_as_they_are_long_take_more_rows_the_harder_the_wind_blows():
    def rows(name):
        shot = scene(name)
        shot = replace(shot, quality=shot.quality.with_error(0.5))
        feathers = build_feathers(shot.groom.feathers, 11, 4)
        bent = estimate_deflections(shot, feathers, estimate_loads(shot, root_motion(shot)))
        assert bent[0].barb > feathers[0].barb_length.max()
        return full_options(shot)[0].rows

    assert rows("strong gust") > rows("gust")


def test_rows_miss_as_much_as_what_a_stiff_feather_misses_at_least():
    law = error_model().before.rows
    assert law.by(8, 0.0) == law.by(8, law.least) > 0.0
    assert law.by(8, 2.0 * law.least) > law.by(8, law.least)


def test_calm_feathers_take_less_and_the_less_they_bend_the_less_rows_miss():
    """Damped by air, and bent by less than any of the scenes in air."""
    known = error_model()
    calm = Deflection(0.9 * known.calm[0], 0.5 * known.calm[1], 0.6)
    assert known.calms(calm)
    lively = [
        calm._replace(air=0.4),
        calm._replace(wrung=True),
        calm._replace(rachis=1.1 * known.calm[0]),
        calm._replace(barb=1.1 * known.calm[1]),
    ]
    for bends in lively:
        assert not known.calms(bends)
        assert work(choose_for_error(0.005, bends)) > 1.3 * work(choose_for_error(0.005, calm))
    rows = [known.expected(calm._replace(rachis=d)).rows.by(8, d) for d in (0.01, 0.02, 0.04)]
    assert rows[1:] == pytest.approx([2.0 * rows[0], 4.0 * rows[0]])


def test_air_takes_longer_steps_and_wrung_vanes_more_rows():
    """Air takes from vibrations what steps erred; a vane that is pulled in its plane may buckle."""
    still, blown = (choose_for_error(0.02, Deflection(0.1, 0.01, air)) for air in (0.0, 0.8))
    assert blown[3] > 1.5 * still[3]
    assert (
        choose_for_error(0.01, Deflection(0.1, 0.01, 0.0, True))[0]
        > 2 * choose_for_error(0.01, Deflection(0.1, 0.01, 0.0))[0]
    )
    shot = read_shot(PULL)
    loads = estimate_loads(shot, root_motion(shot))

    def wrung(way):
        grip = replace(shot.grips[0], displacement=shot.groom.feathers[0].rotation @ way)
        return estimate_deflections(
            replace(shot, grips=(grip,)), build_feathers(shot.groom.feathers, 11, 4), loads
        )[0].wrung

    assert wrung(np.array([0.0, 0.05, 0.0]))
    assert not wrung(np.array([-0.01, 0.01, 0.05]))


def test_presets_promise_errors_and_have_numbers_where_feathers_push_each_other():
    shot = scene("contact")
    alone = replace(shot, contact=None)
    for name, error, tolerance in (
        ("draft", 0.03, 1e-3),
        ("preview", 0.015, 1.5e-4),
        ("final", 0.005, 2e-5),
    ):
        quality = read_quality(name)
        held = simulation_quality(replace(shot, quality=quality))
        assert held.promised is None
        assert held.tolerance == tolerance == common_tolerance(replace(shot, quality=quality))
        assert simulation_quality(replace(alone, quality=quality)).promised == pytest.approx(error)
        assert replace(quality, tolerance=1e-6).pushing.tolerance == 1e-6
        assert quality.with_error(1.0).pushing.promised == 0.01


def test_rows_and_columns_that_are_asked_for_overrule_the_error():
    shot = scene("gust")
    quality = replace(read_quality("draft"), simulated_rows=7, simulated_columns=3)
    shot = replace(shot, quality=quality)
    for own in full_options(shot):
        assert (own.rows, own.columns, own.coefficients) == (7, 3, 1)


def test_more_rows_columns_and_coefficients_miss_less_and_cost_more():
    known = error_model()
    for law in (*known.before, *known.after):
        assert law.factor > 0.0
        assert law.order >= 1.0
        assert 0.0 <= law.exponent <= 1.0
    assert known.wrung.by(11, 0.3) > known.before.rows.by(11, 0.3)
    assert known.work.by((8, 2, 1)) < known.work.by((8, 4, 1)) < known.work.by((8, 4, 2))
    assert known.work.by((8, 2, 1)) < known.work.by((11, 2, 1))


def test_tolerances_are_stepped_down_by_less_than_a_third():
    for tolerance in (1e-5, 3.3e-5, 1e-3):
        assert 0.7 * tolerance < stepped_down(tolerance) <= tolerance


def test_one_tolerance_for_all_is_at_most_a_part_of_each_length():
    shot = scene("gust")
    draft = Quality(name="draft", tolerance=1e-3, coefficients=1)
    lengths = np.array([placement.kind.length for placement in shot.groom.feathers])

    def tolerances(shot):
        return np.array([each.tolerance for each in full_options(replace(shot, quality=draft))])

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


def test_no_error_is_promised_where_feathers_push_each_other_or_none_is_asked_for():
    """Neither where a preset has numbers for that, nor where an error is asked for in words."""
    alone, contact = read_shot(PULL), scene("contact").contact
    asked = replace(alone, quality=alone.quality.with_error(0.8))
    numbers = replace(alone, quality=Quality(name="q", tolerance=1e-4))

    def promise(shot):
        feathers = build_feathers(shot.groom.feathers, 11, 4)
        options = resolve_options(shot, feathers, root_motion(shot))
        return options.promised_error, options.why_not_promised

    assert promise(asked) == (pytest.approx(0.008), "")
    for shot in (alone, asked):
        error, why = promise(replace(shot, contact=contact))
        assert error is None
        assert "push each other" in why
    error, why = promise(numbers)
    assert error is None
    assert "a tolerance and no error" in why


def test_what_concerns_all_feathers_has_a_tolerance_either_way():
    shot = replace(read_shot(PULL), quality=Quality(name="q", tolerance=3e-4))
    assert common_tolerance(shot) == 3e-4
    assert 1e-7 < common_tolerance(replace(shot, quality=Quality(name="q", error=1.0))) < 1e-2


def test_what_was_measured_is_in_the_order_of_the_feathers_however_they_are_batched():
    shot = replace(scene("shake in vacuum"), last_frame=2)
    order = [2, 0, 3, 1]
    feathers = tuple(shot.groom.feathers[k] for k in order) + shot.groom.feathers
    shot = replace(shot, groom=replace(shot.groom, feathers=feathers))
    found = run(at(shot, Setting(6, 2, 1, 6e-3)))
    lengths = [each.station[-1] for each in found.feathers.values()]
    assert lengths == pytest.approx([each.kind.length for each in feathers])


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
    assert told["error_promised"] == 1.5
    assert 0.0 < told["error_estimated"] < 6.0
    report.unlink()
    bake(PULL, tmp_path / "o.usdc", frames=(1, 2), error=2.0, report=report)
    told = json.loads(report.read_text())
    assert told["error_promised"] == 2.0
    assert 0.0 < told["error_estimated"] < 6.0
    with pytest.raises(InputError, match=r"error: 30\.0 is not allowed. Give 0\.01 to 20"):
        bake(PULL, tmp_path / "p.usdc", error=30.0)


def test_a_small_feather_in_a_gust_is_not_lost_in_its_first_step():
    """Out of balance, a step of a whole frame goes to rest, 6.7 % of the length away, without an
    error that would tell."""
    shot = part_of(scene("gust"), np.array([3]))
    shot = replace(shot, last_frame=shot.first_frame + 1)
    loose, exact = (run(at(shot, Setting(tolerance=tolerance))) for tolerance in (0.03, 1e-5))
    assert max(errors(loose, exact)) < 0.02
