"""A wing that folds onto the coat of a body, far from which it is at rest."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from shingled import in_line, least_gap

from featherfx.algebra.vectors import from_rotation_vector
from featherfx.errors import InputWarning
from featherfx.groom.types import Joint
from featherfx.shot.frames import Frame
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.patterns import Detail
from featherfx.shot.types import Contact, Motion, Shot

THICKNESS = 5e-4
SHOULDER, UPWARDS = np.array([[0.0, -0.2, 0.0], [0.0, 0.0, 1.0]])
UP = from_rotation_vector(np.array([0.5 * np.pi, 0.0, 0.0]))
# the coat stands up from the body, into where the wing comes to lie
TILT = from_rotation_vector(np.array([0.0, -0.08, 0.0]))
# feathers on either, and metres from each to the next; how far the wing's tips end within the
# coat's vanes, since a tip that bounces on another may come down beside it
COUNT, APART, BEHIND = 3, 0.02, 5e-3


def folding(height: float, coat: str = "full") -> Shot:
    """A wing of three feathers that comes down by 90 degrees onto three on a body within 0.25 s,
    roots above theirs by a height (m)."""
    shot = in_line(2 * COUNT, np.zeros(3), 8, rows=9)
    feathers, body = [], trimesh.creation.box((0.6, 0.4, 0.1))
    body.apply_translation([0.2, 0.0, -0.052])
    for _ in range(4):
        body = body.subdivide()
    for k, each in enumerate(shot.groom.feathers):
        winged, place = k >= COUNT, np.array([0.0, APART * (k % COUNT), 0.0])
        if winged:
            place = UP @ (place + height * UPWARDS - SHOULDER) + SHOULDER
            place[0] -= BEHIND
        feathers.append(
            replace(
                each,
                id=f"{'wing' if winged else 'coat'}_{k % COUNT}",
                position=place,
                rotation=(UP if winged else TILT) @ each.rotation,
                joint="shoulder" if winged else "",
                rank=-1,
            )
        )
    hinge = np.array([-0.5 * np.pi, 0.0, 0.0])
    joint = Joint("shoulder", SHOULDER, role="shoulder", side=-1, hinge=hinge, fold=0.0)
    folds = ({"time": 0.0, "fold": 0.0}, {"time": 0.25, "fold": 1.0})
    return replace(
        shot,
        groom=replace(
            shot.groom, feathers=tuple(feathers), joints=(joint,), skin=np.array(body.triangles)
        ),
        details=(Detail(feathers="coat*", level=coat, every=0),),
        motion=Motion("fold", {"joints": "shoulder", "folds": folds}),
        contact=Contact(THICKNESS),
    )


def gaps(frames: list[Frame]) -> list[float]:
    """m, the least of the wing's feathers over those of the coat."""
    return [
        min(least_gap(each.rows[COUNT + k], each.rows[k]) for k in range(COUNT)) for each in frames
    ]


@pytest.mark.parametrize("coat", ["full", "rigid"])
def test_a_wing_comes_to_lie_on_the_coat(coat):
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        simulation = simulate(folding(3e-3, coat), 1)
        frames = list(simulation)
    contact = simulation.report["contact"]
    assert contact["obstacles"] == (COUNT if coat == "rigid" else 0)
    assert contact["worst_depth"] < 2.0 * THICKNESS
    assert min(gaps(frames)) > -THICKNESS
    assert gaps(frames)[-1] > 0.0
    passing = list(simulate(replace(folding(3e-3, coat), contact=None), 1))
    assert min(gaps(passing)) < -0.01


def test_a_wing_that_is_led_into_the_body_is_told_with_feather_depth_and_frame():
    with pytest.warns(
        InputWarning, match=r"'wing_0' and of 2 more.* by 1[78] mm at frame 6.*opens"
    ):
        simulate(folding(-2e-2), 1)
