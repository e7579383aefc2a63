"""What bakes of a part of a shot say of the whole bake."""

import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from featherfx.api import read_shot
from featherfx.baking import trial_feathers
from featherfx.baking.stats import stats
from featherfx.baking.trial import _FEW, _MORE, Trial, TrialCourse, _larger, _memory, _whole
from featherfx.baking.trial_feathers import _whole_groups, pick_feathers
from featherfx.errors import InputError
from featherfx.files.disk_cache import nothing_kept
from featherfx.jit.compile_workers import PROGRESS, working_time

SAMPLES = Path(__file__).parents[2] / "samples"


def trial(feathers, each=0.02, fixed=1.0, frame=0.01, work=None):
    """Of so many feathers, with s that all of them take once and in a frame."""
    once = {"building": fixed / 2, "settling": fixed / 2 + each * feathers, "simulating": 0.0}
    pairs = {name: np.array([seconds, seconds]) for name, seconds in once.items()}
    own = np.full(2, frame * feathers)
    return Trial(feathers, 6, work or 10.0 * feathers, pairs, own, 1e6 * (30 + feathers))


def test_a_trial_is_as_large_as_its_time_allows():
    few, more = trial(_FEW), trial(_MORE)
    assert _larger([few, few], 15.0, 2000) == _MORE
    assert _larger([few, few], 15.0, 40) == 40
    assert _larger([few, few], 2.0, 2000) == pytest.approx(2 * _FEW, rel=0.1)
    # 0.07 s a feather and 1 s
    assert _larger([few, more], 21.0, 2000) == pytest.approx(285, abs=1)
    assert _larger([few, more], 200.0, 2000) == 2000
    assert _larger([few, more], 9.0, 2000) is None


@pytest.mark.parametrize("fixed", [0.0, 0.05, 0.4])
def test_what_goes_with_iterations_gets_dearer_with_them(fixed):
    """Of a frame of 10 feathers and of 1,000: a part that goes with none, and 1 ms for each."""
    rng = np.random.default_rng(3)
    iterations = np.concatenate([rng.uniform(20, 30, 5), rng.uniform(20, 90, 60)])
    course = TrialCourse(iterations, 0.04 + 1e-3 * iterations, work=100.0)
    seconds = fixed + 0.1 * iterations
    tried = replace(trial(1000), frame=np.full(2, seconds[:5].mean()), work=1e4)
    assert course.harder(tried) == pytest.approx(seconds.mean() / seconds[:5].mean())


def test_frames_that_are_alike_are_not_harder():
    course = TrialCourse(np.full(20, 7.0), np.full(20, 0.1), work=100.0)
    assert course.harder(trial(1000)) == 1.0


@pytest.mark.parametrize("each", [0.01, 0.04])
def test_feathers_that_hold_each_other_up_take_what_they_take_together(each):
    """Of 1,000 unknowns 400 are tried together, and the others go as in a trial of a few."""
    course = TrialCourse(np.full(20, 7.0), np.full(20, 400.0 * each), work=400.0)
    tried = replace(trial(100), frame=np.full(2, 0.01 * 100.0), work=100.0)
    of_all = 400.0 * each + 600.0 * 0.01
    assert course.denser(tried, 1000.0) == pytest.approx(of_all / (1000.0 * 0.01))


def test_of_feathers_that_push_the_course_counts():
    touching = read_shot(SAMPLES / "flapping_bird" / "shot.toml")
    few = replace(trial(4), work=200.0)
    course = TrialCourse(np.full(20, 7.0), np.full(20, 10.0), work=400.0)
    alone = replace(touching, contact=None)
    found, free = (
        _whole(each, 2000.0, [few, few], course)["simulating"][1] for each in (touching, alone)
    )
    frames = touching.last_frame - touching.first_frame
    assert found > 10.0 * frames > free


def test_of_a_shot_that_is_tried_whole_frames_are_added():
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    own = trial(len(shot.groom.feathers))
    of_all = _whole(shot, own.work, [own, own], None)
    assert of_all["settling"] == pytest.approx(own.once["settling"])
    assert of_all["simulating"] == pytest.approx(own.frame * (shot.last_frame - shot.first_frame))


def test_what_every_process_loads_comes_once():
    shot = read_shot(SAMPLES / "swan_wing" / "shot.toml")
    few = trial(2, work=1.0)
    cold = replace(few, once=few.once | {"settling": few.once["settling"] + 3.0})
    warm, loaded = (_whole(shot, few.work, [first, few], None)["settling"] for first in (few, cold))
    assert loaded - warm == pytest.approx(3.0)


def test_memory_goes_with_the_feathers():
    assert _memory([trial(12), trial(12), trial(96)], 2000) == pytest.approx(1e6 * (30 + 2000))


def test_each_region_has_its_share_of_a_trial_and_neighbours_stay_together():
    shot = read_shot(SAMPLES / "pigeon" / "full.toml")
    feathers = shot.groom.feathers
    chosen = pick_feathers(shot, 100)
    regions = [each.region for each in feathers]
    for region in set(regions):
        own = [f for f, name in enumerate(regions) if name == region]
        share = 100 / len(feathers) * len(own)
        assert abs(np.isin(own, chosen).sum() - max(share, 1)) <= 0.5
    roots = np.array([each.position for each in feathers])

    def nearest(numbers):
        return np.median(cKDTree(roots[numbers]).query(roots[numbers], k=2)[0][:, 1])

    everyone = np.arange(len(feathers))
    assert nearest(chosen) < 2.0 * nearest(everyone)
    assert pick_feathers(shot, len(feathers)).tolist() == everyone.tolist()


def test_contact_groups_are_tried_whole(monkeypatch):
    sizes = [3, 4, 2, 3, 4, 2, 3, 30]
    group = np.repeat(np.arange(len(sizes)), sizes)
    monkeypatch.setattr(trial_feathers, "shot_islands", lambda shot: group)
    for count in (4, 5, 12, 20):
        chosen = _whole_groups(None, np.arange(len(group)), count)
        assert count <= len(chosen) < count + max(sizes[:-1])
        for number in set(group[chosen]):
            assert np.isin(np.flatnonzero(group == number), chosen).all()
    # none is small enough, and 21 are in all that are
    for count in (1, 25):
        assert len(_whole_groups(None, np.arange(len(group)), count)) == 0


@pytest.mark.nightly
def test_the_time_for_trials_holds():
    """A quarter of what the trials take: some are left out, or stopped, and the range is wider."""
    shot = SAMPLES / "breeze" / "shot.toml"
    begin = working_time()
    cost = stats(shot, budget=60.0)["bake"]
    spent = working_time() - begin
    begin = working_time()
    least = stats(shot, budget=0.4 * spent)["bake"]
    assert working_time() - begin < 0.6 * spent + 0.5
    for each in (cost, least):
        for key in ("wall_seconds", "processor_seconds"):
            assert each["low"][key] < each[key] < each["high"][key]


@pytest.mark.nightly
@pytest.mark.parametrize("is_cached", [True, False])
@pytest.mark.parametrize("sample", ["pigeon/shot", "pigeon/contact", "owl_flight/shot"])
def test_the_time_holds_for_whole_birds(sample, is_cached):
    shot = read_shot(SAMPLES / f"{sample}.toml")
    begin = working_time()
    with nullcontext() if is_cached else nothing_kept():
        cost = stats(shot, budget=15.0)["bake"]
    assert working_time() - begin < 1.5 * 15.0
    assert cost["low"]["processor_seconds"] < cost["high"]["processor_seconds"]


def test_compiling_takes_no_time_of_the_trials():
    begin, spent = working_time(), time.process_time()
    with PROGRESS.compiling("featherfx.kernel_that_takes_long"):
        while time.process_time() - spent < 0.2:
            pass
    assert working_time() - begin < 0.1


def test_no_time_for_any_trial_is_told():
    with pytest.raises(InputError, match=r"--seconds: is over before two frames .* Give more"):
        stats(SAMPLES / "breeze" / "shot.toml", budget=0.01)
