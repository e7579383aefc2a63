"""Guided and rigid feathers are obstacles of simulated ones."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from shingled import in_line, least_gap

from featherfx.shot.contact.partition import shot_islands
from featherfx.shot.frames import Frame
from featherfx.shot.loop.simulate import Checkpoint, Simulation, simulate
from featherfx.shot.patterns import Detail, Shelter
from featherfx.shot.types import Contact, Shot

THICKNESS = 5e-4
LAST = 4


def pressed(level: str, obstacles: bool = True, steps: int = 0) -> Shot:
    """A feather 4 mm over another one at a level of detail, in a wind from above that the guide of
    that, 0.3 m aside, is sheltered from; roots swing together."""
    shot = in_line(3, np.array([0.0, 0.0, 0.004]), LAST, rows=11)
    guide, beneath, above = shot.groom.feathers
    feathers = (
        replace(above, id="above", region="wing"),
        replace(beneath, id="beneath", rank=beneath.rank - 9),
        replace(guide, id="guide", position=np.array([0.0, 0.3, 0.0]), rank=-1),
    )
    return replace(
        shot,
        groom=replace(shot.groom, feathers=feathers),
        details=(Detail(feathers="beneath", level=level, every=0),),
        shelters=(Shelter(feathers="guide", share=1.0),),
        contact=Contact(THICKNESS, steps=steps, obstacles=obstacles),
        wind=replace(shot.wind, speed=6.0, direction=np.array([0.0, 0.0, -1.0]), gust=0.0),
    )


@cache
def simulated(level: str, obstacles: bool, jobs: int = 1) -> tuple[Simulation, list[Frame]]:
    simulation = simulate(pressed(level, obstacles), jobs)
    return simulation, list(simulation)


def gaps(frames: list[Frame]) -> list[float]:
    """m, of the feather above over the one beneath."""
    return [least_gap(frame.rows[0], frame.rows[1]) for frame in frames]


@pytest.mark.parametrize("level", ["rigid", "guided"])
def test_what_is_not_simulated_holds_what_is_pressed_onto_it(level):
    _, without = simulated(level, False)
    assert max(gaps(without)) < -0.015
    simulation, frames = simulated(level, True)
    contact = simulation.report["contact"]
    assert contact["obstacles"] == 1
    assert contact["worst_depth"] < 0.2 * THICKNESS
    # between the places where it was looked for, a guided one behind its guide by a step
    assert min(gaps(frames)) > 0.8 * THICKNESS


@pytest.mark.parametrize("level", ["rigid", "guided"])
def test_nothing_moves_an_obstacle(level):
    """In steps of a length: where steps are chosen, the guide takes those that contact asks for."""
    frames, without = (list(simulate(pressed(level, on, 16), 1)) for on in (True, False))
    for frame, other in zip(frames, without, strict=True):
        assert np.array_equal(frame.rows[1], other.rows[1])
    assert min(gaps(without)) < 0.0 < np.abs(frames[-1].rows[0] - without[-1].rows[0]).max()


def test_a_rigid_obstacle_holds_the_same_way_however_soft_it_is():
    shot = pressed("rigid")
    above, beneath, guide = shot.groom.feathers
    stiff = beneath.kind.rachis_material
    limp = replace(
        stiff, youngs_modulus=0.01 * stiff.youngs_modulus, shear_modulus=0.01 * stiff.shear_modulus
    )
    kind = replace(beneath.kind, rachis_material=limp)
    softer = replace(shot.groom, feathers=(above, replace(beneath, kind=kind), guide))
    simulation = simulate(replace(shot, groom=softer), 1)
    frames = list(simulation)
    stiffer, others = simulated("rigid", True)
    for frame, other in zip(frames, others, strict=True):
        assert np.array_equal(frame.rows[0], other.rows[0])
    for figure in ("steps", "mean_rounds", "feather_solves"):
        assert simulation.report["contact"][figure] == stiffer.report["contact"][figure]


def test_threads_change_nothing_and_a_checkpoint_holds_where_obstacles_are(tmp_path):
    _, frames = simulated("guided", True)
    _, others = simulated("guided", True, 2)
    simulation = simulate(pressed("guided"), 1, (0, 2))
    list(simulation)
    simulation.checkpoint().save(tmp_path / "state.npz")
    start = Checkpoint.load(tmp_path / "state.npz")
    rest = list(simulate(pressed("guided"), 1, (3, LAST), start=start))
    for frame, other in zip(frames, [*others[:3], *rest], strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(frame.rows, other.rows, strict=True))
    assert all(map(np.array_equal, frames[-1].rows, others[-1].rows))


def test_a_guide_passes_what_follows_it():
    """Else each would lift the other."""
    shot = pressed("guided")
    above, beneath, _ = shot.groom.feathers
    groom = replace(shot.groom, feathers=(replace(above, region="coat"), beneath))
    simulation = simulate(replace(shot, groom=groom), 1, (0, 1))
    list(simulation)
    contact = simulation.report["contact"]
    assert contact["obstacles"] == 1
    assert contact["pairs"] == 0


def test_a_follower_is_of_the_island_of_its_guides():
    shot = pressed("guided")
    feathers = list(shot.groom.feathers)
    feathers[2] = replace(feathers[2], position=np.array([0.0, 30.0, 0.0]))
    far = replace(shot, groom=replace(shot.groom, feathers=tuple(feathers)))
    assert set(shot_islands(far)) == {0}


def test_a_share_by_island_has_the_same_bytes_with_obstacles():
    shot = pressed("rigid")
    above, beneath, _ = shot.groom.feathers
    feathers = tuple(
        replace(one, id=f"{one.id}_{k}", position=one.position + np.array([0.0, aside, 0.0]))
        for k, aside in enumerate((0.0, 0.05, 0.1, 0.15, 30.0, 30.05, 30.1, 30.15))
        for one in (above, beneath)
    )
    birds = replace(
        shot,
        groom=replace(shot.groom, feathers=feathers),
        details=(Detail(feathers="beneath*", level="rigid", every=0),),
    )
    assert shot_islands(birds).tolist() == [0] * 8 + [1] * 8
    whole = simulate(birds, 2, (0, 1))
    share = simulate(birds, 1, (0, 1), wanted=range(8, 16))
    for frame, part in zip(whole, share, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(frame.rows[8:], part.rows, strict=True))
    assert whole.report["contact"]["obstacles"] == 8
    assert share.report["contact"]["obstacles"] == 4
