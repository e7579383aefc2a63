"""The benchmark: its yardstick, its errors, its tables and its files."""

from dataclasses import replace

import numpy as np
import pytest

from featherfx.lab.bench import contact, experiments, report, shake
from featherfx.lab.bench.experiments import factorisation_seconds

COARSE = shake.Shake(rows=9, columns=3, coefficients=1, step=1.0 / 48.0, duration=0.25)
TINY = experiments.Extent(
    grids=((6, 2),),
    coefficients=(1,),
    steps=(24,),
    radii=(0.0, shake.EULER),
    tolerances=(1e-2,),
    reference=replace(COARSE, rows=17, step=1.0 / 192.0, duration=0.5),
    batches=(1, 2),
    duration=1.0 / 24.0,
)


def run(**changes):
    return shake.barb_curvature(shake.swan_primary(), replace(COARSE, **changes))


def test_root_starts_gently_and_reaches_the_amplitude():
    assert shake.shifted(0.0) == 0.0
    assert abs(shake.shifted(1e-3)) < 1e-6
    times = np.linspace(0.0, 1.0, 997)
    assert max(shake.shifted(t) for t in times) == pytest.approx(0.05, rel=1e-3)


def test_error_against_itself_is_nothing_and_grows_with_the_step():
    fine = run(step=1.0 / 3072.0)
    length = shake.swan_primary().length
    assert shake.trajectory_error(fine, fine, length) == 0.0
    steps = (1.0 / 96.0, 1.0 / 384.0)
    errors = [shake.trajectory_error(run(step=step), fine, length) for step in steps]
    assert errors[0] > 2.0 * errors[1] > 0.0


def test_error_sees_a_moved_point():
    fine = run()
    moved = fine.moved.copy()
    moved[1, 4, 0, 2] += 0.01
    assert shake.trajectory_error(replace(fine, moved=moved), fine, 0.5) == pytest.approx(0.02)


def test_equal_feathers_move_equally_on_any_number_of_threads():
    one, many = run(), run(count=3, jobs=2)
    np.testing.assert_array_equal(one.moved, many.moved)
    assert many.steps == one.steps == 12
    assert one.moved.shape == (6, 9, 3, 3)


def test_stiff_kind_changes_only_the_barbs():
    kind = shake.swan_primary()
    stiff = experiments.stiff_kind(kind, 1e6)
    vane = stiff.vane_material
    assert vane.modulus_along_barbs / vane.modulus_across_barbs == pytest.approx(1e6)
    grown = vane.barb_bending_normal / kind.vane_material.barb_bending_normal
    assert grown == pytest.approx(
        1e6 * kind.vane_material.modulus_across_barbs / kind.vane_material.modulus_along_barbs
    )
    assert stiff.rachis_material == kind.rachis_material


@pytest.mark.parametrize("varied", ["stretch", "vane", "barbs"])
def test_every_ratio_is_reached_and_bends_barbs_only_where_said(varied):
    kind = shake.swan_primary()
    vane = experiments.stiff_kind(kind, 1e3, varied).vane_material
    assert vane.modulus_along_barbs / vane.modulus_across_barbs == pytest.approx(1e3)
    assert vane.modulus_across_barbs / vane.shear_modulus == pytest.approx(
        kind.vane_material.modulus_across_barbs / kind.vane_material.shear_modulus
    )
    assert (vane.modulus_along_barbs == kind.vane_material.modulus_along_barbs) == (
        varied == "vane"
    )
    same = vane.barb_bending_normal == kind.vane_material.barb_bending_normal
    assert same == (varied != "barbs")


def test_a_shorter_run_is_compared_as_far_as_it_goes():
    fine = run()
    short = run(duration=0.125)
    assert len(short.moved) == 3
    assert shake.trajectory_error(short, fine, 0.35) == pytest.approx(0.0, abs=1e-9)


def test_factorisation_is_timed():
    assert 1e-4 < factorisation_seconds() < 1.0


def test_front_of_settings():
    pairs = [(1.0, 5.0), (2.0, 6.0), (3.0, 2.0), (3.0, 1.0), (9.0, 1.0)]
    rows = [{"cost": cost, "error": error} for cost, error in pairs]
    assert report.pareto(rows, "cost", "error") == [rows[0], rows[3]]


@pytest.mark.slow
def test_tables_and_files(tmp_path, monkeypatch):
    small = replace(COARSE, duration=1.0 / 24.0)
    for name in ("PRODUCTION", "HERO"):
        monkeypatch.setattr(experiments, name, small)
    made = list(experiments.all_tables(TINY, 2))
    files = report.write(tmp_path / "measured", made, "1.2.3")
    assert {"benchmark.md", "benchmark.json", "front.csv"} <= {file.name for file in files}
    front = (tmp_path / "measured" / "front.csv").read_text().splitlines()
    assert len(front) == 1 + 4
    errors = [row["error"] for table in made if table.name == "front" for row in table.rows]
    assert all(1e-6 < error < 0.1 for error in errors)
    text = (tmp_path / "measured" / "benchmark.md").read_text()
    assert all(table.title in text for table in made)
    assert report.machine("1.2.3")["date"] in text


def test_ways_to_solve_contact_agree_and_shared_springs_need_few_rounds():
    (table,) = contact.contact_tables(((2, 20), (3, 20)))
    assert all(row["error"] < 0.01 for row in table.rows)
    ways = len(table.rows) // 2
    for rows in (table.rows[:ways], table.rows[ways:]):
        single, shared, mixed, krylov, joint = (row["rounds"] for row in rows)
        assert joint == 1 < max(mixed, krylov) <= shared < 0.2 * single
        assert rows[-1]["error"] < 1e-9


def test_a_stack_bends_as_one_cantilever():
    """The tip of a cantilever of unit stiffness under unit load droops by an eighth."""
    stack = contact.Stack(3, 200, True)
    assert 3.0 * stack.exact == pytest.approx(0.125, rel=0.01)
    np.testing.assert_allclose(stack.joint(), np.tile(stack.joint()[0], (3, 1)), rtol=1e-9)
