"""What cannot be simulated is told with feather, frame and reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import SimulationError
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot

SAMPLE = SAMPLES / "feather_pull" / "shot.toml"


def test_a_frame_that_cannot_be_reached_is_named():
    shot = read_shot(SAMPLE)
    grip = replace(shot.grips[0], displacement=np.full(3, np.nan))
    shot = replace(shot, first_frame=1001, last_frame=1010, grips=(grip,))
    with pytest.raises(SimulationError) as caught:
        list(simulate(shot))
    error = caught.value
    assert error.frame == 1002
    assert error.feather == "feather"
    assert str(error).startswith("feather feather at frame 1002 (t = 0 s)")


def test_before_the_first_frame_there_is_no_time():
    text = str(SimulationError("covert", -0.47, "it did not converge", 1001))
    assert text == "feather covert before frame 1001: it did not converge"
