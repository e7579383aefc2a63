"""Kernels that workers compile ahead are those that works call, for the types that they give."""

import json

import numpy as np
import pytest
from places import SAMPLES

import featherfx
from featherfx.jit.compiled import ARGUMENTS, kernel_entry
from featherfx.jit.kernel_calls import TupleKind, describe_arguments, make_arguments
from featherfx.mechanics.model import no_loads
from featherfx.shot.loads import frame_loads

EXPECTED = json.loads(ARGUMENTS.read_text())
ANEW = "Write them anew: featherfx lab measure calls"
SHOTS = {"bake": "swan_wing", "contact": "flapping_bird", "bird": "pigeon"}


@pytest.mark.parametrize(
    "work", [*list(SHOTS)[:2], pytest.param("bird", marks=pytest.mark.nightly)]
)
def test_a_bake_calls_what_is_expected_of_it(tmp_path, work):
    shot = SAMPLES / SHOTS[work] / "shot.toml"
    featherfx.bake(shot, tmp_path / "o.usdc", frames=(1, 2), quality="draft", jobs=2)
    missing = {n for n, text in EXPECTED[work].items() if not kernel_entry(n).is_there(text)}
    assert missing == set(), ANEW


@pytest.mark.parametrize("name", ["swan_wing", "breeze"])
def test_loads_of_a_shot_have_the_types_that_are_compiled_ahead(name):
    shot = featherfx.read_shot(SAMPLES / name / "shot.toml")
    loads = frame_loads(shot, (), (), (), 0.0, 0.04)
    assert describe_arguments((loads,)) == describe_arguments((no_loads(0),))


def test_arguments_made_of_a_text_have_its_types():
    frozen = np.zeros(3)
    frozen.flags.writeable = False
    loads = no_loads(1)
    arrays = np.zeros((3, 4))[:, ::2], np.zeros((2, 3), order="F"), np.zeros(2, np.float32), frozen
    given = (loads, *arrays, np.float32(1.0), 1, True, None, (1.0, (2,)), TupleKind(loads))
    text = describe_arguments(given)
    assert describe_arguments(make_arguments(text)) == text
    with pytest.raises(AttributeError):
        make_arguments(text.replace(":Loads", ":no_such"))


def test_every_expected_text_is_one():
    for kernels in EXPECTED.values():
        for text in kernels.values():
            assert describe_arguments(make_arguments(text)) == text, ANEW
