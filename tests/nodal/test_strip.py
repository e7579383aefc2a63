"""The falling strip: both kinematics, its keys, its bad input, and a chain of links beside it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.lab.ribbons.oracles import link_chain
from featherfx.lab.strip import (
    GRAVITY_ALONG_Z,
    STIFF,
    STRIP_DENSITY,
    STRIP_LENGTH,
    STRIP_THICKNESS,
    StripTest,
    run_strip,
)

ISO = StripTest("iso", 1.0 / 80.0, columns=1)


@pytest.mark.slow
@pytest.mark.verification
def test_isotropic_strip_falls_as_a_chain_of_rigid_links():
    """Without Poisson effect a plate is a rod of EI = E h^3 / 12 per width. 24 links are 2 mm off;
    96 links end at (0.12015, -0.20899) after 0.2 s."""
    held = STRIP_LENGTH / 100
    bending = STIFF * STRIP_THICKNESS**2 / 12.0
    chain = link_chain(
        24,
        STRIP_LENGTH - held,
        bending,
        STRIP_DENSITY,
        -STRIP_DENSITY * GRAVITY_ALONG_Z[2],
        [0.0, 0.1, 0.2],
    )
    ours = run_strip(replace(ISO, dt=1.0 / 640.0), end=0.2).tip
    gap = np.linalg.norm(ours[:, [0, 2]] - chain[1:] - [held, 0.0], axis=1)
    assert gap[0] < 5e-4
    assert gap[1] < 2.5e-3
    assert ours[1, [0, 2]] == pytest.approx([0.12015, -0.20899], abs=1e-3)


@pytest.mark.slow
def test_steps_of_an_eightieth_keep_to_the_tip_within_six_millimetres():
    fine = run_strip(replace(ISO, dt=1.0 / 640.0), end=0.2).tip
    coarse = run_strip(ISO, end=0.2)
    assert coarse.steps == 16
    assert np.linalg.norm(coarse.tip - fine, axis=1).max() < 6e-3
    assert coarse.strain_max < 1e-4


@pytest.mark.slow
def test_both_kinematics_move_the_feather_strip_alike():
    smooth = StripTest("feather", 1.0 / 120.0, "barb-curvature", columns=3)
    first, second = run_strip(smooth, 0.2), run_strip(replace(smooth, kinematics="nodal"), 0.2)
    assert np.linalg.norm(first.tip - second.tip, axis=1).max() < 1e-3
    assert first.tip[1, 2] < -0.03
    assert first.strain_max < 1e-12
    assert 1e-8 < second.strain_max < 1e-4


@pytest.mark.slow
def test_command_gives_its_keys():
    arguments = ("lab", "strip", "--scene", "iso", "--dt", "0.03", "--columns", "1", "--json")
    result = invoke(*arguments)
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    keys = ["time", "tip", "strain_max", "cpu_seconds", "steps", "iterations", "unknowns"]
    assert list(found) == keys
    assert found["time"] == [0.1, 0.2, 0.4]
    assert np.shape(found["tip"]) == (3, 3)
    # 4 + 4 + 7 equal steps, none longer than 0.03 s
    assert found["steps"] == 15


def test_every_wrong_value_is_named():
    wrong = StripTest("iso", 0.0, "barb-curvature", columns=0, radius=2.0, stretch="inextensible")
    with pytest.raises(InputError) as caught:
        run_strip(wrong)
    assert [problem.key for problem in caught.value.problems] == [
        "dt",
        "columns",
        "radius",
        "kinematics",
        "stretch",
    ]
