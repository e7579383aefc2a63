"""What is asked too much of feathers that touch: it goes on, or ends with a name and a reason."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from test_contact_shots import (
    SAMPLE,
    THICKNESS,
    Board,
    all_crossings,
    baked,
    bird,
    half_wing,
    meshes,
)

from featherfx.errors import InputWarning, SimulationError
from featherfx.shot.contact import settle
from featherfx.shot.contact.steps import (
    FEW_STEPS,
    MORE_ITERATIONS,
    FrameSteps,
    StepPacing,
    StepRules,
    StepSpan,
)
from featherfx.shot.frames import StageClock
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.patterns import Detail, Force
from featherfx.shot.read.read import read_shot
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Motion
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.types import PLAIN_INTERVAL, ContactReport
from featherfx.solver.state import make_report

HELD = Motion("hold", {})
BOX = trimesh.creation.box((1.0, 1.0, 1.0))


def timed(board) -> tuple[TimedSurface]:
    return (TimedSurface(board, StageClock(1.0 / 30.0)),)


def coarse_bird():
    shot = read_shot(SAMPLE)
    return replace(shot, quality=replace(shot.quality, rows=7, columns=2, coefficients=1))


@dataclass(frozen=True)
class JumpingBoard(Board):
    """It rises by 7.5 cm, through the whole wing, within the second frame."""

    def points(self, code: float) -> np.ndarray:
        share = min(max(30.0 * code - 2.0, 0.0), 1.0)
        return self.rest + np.array([0.0, 0.0, 0.075 * share])


def lowest_vane_points(simulation, frame) -> list[float]:
    found = []
    for feather, points in zip(simulation.feathers, frame.rows, strict=True):
        surface = feather.surface
        vane = np.unique(surface.triangles[surface.part < 2])
        found.append(float(surface.points(points)[vane, 2].min()))
    return found


@pytest.mark.slow
def test_a_board_that_jumps_carries_the_wing_along():
    shot = replace(half_wing(bird()), motion=HELD, colliders=timed(JumpingBoard()))
    simulation, frames = baked(shot, 4)
    level = JumpingBoard().points(1.0)[0, 2]
    assert simulation.report["contact"]["most_contacts"] > 20
    # through the wing at rest by centimetres, but not through the wing
    assert min(lowest_vane_points(simulation, frames[0])) < level - 0.01
    assert min(lowest_vane_points(simulation, frames[-1])) > level - 2.0 * THICKNESS


@dataclass(frozen=True)
class LateBoard(Board):
    """Far below, until in no time at all it lies across the wing."""

    def points(self, code: float) -> np.ndarray:
        return self.rest + np.array([0.0, 0.0, 0.0 if code < 0.1 else 0.075])


def outcome(shot, last):
    """Frames that came out, and the feather whose error ended them, if one did."""
    frames = []
    try:
        for frame in simulate(shot, 2, (shot.first_frame, last)):
            assert all(np.isfinite(points).all() for points in frame.rows)
            frames.append(frame)
    except SimulationError as error:
        return frames, error.feather
    return frames, None


@pytest.mark.slow
def test_a_collider_that_appears_inside_a_feather_ends_with_a_name_or_not_at_all():
    shot = replace(half_wing(coarse_bird()), motion=HELD, colliders=timed(LateBoard()))
    frames, failed = outcome(shot, 4)
    assert len(frames) >= 2
    assert len(frames) == 4 or failed in {feather.id for feather in shot.groom.feathers}


@dataclass(frozen=True)
class Block(Board):
    """A closed box below the wing whose top is as high as a board that cuts through it."""

    triangles = np.asarray(BOX.faces)
    closed = np.ones(len(BOX.faces), dtype=bool)
    face = np.zeros(len(BOX.faces), dtype=np.int64)
    rest = 2.0 * np.asarray(BOX.vertices) - np.array([0.0, 0.0, 1.01])

    def points(self, code: float) -> np.ndarray:
        return self.rest


@dataclass(frozen=True)
class HighBoard(Board):
    """A sheet that cuts through the wing."""

    rest = Board.rest + np.array([0.0, 0.0, 0.05])


@pytest.mark.parametrize("collider", [Block(), HighBoard()])
def test_a_collider_that_is_inside_from_the_start_does_not_stop_the_shot(collider):
    """Nodes in a body stay free until they come out; a sheet has no inside."""
    inside = replace(half_wing(coarse_bird()), motion=HELD, colliders=timed(collider))
    simulation, frames = baked(inside, 3)
    grown = simulation.report["contact"]["nodes_grown_into_bodies"]
    assert grown > 0 if collider.closed.all() else grown == 0
    assert len(frames) == 3
    assert all(np.isfinite(points).all() for points in frames[-1].rows)


@dataclass(frozen=True)
class Mouth(Board):
    """A closed box of a metre above the wing that is around all of it two frames later."""

    triangles = np.asarray(BOX.faces)
    closed = np.ones(len(BOX.faces), dtype=bool)
    face = np.zeros(len(BOX.faces), dtype=np.int64)
    rest = np.asarray(BOX.vertices) + np.array([0.0, -0.4, 1.0])

    def points(self, code: float) -> np.ndarray:
        return self.rest - np.array([0.0, 0.0, np.clip(15.0 * code - 0.5, 0.0, 1.0)])


@pytest.mark.slow
def test_a_body_that_swallows_a_wing_ends_with_names_and_not_the_shot():
    shot = replace(half_wing(coarse_bird()), motion=HELD, colliders=timed(Mouth()))
    with pytest.warns(InputWarning, match=r"'right_primary_\d+' .*found no balance") as told:
        frames, failed = outcome(shot, 4)
    names = [name for each in told for name in re.findall(r"feather '(\w+)'", str(each.message))]
    assert len(names) == len(set(names))
    assert len(frames) == 4
    assert failed is None


@pytest.mark.parametrize(("way", "named"), [(0.002, False), (0.01, True)])
def test_feathers_that_start_crossed_come_apart_or_are_named(way, named):
    """The middle one of five at rest dives: its root is up, its tip as far down."""
    shot = replace(half_wing(coarse_bird()), motion=HELD)
    feathers = list(shot.groom.feathers)
    one = feathers[2]
    sine = 2.0 * way / one.kind.length
    cosine = np.sqrt(1.0 - sine**2)
    dive = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    up = one.position + np.array([0.0, 0.0, way])
    feathers[2] = replace(one, position=up, rotation=one.rotation @ dive)
    crossed = replace(shot, groom=replace(shot.groom, feathers=tuple(feathers)))
    free = replace(crossed, contact=None)
    simulation, frames = baked(free, 1)
    assert all_crossings(meshes(simulation, frames[0])) > 10
    if named:
        with pytest.warns(InputWarning, match="'right_primary_03' and 'right_primary_04' pass"):
            baked(crossed, 1)
    else:
        simulation, frames = baked(crossed, 3)
        assert [all_crossings(meshes(simulation, frame)) for frame in frames] == [0, 0, 0]


def test_a_feather_that_finds_no_balance_does_not_keep_others_from_it(monkeypatch):
    """One has contacts far off in every step of more than a thousandth of a second."""
    shot = replace(half_wing(coarse_bird()), motion=HELD)
    hard, interval = 4, ContactSolver.interval

    def hindered(self, states, loads, paths, duration, walls=(), manner=PLAIN_INTERVAL):
        done, reports, contact = interval(self, states, loads, paths, duration, walls, manner)
        if manner.settling and duration > 1e-3 and (manner.led is None or manner.led.free[hard]):
            off = np.where(np.arange(len(contact.off)) == hard, 1.0, contact.off)
            contact = replace(contact, off=off, residual=float(off.max()))
        return done, reports, contact

    monkeypatch.setattr(ContactSolver, "interval", hindered)
    # one of five; the one that lies on it moves with it
    monkeypatch.setattr(settle, "FEW", 0.3)
    name = shot.groom.feathers[hard].id
    with pytest.warns(InputWarning, match=f"'{name}' and 1 more start out of balance"):
        simulation, _ = baked(shot, 1)
    assert simulation.report["contact"]["depth_after_settling"] < THICKNESS


@pytest.mark.slow
def test_a_storm_from_above_ends_with_a_name_or_not_at_all():
    shot = half_wing(coarse_bird())
    wind = replace(
        shot.wind,
        speed=30.0,
        direction=np.array([0.0, 0.0, -1.0]),
        air_density=1.225,
        drag_normal=1.2,
        drag_tangential=0.02,
    )
    with pytest.warns(InputWarning, match="settle"):
        frames, failed = outcome(replace(shot, motion=HELD, wind=wind), 3)
    # the pose at the first frame is there in any case
    assert len(frames) >= 1
    assert len(frames) == 3 or failed in {feather.id for feather in shot.groom.feathers}


@pytest.mark.slow
def test_a_wing_folds_by_120_degrees_and_ten_beats_run_through():
    shot = coarse_bird()
    wrist = {"mean": 4.0, "harmonics": ((0.0, -120.0),)}
    folded = replace(shot, motion=Motion("flap", shot.motion.values | {"wrist": wrist}))
    _, frames = baked(folded, 25, 2)
    assert len(frames) == 25
    simulation, frames = baked(replace(bird(), last_frame=361), 361, 2)
    assert len(frames) == 361
    assert simulation.report["contact"]["worst_depth"] < THICKNESS


def test_feathers_of_different_grids_touch_each_other():
    shot = half_wing(bird())
    details = (Detail(feathers="*_02", level="coarse"), Detail(feathers="*_04", level="rachis"))
    simulation, frames = baked(replace(shot, details=details), 6)
    assert {r.level for r in simulation.options} == {"full", "coarse", "rachis"}
    contact = simulation.report["contact"]
    assert contact["most_contacts"] >= 3
    assert contact["worst_depth"] < THICKNESS
    _, free = baked(replace(shot, details=details, contact=None), 6)
    apart = [np.abs(a - b).max() for a, b in zip(frames[-1].rows, free[-1].rows, strict=True)]
    assert max(apart) > 10.0 * THICKNESS


@pytest.mark.slow
def test_feathers_that_nothing_reaches_sleep_while_others_move():
    """Five feathers at rest; the outermost is pulled and stirs its neighbours only a little."""
    shot = replace(half_wing(coarse_bird()), motion=HELD, last_frame=60)
    simulation, _ = baked(shot, 40)
    still = simulation.report["skipped"]["sleeping feather frames"]
    pull = Force(
        feather="right_primary_05",
        force=np.array([0.0, 0.0, -2e-3]),
        line="point",
        row=1.0,
        column=0.0,
        side="leading",
        span=(0.0, 1.0),
        keys=((0.0, 0.0), (1.0, 0.0), (1.2, 1.0)),
    )
    simulation, _ = baked(replace(shot, forces=(pull,)), 40)
    woken = simulation.report["skipped"]["sleeping feather frames"]
    assert 0 < woken < still
    # with all of them awake from the pull on, these would be those of the first second
    assert simulation.report["newton_iterations"]["mean"] < 40.0


def step_rules(substeps, names):
    tolerance, thickness = np.full(len(names), 1e-3), np.full(len(names), THICKNESS)
    return StepRules(0, substeps, tolerance, thickness, 8, 1000, names)


@pytest.mark.parametrize(("least", "most"), [(1.0, 1.5), (0.6, 0.9)])
def test_a_common_step_is_one_that_most_feathers_take_at_once(least, most):
    """A common step that doubled would be divided by all of them, be halved, and double again."""
    rules = step_rules(8, [str(f) for f in range(10)])
    frame = 1.0 / 24
    steps = FrameSteps(rules, 0.0, frame, StepPacing(0.25 * frame), np.full(10, 8.0))
    assert steps.left()
    length = steps.span.length
    state = SimpleNamespace(proposal=np.append(length * np.linspace(least, most, 9), 0.0))
    report = make_report(10)
    report.steps[:9] = 1.0
    none = ContactReport(0, 1, 9, 0.0, 0.0, 0.0, np.zeros(10), np.zeros(10))
    steps.accepted([state], [report], none, False)
    divided = np.count_nonzero(state.proposal[:9] < steps.proposal)
    assert 0 < divided <= (1.0 - FEW_STEPS) * 9
    assert steps.time == length


def test_a_feather_whose_contacts_were_left_out_has_less_patience_in_the_next_frame():
    rules, frame = step_rules(32, ["one", "two"]), 1.0 / 24
    patience = np.full(2, float(MORE_ITERATIONS))
    report, found = make_report(2), []
    for work in (*6 * [9000.0], 0.0, 0.0):
        steps = FrameSteps(rules, 0.0, frame, StepPacing(), patience)
        report.iterations[:] = work, 10.0
        steps.spend([report], 0.0)
        assert steps.tired().tolist() == [work > 0.0, False]
        patience = steps.next_patience()
        found.append(patience.tolist())
    parts = [first / MORE_ITERATIONS for first, _ in found]
    assert parts == [1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 16, 1 / 16, 1 / 8, 1 / 4]
    assert all(second == MORE_ITERATIONS for _, second in found)


@pytest.mark.parametrize(
    ("livelier", "again", "halved"), [(1.0, 30.0, False), (1.0, 900.0, True), (5.0, 300.0, False)]
)
def test_steps_are_bounded_by_one_that_was_dear_to_do_again(livelier, again, halved):
    """Feathers would have longer ones, and most of these would be solved in vain; not so where a
    few are in trouble, for which all others need no shorter ones, however lively all become."""
    rules = step_rules(32, [str(f) for f in range(10)])
    state = SimpleNamespace(proposal=np.full(10, 1.0))
    none = ContactReport(0, 1, 10, 0.0, 0.0, 0.0, np.zeros(10), np.zeros(10))
    report = make_report(10)
    report.steps[:] = 1.0
    pace, lengths = StepPacing(1.0 / 8), []
    # one easy step, one that is done again, and easy ones after
    for k in range(12):
        steps = FrameSteps(rules, 0.0, 1.0, pace, np.full(10, 8.0))
        assert steps.left()
        length = steps.span.length
        lengths.append(length)
        # 80 iterations for each unit of time in an easy step
        report.iterations[:] = 8.0 * length * (livelier if k else 1.0)
        steps.spend([report], 0.0)
        report.iterations[:] = (again * length if k == 1 else 0.0) / 10.0
        steps.spend([report], 0.0)
        steps.accepted([state], [report], none, k == 1)
        pace = steps.pace
    assert lengths[:2] == [1.0 / 8, 1.0]
    assert lengths[2] == (0.5 if halved else 1.0)
    assert lengths[-1] == 1.0
    if halved:
        assert (np.diff(lengths[2:]) >= 0.0).all()


def test_what_a_step_cannot_be_cut_for_is_searched_for_to_the_end():
    """A feather that waits for shorter steps would stay off where there are none."""
    rules = step_rules(8, ["one", "two"])
    shortest = 1.0 / 24 / 8
    for parts, most in ((8.0, 0.5), (1.0, 2.0), (0.5, 2.0), (0.125, np.inf), (0.0625, np.inf)):
        span = StepSpan(0.0, parts * shortest, shortest, True)
        lost = float(rules.lost(span)[0]) / THICKNESS
        assert lost == np.inf if most == np.inf else most <= lost < np.inf
        # and it is off by so much that the step is cut, or nothing would be done for it
        off = np.array([1.01 * lost, 0.0]) * THICKNESS
        report = ContactReport(1, 1, 1, 0.0, 0.0, 0.0, off, np.zeros(2))
        assert rules.off([make_report(2)], report, span).tolist() == [most < np.inf, False]
