"""The gate for promised errors: the same shots for a seed, and a judgement that can fail."""

import numpy as np
import pytest

from featherfx.feather.types import RowPoints
from featherfx.lab.bench import promise
from featherfx.lab.bench.promise import judge, measure_promise, measure_promises, random_shot, run
from featherfx.shot.loop.window_runs import mean_distance

FRAMES, PROMISED = 24, 0.03


def test_a_seed_draws_a_shot():
    first, again = (random_shot(4, ["covert", "down"]) for _ in range(2))
    assert first.inputs == again.inputs
    assert first.inputs != random_shot(5, ["covert", "down"]).inputs
    assert [random_shot(k, ["covert"]).contact is not None for k in range(3)] == [0, 0, 1]


def test_a_bake_that_errs_by_more_than_it_says_breaks_its_promise(monkeypatch):
    found = measure_promises(1, 1, lambda done, total: None)
    assert found["kept"] == 3
    assert {"promised", "reached", "unique_frames"} <= found["cases"][0].keys()
    ways = promise._ways

    def farther(one, other, onto=None):
        return ways(one, other, onto) + (0.2 if onto is None else 0.0)

    monkeypatch.setattr(promise, "_ways", farther)
    assert {each.outcome for each in measure_promise(1, ["covert"])} == {"broken"}


@pytest.mark.parametrize(
    ("reached", "parts", "means", "outcome"),
    [
        (0.02, FRAMES, (0.0, 0.0), "kept"),
        (0.04, FRAMES, (0.0, 0.0), "broken"),
        # a motion that goes its own way after eight frames, and one that was off before
        (0.02, 8, (0.02, 0.02), "kept"),
        (0.04, 8, (0.02, 0.02), "broken"),
        # other means; and such as are known of none
        (0.02, 8, (0.04, 0.02), "broken"),
        (0.02, 8, (0.02, 0.04), "undefined"),
        (0.02, 0, (0.02, 0.04), "undefined"),
    ],
)
def test_poses_are_judged_until_references_part_and_means_from_there_on(
    reached, parts, means, outcome
):
    frames = np.arange(FRAMES)
    own, checked = np.where(frames < parts, reached, 0.3), np.where(frames < parts, 0.01, 0.3)
    found = judge(own, checked, np.array(means), PROMISED)
    assert (found["outcome"], found["unique_frames"]) == (outcome, parts)


def test_means_tell_a_bent_pose_and_a_wider_swing_and_no_phase_or_root_motion():
    still = run(random_shot(0, ["covert"]))
    rest, length = still.points[0][0], float(still.feathers[0].station[-1])
    away = np.linalg.norm(rest.nodes - rest.nodes[0, 0], axis=-1)[..., None] / length
    largest = float(away.max()) ** 2
    turns = 2.0 * np.pi * np.arange(FRAMES) / FRAMES

    def moving(swing, phase, bend=0.0, shift=0.0):
        def pose(turn):
            off = length * away**2 * (bend + swing * np.sin(turn + phase)) * [0.6, 0.0, 0.8]
            return RowPoints(rest.nodes + off + shift * np.sin(turn), rest.directors)

        return still.feathers[0], [pose(turn) for turn in turns]

    base = moving(0.1, 0.0)
    same, bent, wide = moving(0.1, 1.0, shift=0.1), moving(0.1, 1.0, 0.05), moving(0.2, 1.0)
    for other, expected in ((same, 0.0), (bent, 0.05 * largest), (wide, 0.1 * largest / 2**0.5)):
        found = mean_distance(still.feathers[0], base, other) / length
        assert found == pytest.approx(expected, abs=1e-9)
