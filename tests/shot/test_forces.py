"""Dead forces of shots: what reaches the feather, when, and how wrong ones are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import LEADING, barb_slice
from featherfx.shot.loads import force_at, force_weights, frame_loads, hat_integrals
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.patterns import Force
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Shot

SAMPLE = SAMPLES / "feather_pull" / "shot.toml"


def shot_with(text: str, tmp_path: Path) -> Shot:
    groom = (SAMPLE.parent / "groom.toml").read_text()
    (tmp_path / "groom.toml").write_text(groom)
    base = 'name = "t"\ngroom = "groom.toml"\nframes = [1, 3]\nquality = "draft"\nwind = "calm"\n'
    (tmp_path / "shot.toml").write_text(base + text)
    return read_shot(tmp_path / "shot.toml")


def a_force(**values: object) -> Force:
    given = {
        "feather": "feather",
        "force": np.array([0.0, 0.0, 1.0]),
        "line": "point",
        "row": 0.5,
        "column": 0.0,
        "side": "leading",
        "span": (0.0, 1.0),
        "keys": (),
    }
    return Force(**given | values)  # type: ignore[arg-type]


def feather(rows: int = 13, columns: int = 4):
    shot = read_shot(SAMPLE)
    return build_feather(shot.groom.feathers[0].kind, rows, columns)


@pytest.mark.parametrize("row", [0.0, 0.31, 0.5, 0.77, 1.0])
def test_a_point_force_is_whole_and_where_it_is_meant(row: float) -> None:
    kind = feather()
    weights = force_weights(a_force(row=row), kind)
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    assert not weights[:, 1:].any()
    assert weights[:, 0] @ kind.station == pytest.approx(row * kind.station[-1], rel=1e-12)


def test_a_point_of_a_barb_is_between_its_rows_and_nodes() -> None:
    kind = feather()
    weights = force_weights(a_force(row=0.5, column=0.6, side="trailing"), kind)
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    assert not weights[:, barb_slice(LEADING, kind.columns)].any()
    place = np.einsum("np,npk->k", weights, kind.rest.nodes)
    # the same point of a grid eight times as fine
    fine = feather(97, 32)
    exact = np.einsum(
        "np,npk->k",
        force_weights(a_force(row=0.5, column=0.6, side="trailing"), fine),
        fine.rest.nodes,
    )
    assert np.linalg.norm(place - exact) < 0.02 * kind.barb_length.max()


@pytest.mark.parametrize("span", [(0.0, 1.0), (0.2, 0.75)])
def test_lines_have_their_length_and_centre(span: tuple[float, float]) -> None:
    kind = feather()
    along = force_weights(a_force(line="rachis", span=span), kind)
    size = kind.station[-1]
    assert along.sum() == pytest.approx((span[1] - span[0]) * size, rel=1e-12)
    middle = along[:, 0] @ kind.station / along.sum()
    assert middle == pytest.approx(0.5 * (span[0] + span[1]) * size, rel=1e-12)
    barb = force_weights(a_force(line="barb", row=6 / 12, span=span), kind)
    place = kind.station / size
    reach = np.interp(0.5, place, kind.barb_length[0])
    assert barb.sum() == pytest.approx((span[1] - span[0]) * reach, rel=1e-12)


def test_integrals_of_hats_are_those_of_a_fine_sum() -> None:
    knots = np.array([0.0, 0.1, 0.4, 1.0])
    places = np.linspace(0.05, 0.7, 400_001)
    sums = [np.trapezoid(np.interp(places, knots, hat), places) for hat in np.eye(4)]
    assert hat_integrals(knots, 0.05, 0.7) == pytest.approx(sums, abs=1e-9)


def test_keys_are_linear_and_constant_outside() -> None:
    force = a_force(keys=((1.0, 0.0), (2.0, 2.0), (4.0, 1.0)))
    factors = [force_at(force, time)[2] for time in (0.0, 1.0, 1.5, 2.0, 3.0, 9.0)]
    assert factors == pytest.approx([0.0, 0.0, 1.0, 2.0, 1.5, 1.0])
    assert force_at(a_force(), 3.0)[2] == 1.0


def test_loads_pass_from_one_frame_to_the_next_without_a_jump() -> None:
    shot = read_shot(SAMPLE)
    kind = feather()
    force = a_force(keys=((0.1, 0.0), (0.5, 1.0)))
    triple = [(0, force, force_weights(force, kind))]
    first, second = (
        frame_loads(shot, [], [kind], [kind.rest.nodes], start, start + 0.04, None, triple)
        for start in (0.2, 0.24)
    )
    assert (first.force + first.force_change).sum() == pytest.approx(second.force.sum())
    assert first.force_change.sum() == pytest.approx(0.1)


def test_a_shot_hangs_in_balance_with_its_force(tmp_path: Path) -> None:
    """A force of twice the opposite weight: the feather is bent up, and stays there."""
    text = '[[force]]\nfeather = "feather"\nforce = [0, 0, 0.05]\nrow = 0.9\n'
    with_force, without = shot_with(text, tmp_path), shot_with("", tmp_path)
    pulled = [frame.rows[0] for frame in simulate(with_force)]
    plain = [frame.rows[0] for frame in simulate(without)]
    assert pulled[0][-1, 0, 2] > plain[0][-1, 0, 2] + 0.01
    assert np.abs(pulled[-1] - pulled[0]).max() < 1e-5


def test_wrong_forces_are_all_told(tmp_path: Path) -> None:
    text = (
        '[[force]]\nfeather = "nobody"\nforce = [0, 0, 1]\n'
        '[[force]]\nfeather = "feather"\nforce = [0, 0]\nline = "edge"\n'
        '[[force]]\nfeather = "feather"\nforce = [0, 0, 1]\nspan = [0.5, 0.5]\n'
        '[[force]]\nfeather = "feather"\nforce = [0, 0, 1]\nkeys = [[1, 0], [1, 2]]\n'
    )
    with pytest.raises(InputError) as caught:
        shot_with(text, tmp_path)
    keys = [problem.key for problem in caught.value.problems]
    assert sorted(keys) == [
        "force[0].feather",
        "force[1].force",
        "force[1].line",
        "force[2].span",
        "force[3].keys[1]",
    ]


def test_a_barb_that_does_not_grow_is_told(tmp_path: Path) -> None:
    text = '[[force]]\nfeather = "feather"\nforce = [0, 0, 1]\nrow = 0.01\ncolumn = 1.0\n'
    shot = shot_with(text, tmp_path)
    with pytest.raises(InputError, match=r"no leading barb grows at row = 0.01 .*Give 0\.\d+"):
        list(simulate(shot))


def test_wind_of_a_scene_acts_on_each_feather_by_its_own_place() -> None:
    class Shear:
        def velocity(self, points: np.ndarray, time: float) -> np.ndarray:
            return np.stack([points[:, 1], 0.0 * points[:, 1], 2.0 * points[:, 0]], axis=1)

    shot = replace(read_shot(SAMPLE), wind_source=Shear())
    kind = feather()
    roots = np.array([[1.0, 2.0, 0.0], [3.0, -1.0, 0.0]])
    loads = frame_loads(shot, [], [kind, kind], [kind.rest.nodes] * 2, 0.0, 0.04, roots)
    assert loads.wind_mean == pytest.approx(np.array([[2.0, 0, 2], [-1.0, 0, 6]]))
    # (u . grad) u
    assert loads.wind_change == pytest.approx(np.array([[0, 0, 4.0], [0, 0, -2.0]]))
