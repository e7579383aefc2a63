"""samples/torn_feather: a post splits a vane in three places, two strokes preen it shut."""

from __future__ import annotations

import numpy as np
import pytest
from places import SAMPLES
from split_vanes import compliance

from featherfx import read_shot
from featherfx.feather.placed_feathers import build_feathers
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Gaps
from featherfx.shot.loop.simulate import simulate

SHOT = read_shot(SAMPLES / "torn_feather/shot.toml")
TORN, TRAILING = 48, 1

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run():
    """Gaps when it is torn and at the end, the report, and the simulated feather."""
    simulation, found = simulate(SHOT), []
    for frame in simulation:
        if frame.number in (TORN, SHOT.last_frame):
            own = simulation.checkpoint().states[0].gaps_of(0)
            found.append(Gaps(*(array.copy() for array in own)))
    return *found, simulation.report["hooks"]


def test_it_splits_in_three_places_from_the_edge(run):
    """Strips that are open over three of their six cells or more; the post opens single cells
    beside them."""
    torn = run[0].hooked == 0.0
    assert not torn[0].any()
    whole_cells = torn[TRAILING].all(axis=2)
    splits = np.flatnonzero(whole_cells.sum(axis=1) > 2)
    assert len(splits) == 3
    assert (np.diff(splits) > 1).all()
    for row in splits:
        cells = whole_cells[row]
        first = int(np.argmax(cells))
        assert cells[-1]
        assert cells[first:].all()


def test_opened_length_is_that_of_the_splits_and_all_of_it_heals(run):
    torn, preened, report = run
    (feather,) = build_feathers(SHOT.groom.feathers[:1], SHOT.quality.rows, SHOT.quality.columns)
    half = 0.5 * feather.barb_length / feather.columns
    own = np.stack([half[:, :-1], half[:, 1:]], axis=-1)[:, :, None]
    length = float((own * (torn.hooked == 0.0)).sum())
    assert length > 0.02
    assert report["opened"] == pytest.approx(length, rel=1e-9)
    assert report["healed"] == pytest.approx(length, rel=1e-9)
    assert (preened.hooked == 1.0).all()


def test_energies_of_the_splits_are_those_of_the_law(run):
    """Per length half of thickness, strength and release; strengths scatter by 5 %."""
    report, vane = run[2], SHOT.groom.feathers[0].kind.vane_material
    per_length = 0.5 * vane.thickness * vane.hook_strength * vane.hook_release
    assert report["opening_work"] / report["opened"] == pytest.approx(per_length, rel=0.1)
    # cells that stand for many barbs hold more than that and let it go
    assert report["released_energy"] > report["opening_work"]
    assert report["slip_work"] > 0.0


def test_a_preened_vane_is_as_stiff_as_before(run):
    """Within 2 %, at the end of the barb above the first split; torn it was softer."""
    torn, preened, _ = run
    placement, quality = SHOT.groom.feathers[0], SHOT.quality
    (feather,) = build_feathers([placement], quality.rows, quality.columns)
    model = make_model([feather], [placement.kind], 2)
    row = int(np.flatnonzero((torn.hooked == 0.0)[TRAILING].any(axis=(1, 2)))[0]) + 1
    whole = Gaps(*(np.zeros_like(array) for array in torn))
    whole.level[:], whole.hooked[:] = 1.0, 1.0
    before, open_, after = (
        compliance(model, gaps, row, 2 * quality.columns, 0.005) for gaps in (whole, torn, preened)
    )
    assert open_ > 1.1 * before
    assert after == pytest.approx(before, rel=0.02)
