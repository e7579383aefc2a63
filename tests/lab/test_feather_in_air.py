"""Modes of feathers in air beside strip theory, and the force of a stream beside its law."""

import numpy as np
import pytest
from trial_batches import preset_kind

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.lab.feather import (
    FallTest,
    StreamTest,
    find_feather_modes,
    measure_fall,
    measure_stream,
    stream_coefficients,
)
from featherfx.mechanics.batch import make_model

AIR = 1.225


def test_air_lowers_frequencies_and_leaves_decrements():
    """Materials of both parts lose 0.1 at every frequency: pi times that a period."""
    for kind in ("primary", "tail_feather"):
        vacuum, air = (find_feather_modes(kind, 3, in_air=each) for each in (False, True))
        for found in (vacuum, air):
            assert found.decrements == pytest.approx(0.1 * np.pi, abs=0.03)
        assert air.frequencies[0] < 0.8 * vacuum.frequencies[0]
        assert np.all(air.frequencies < vacuum.frequencies)


def test_a_stream_presses_on_a_flight_feather_as_on_a_plate():
    """Helmbold's slope at 10 degrees, Lindenburg's plates (node_kernels) from 30 on, of aspect 7.
    Half of the two sides' difference: camber adds alike."""
    turn, aspect, angles = np.radians([30.0, 60.0, 90.0]), 7.4, "10,30,60,90,-10,-30,-60,-90"
    found = measure_stream(StreamTest("swan_primary", angles, 10.0))
    slope = 2.0 * np.pi * aspect / (2.0 + np.sqrt(aspect**2 + 4.0))
    sine, finite = np.sin(turn), 0.41 * (1.0 - np.exp(-17.0 / aspect))
    plate = 1.98 * sine * (1.0 / (0.56 + 0.44 * sine) - finite)
    expected = [slope * np.radians(10.0), *plate]
    assert 0.5 * (found.cn[:4] - found.cn[4:]) == pytest.approx(expected, rel=0.1)
    slow = measure_stream(StreamTest("swan_primary", angles, 0.1))
    assert slow.cn == pytest.approx(found.cn, rel=1e-9)
    loose = measure_stream(StreamTest("semiplume", "30,90", 10.0)).cn
    assert loose[0] == pytest.approx(0.25 * loose[1], abs=0.06)


@pytest.mark.parametrize("name", ["down", "contour", "semiplume"])
def test_a_light_feather_falls_at_the_balance_of_weight_and_drag(name):
    """m g = 1/2 rho v^2 S c, c of a stream from below onto the whole feather at rest."""
    kind = preset_kind(name)
    model = make_model([build_feather(kind, 21, 4)], [kind], 1)
    cells = model.cell_rest[0][model.cell_rest[0][..., 0] > 0.0]
    area = np.sum(0.5 / (cells[:, 0] * cells[:, 2]))
    drag = stream_coefficients(model, np.array([0.0, 0.0, 1.0]))[2]
    terminal = np.sqrt(2.0 * model.mass.sum() * 9.81 / (AIR * area * drag))
    found = measure_fall(FallTest(name, 3.0))
    assert found.slowest <= found.speed <= found.fastest
    # a steady glide, not the length of its way
    assert 0.0 < found.drift < 1.4 * found.speed
    # no pose meets more air than this one; one that tilts falls faster
    assert 0.95 < found.speed / terminal < 1.2
    # across its vane it is no faster, however it glides
    assert found.across == pytest.approx(terminal, rel=0.08)


def test_a_fall_of_no_time_is_refused():
    with pytest.raises(InputError, match="duration: 0 is not allowed"):
        measure_fall(FallTest("down", 0.0))


@pytest.mark.parametrize(
    ("test", "word"),
    [
        (StreamTest("swan_primary", "5,x"), "angles: 5,x"),
        (StreamTest("swan_primary", "500"), "angles: 500"),
        (StreamTest("swan_primary", "5", -1.0), "speed: -1"),
        (StreamTest("swan_vane", "5"), "swan_vane"),
    ],
)
def test_wrong_values_are_named(test, word):
    with pytest.raises(InputError, match=word):
        measure_stream(test)
