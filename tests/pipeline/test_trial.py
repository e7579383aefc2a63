"""What trials of a few feathers say of a whole bake."""

from dataclasses import replace
from math import inf

import pytest

from featherfx.baking.trial import PUSHING_FRAMES, Trial, _extrapolated, _few, _larger


def sized(pushing, others, frames=3):
    """A trial of so many feathers of 10 unknowns each, without times."""
    count = pushing + others
    work, of_pushing = 10.0 * count, 10.0 * pushing
    return Trial(count, pushing, frames, work, of_pushing, work, count, {}, {})


def timed(trial, push=0.2, other=0.01, once=0.5):
    """With times that feathers take: s of a frame, and once."""
    others = trial.feathers - trial.pushing
    frame = 0.1 + push * trial.pushing + other * others
    told = {
        "simulating": frame * trial.frames_of("simulating"),
        "preroll": 4.0 * frame,
        "building": once + 0.02 * trial.feathers,
    }
    return replace(trial, processor=told)


def trials_of(whole, left=6.0, **times):
    """The two first trials of a shot and the larger ones that follow from them."""
    pushing = _few(whole)
    few = timed(sized(pushing, 12 - pushing), **times)
    return [few, few, *(timed(sized(*size), **times) for size in _larger(few, left, whole))]


@pytest.mark.parametrize(("pushing", "others"), [(52, 665), (300, 0), (0, 400), (2000, 5)])
def test_what_goes_with_feathers_is_found_for_those_that_push_and_the_others(pushing, others):
    whole = sized(pushing, others, 48)
    trials = trials_of(whole)
    for name in ("simulating", "preroll", "building"):
        assert _extrapolated(trials, whole, name) == pytest.approx(timed(whole).of(name))


def test_of_a_shot_that_is_tried_whole_nothing_is_extrapolated():
    whole = timed(sized(2, 3, 2))
    assert _extrapolated([whole], whole, "simulating") == whole.of("simulating")


def test_no_part_is_below_nothing():
    """Where more feathers took no longer, all take as long."""
    whole = sized(52, 665, 48)
    trials = [
        replace(each, processor={"simulating": (0.5 - 1e-4 * k) * each.frames_of("simulating")})
        for k, each in enumerate(trials_of(whole))
    ]
    assert _extrapolated(trials, whole, "simulating") == pytest.approx(0.5, rel=2e-3)


def test_larger_trials_have_more_of_one_kind_and_keep_the_other():
    whole = sized(52, 665, 48)
    few = timed(sized(2, 10))
    others, pushing = _larger(few, 0.0, whole)
    assert (others[0], pushing[1]) == (2, 10)
    assert others[1] >= 60
    assert pushing[0] >= 8
    assert pushing[2] >= PUSHING_FRAMES
    more = _larger(few, inf, whole)
    assert [sum(each) - each[2] for each in more] == [667, 62]


def test_trials_of_few_feathers_have_more_frames():
    few = timed(sized(0, 12))
    assert _larger(few, 0.0, sized(0, 12, 48)) == [(0, 12, 48)]
    ((pushing, others, frames),) = _larger(few, inf, sized(0, 13, 48))
    assert (pushing, others, frames) == (0, 13, 48)
