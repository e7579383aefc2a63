"""Contact in whole shots: order at rest, calm start, bodies, files, resume, what it costs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from contact_cases import crossings
from farm.flock import flock
from places import SAMPLES

from featherfx.cli.bake_warnings import print_warnings
from featherfx.errors import InputError, InputWarning
from featherfx.files.process import allow_threads
from featherfx.limits import MAX_JOBS
from featherfx.phases import Account
from featherfx.shot.contact.pairs import _through_others
from featherfx.shot.frames import Frame, StageClock
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.options import simulation_quality
from featherfx.shot.read.read import read_shot
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Contact, Motion, Shot
from featherfx.solver.contact import run


def contact_group(simulation):
    """The first contact group of a simulation."""
    return next(each for each in simulation._run.step_groups if hasattr(each, "contact"))


SAMPLE = SAMPLES / "flapping_bird" / "shot.toml"
THICKNESS = 1.2e-4


@cache
def bird() -> Shot:
    """The sample on a coarse grid."""
    shot = read_shot(SAMPLE)
    return replace(shot, quality=replace(shot.quality, rows=11, columns=4, coefficients=2))


def half_wing(shot: Shot, of: str = "right_primary") -> Shot:
    """The primaries of the right wing alone, or the feathers whose names begin so."""
    kept = [f for f in shot.groom.feathers if f.id.startswith(of)]
    return replace(shot, groom=replace(shot.groom, feathers=tuple(kept)))


def baked(shot: Shot, last: int, jobs: int = 1) -> tuple[Simulation, list[Frame]]:
    simulation = simulate(shot, jobs, (shot.first_frame, last))
    return simulation, list(simulation)


def meshes(simulation: Simulation, frame: Frame):
    found = []
    for feather, points in zip(simulation.feathers, frame.rows, strict=True):
        surface = feather.surface
        found.append((surface.points(points), surface.triangles[surface.part < 2]))
    return found


def all_crossings(surfaces) -> int:
    boxes = [(p.min(axis=0), p.max(axis=0)) for p, _ in surfaces]
    total = 0
    for a, (low, high) in enumerate(boxes):
        for b, (other_low, other_high) in enumerate(boxes):
            if a != b and (low <= other_high).all() and (other_low <= high).all():
                total += crossings(surfaces[a], surfaces[b])
    return total


def wing() -> Shot:
    """One wing of the bird; the other is its mirror image."""
    return half_wing(bird(), "right")


@pytest.mark.verification
def test_flapping_bird_keeps_its_feathers_apart():
    """In the first quarter of the beat, where air and inertia press the wing hardest."""
    told = []
    with Account(told.append):
        simulation, frames = baked(wing(), 10, 2)
    settling = [each.left for each in told if each.name == "settling" and not each.ended]
    left = [each for each in settling if each is not None]
    assert len(left) > 8
    # all of it takes a tenth of a second, which a busy machine tells unevenly
    assert 0.0 < left[-1] < 0.75 * left[0]
    contact = simulation.report["contact"]
    assert contact["steps"] == (12 + 9) * 12  # with those of the preroll
    assert contact["islands"] == 1
    assert contact["most_contacts"] > 20
    # what is asked: below one thickness; what is got: a fifth of it
    assert contact["worst_depth"] < 0.5 * THICKNESS
    assert contact["depth_after_settling"] < 0.1 * THICKNESS
    assert contact["depth_at_rest"] < 5.0 * THICKNESS
    assert contact["unresolved_pairs"] == 0
    assert contact["unresolved"] == []
    assert all_crossings(meshes(simulation, frames[0])) == 0
    assert all_crossings(meshes(simulation, frames[-1])) == 0


def test_without_contact_the_same_feathers_cut_through_each_other():
    simulation, frames = baked(replace(wing(), contact=None), 10)
    assert "contact" not in simulation.report
    assert all_crossings(meshes(simulation, frames[-1])) > 30


def test_neighbours_lie_as_the_rows_say():
    """Each feather of a row lies below the one before it (lift = -0.001)."""
    simulation, _ = baked(half_wing(bird()), 1)
    solver = contact_group(simulation).contact.solver
    pairs = [tuple(pair) for pair in solver.candidates.pairs.tolist()]
    sides = dict(zip(pairs, solver.candidates.order.tolist(), strict=True))
    for k in range(4):
        # normals are dorsal on the right wing
        assert sides[k, k + 1] == 1
        assert sides[k + 1, k] == -1


def test_a_bird_of_the_flock_takes_no_step_above_the_tolerance(tmp_path):
    """As the hand folds, its innermost primary stays under the last secondary. With the air beside
    them, which they carry, one step of 12 would miss by 1.1 tolerances."""
    simulation, _ = baked(read_shot(flock(tmp_path, 1, 1.5, "steps = 16\n", row=5)), 24)
    contact = simulation.report["contact"]
    assert simulation.report["substeps_over_tolerance"] == 0
    assert contact["steps_with_contacts_off"] == contact["repeated_steps"] == 0
    assert contact["most_contacts"] > 20


def test_two_that_cut_through_each_other_about_evenly_come_apart(tmp_path):
    """Where the hand lies as high as the arm, of the innermost primary and the last secondary 44
    nodes lie one way, 38 the other. Without an order each would stay on its side, and both in each
    other."""
    path = flock(tmp_path, 1, 1.5, row=5)
    groom = tmp_path / "flock_groom.toml"
    groom.write_text(groom.read_text().replace("-0.04]", "0.0]").replace("0.0305]", "0.0345]"))
    shot = read_shot(path)
    kept = ("b0_right_secondary_05", "b0_right_primary_01")
    pair = [f for f in shot.groom.feathers if f.id in kept]
    simulation, frames = baked(replace(shot, groom=replace(shot.groom, feathers=tuple(pair))), 1)
    assert contact_group(simulation).contact.solver.candidates.order.tolist() == [1, -1]
    contact = simulation.report["contact"]
    assert contact["depth_at_rest"] > 30.0 * THICKNESS
    assert contact["depth_after_settling"] < 0.5 * THICKNESS
    assert contact["unresolved"] == []
    assert all_crossings(meshes(simulation, frames[0])) == 0


def test_two_that_are_deep_through_each_other_at_rest_are_named(tmp_path):
    """One that stands upright in the middle of the other: nothing tells which is over which."""
    shot = read_shot(flock(tmp_path, 1, 1.5, row=5))
    chosen = {f.id: f for f in shot.groom.feathers}
    first, second = chosen["b0_right_secondary_05"], chosen["b0_right_primary_01"]
    shaft, dorsal = first.rotation[:, 0], first.rotation[:, 2]
    turned = np.stack([shaft, dorsal, np.cross(shaft, dorsal)], axis=1)
    upright = replace(second, position=first.position, rotation=turned)
    shot = replace(shot, groom=replace(shot.groom, feathers=(first, upright)))
    with pytest.warns(InputWarning, match="'b0_right_secondary_05' and 'b0_right_primary_01' pass"):
        simulation, _ = baked(shot, 1)
    (crossed,) = simulation.report["contact"]["crossed"]
    assert crossed["depth"] > 0.01
    assert simulation.report["contact"]["crossed_pairs"] == 1


def test_a_lean_counts_where_nothing_between_tells_and_tells_of_others():
    """0 over 1 over 2 tells of 0 and 2, against their lean; 3 over 0 over 2 tells of 3 and 2."""
    pairs = np.array([[0, 1], [1, 2], [0, 2], [2, 3], [0, 3]])
    order, lean = np.array([1, 1, 0, 0, 0]), np.array([0, 0, -1, 0, -1])
    alike = np.ones(5, dtype=np.int64)
    assert _through_others(pairs, order, alike, lean).tolist() == [1, 1, 1, -1, -1]


def test_a_chain_of_feathers_that_are_not_between_two_tells_nothing_of_them():
    """0 over 1 over 2 over 3, as around a body: 1 is not near 3, nor 2 near 0."""
    pairs = np.array([[0, 1], [1, 2], [2, 3], [0, 3]])
    order, alike = np.array([1, 1, 1, 0]), np.ones(4, dtype=np.int64)
    nothing = np.zeros(4, dtype=np.int64)
    assert _through_others(pairs, order, alike, nothing).tolist() == [1, 1, 1, 0]
    # 1 is between where it is paired with 3, and 2 is beneath it
    pairs, order = np.append(pairs, [[1, 3]], axis=0), np.append(order, 1)
    alike, nothing = np.ones(5, dtype=np.int64), np.zeros(5, dtype=np.int64)
    assert _through_others(pairs, order, alike, nothing).tolist() == [1, 1, 1, 1, 1]


@pytest.mark.parametrize("upwards", [-1, 1])
def test_the_order_of_a_layout_holds_where_there_is_one(upwards):
    """Even against the poses: ranks that fall along the row are what they show, rising ones not."""
    shot = replace(half_wing(bird()), settle=False)
    ranked = tuple(
        replace(feather, rank=10 + upwards * k) for k, feather in enumerate(shot.groom.feathers)
    )
    simulation, _ = baked(replace(shot, groom=replace(shot.groom, feathers=ranked)), 1)
    solver = contact_group(simulation).contact.solver
    sides = dict(
        zip(
            map(tuple, solver.candidates.pairs.tolist()),
            solver.candidates.order.tolist(),
            strict=True,
        )
    )
    # those that are drawn through each other do not touch
    assert sides
    for (guest, host), side in sides.items():
        if abs(guest - host) == 1:
            assert side == upwards * (guest - host)


def test_a_calm_layered_wing_starts_without_a_jump_and_stays():
    shot = replace(half_wing(bird()), motion=Motion("hold", {}), sleep=False)
    _, frames = baked(shot, 4)
    rest = [np.delete(points, (1, 2), axis=1) for points in frames[0].rows]
    for frame in frames[1:]:
        for before, points in zip(rest, frame.rows, strict=True):
            assert np.abs(np.delete(points, (1, 2), axis=1) - before).max() < 5e-4
    speeds = [np.abs(np.delete(v, (1, 2), axis=1)).max() for v in frames[-1].row_velocities]
    assert max(speeds) < 0.02


@pytest.mark.slow
def test_a_wing_at_rest_sleeps_as_a_whole():
    still = replace(half_wing(bird()), motion=Motion("hold", {}), last_frame=200)
    simulation, _ = baked(still, 60)
    assert simulation.report["skipped"]["sleeping feather frames"] > 0


def test_threads_change_nothing(monkeypatch):
    monkeypatch.setattr(run, "_WORTH_IT", 1)
    one, *others = (baked(half_wing(bird()), 2, jobs)[1] for jobs in (1, 2, 3))
    for some in others:
        for a, b in zip(one, some, strict=True):
            assert all(np.array_equal(x, y) for x, y in zip(a.rows, b.rows, strict=True))


def test_fewer_threads_from_some_frame_on_change_nothing():
    whole, some = baked(half_wing(bird()), 3)[1], []
    try:
        for frame in simulate(half_wing(bird()), 2, (1, 3)):
            some.append(frame)
            allow_threads(1 + len(some) % 2)
    finally:
        allow_threads(MAX_JOBS)
    for a, b in zip(whole, some, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a.rows, b.rows, strict=True))


def test_a_checkpoint_goes_on_bit_by_bit(tmp_path):
    from featherfx.shot.loop.simulate import Checkpoint

    shot = half_wing(bird())
    simulation = simulate(shot, 1, (1, 4))
    whole = []
    for frame in simulation:
        whole.append(frame)
        if frame.number == 2:
            simulation.checkpoint().save(tmp_path / "state.npz")
    start = Checkpoint.load(tmp_path / "state.npz")
    rest = list(simulate(shot, 1, (1, 4), start=start))
    assert [frame.number for frame in rest] == [3, 4]
    for a, b in zip(whole[2:], rest, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a.rows, b.rows, strict=True))


@dataclass(frozen=True)
class Board:
    """A square below the wing that rises by 2 cm in the shot."""

    path: str = "/board"
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    face = np.zeros(2, dtype=np.int64)
    rest = np.array([[-1.0, -1, -0.06], [1, -1, -0.06], [1, 1, -0.06], [-1, 1, -0.06]])
    st = None
    sampled, knots, closed = (0.0, 100.0), None, np.zeros(2, bool)
    time_codes_per_second: float = 1.0
    origin: tuple = ("board", ())

    def smoothed(self, knots):
        return self

    def points(self, code: float) -> np.ndarray:
        return self.rest + np.array([0.0, 0.0, 0.02 * min(code / 0.1, 1.0)])


def test_feathers_are_carried_by_a_body_that_moves():
    still = replace(half_wing(bird()), motion=Motion("hold", {}))
    first = still.first_frame / still.frames_per_second
    shot = replace(still, colliders=(TimedSurface(Board(), StageClock(first)),))
    free, _ = baked(replace(shot, colliders=()), 1)
    simulation, frames = baked(shot, 8)
    assert free.report["contact"]["bodies"] == 0
    contact = simulation.report["contact"]
    assert contact["bodies"] == 1
    for frame in frames:
        level = Board().points(first + frame.time)[0, 2]
        for feather, points in zip(simulation.feathers, frame.rows, strict=True):
            surface = feather.surface
            vane = np.unique(surface.triangles[surface.part < 2])
            assert surface.points(points)[vane, 2].min() > level


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ('regions = ["wing"]', "regions[0]"),
        ('kinds = ["swan_*", "crow"]', "kinds[1]"),
        ("regions = []", "regions"),
    ],
)
def test_regions_and_kinds_that_are_not_there_are_named(tmp_path, keys, what):
    text = f'name = "x"\ngroom = "{SAMPLE.parent / "groom.toml"}"\nframes = [1, 2]\n'
    (tmp_path / "shot.toml").write_text(text + f"[contact]\n{keys}\n")
    with pytest.raises(InputError) as caught:
        read_shot(tmp_path / "shot.toml")
    assert [problem.key for problem in caught.value.problems] == [f"contact.{what}"]


def test_the_table_is_read_and_can_be_switched_off(tmp_path):
    text = f'name = "x"\ngroom = "{SAMPLE.parent / "groom.toml"}"\nframes = [1, 2]\n'
    path = tmp_path / "shot.toml"
    path.write_text(text)
    assert read_shot(path).contact is None
    path.write_text(text + "[contact]\n")
    assert read_shot(path).contact == Contact(None, 0.3, 0)
    path.write_text(text + "[contact]\nenabled = false\nfriction = 0.1\n")
    assert read_shot(path).contact is None


def test_contact_can_be_limited_to_regions_and_kinds():
    shot = half_wing(bird())
    regions = {feather.region for feather in shot.groom.feathers}
    assert regions == {"primaries"}
    own = tuple(
        replace(feather, region="tip") if feather.id.endswith(("_04", "_05")) else feather
        for feather in shot.groom.feathers
    )
    some = replace(
        shot,
        groom=replace(shot.groom, feathers=own),
        contact=replace(shot.contact, regions=("prim*",)),
        settle=False,
    )
    simulation, _ = baked(some, 1)
    contact = contact_group(simulation).contact
    touching = {contact.names[body] for body in np.unique(contact.solver.candidates.pairs)}
    assert touching == set(contact.names) == {f"right_primary_0{k}" for k in (1, 2, 3)}


def test_feathers_that_contact_leaves_out_move_as_without_it():
    shot = replace(half_wing(bird()))
    alone = replace(shot, contact=replace(shot.contact, regions=("none",)))
    bare = replace(shot, contact=None, quality=simulation_quality(shot))
    with_contact, without = (baked(some, 2)[1] for some in (alone, bare))
    for frame, other in zip(with_contact, without, strict=True):
        for pose, own in zip(frame.poses, other.poses, strict=True):
            assert np.array_equal(pose.points.nodes, own.points.nodes)


def test_steps_with_contacts_out_of_balance_are_told(capsys):
    contact = {"steps": 9, "steps_with_contacts_off": 0, "worst_depth": 4.2e-4}
    print_warnings({"contact": contact})
    assert capsys.readouterr().err == ""
    print_warnings({"contact": contact | {"steps_with_contacts_off": 2}})
    assert "2 of 9 steps were taken with contacts out of balance" in (
        told := capsys.readouterr().err
    )
    assert "up to 0.42 mm in each other. Raise [contact] max_steps" in told
