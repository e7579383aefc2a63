"""The coat of a shot in the frame loop: feathers on a skin are written on their leaves."""

from __future__ import annotations

import warnings

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputWarning, count_feathers
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import stacked
from featherfx.shot.coat.leaves import CarriedPoints, MovingCoat
from featherfx.shot.contact.bodies import surfaces_under
from featherfx.shot.direction.channels import courses
from featherfx.shot.direction.roots import OPEN
from featherfx.shot.frames import FeatherPose, StageClock, place
from featherfx.shot.loop.groups import ALONE
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.motion.cuts import CutRoots
from featherfx.shot.motion.limbs import limbs_of, moving_limbs
from featherfx.shot.motion.motion import undirected_motion
from featherfx.shot.patterns import last_fitting
from featherfx.shot.roots import RootFrames, Roots, RunUpRoots, root_rates

_TOLD_RATIO = 0.1  # of what channels ask for, that feathers miss without a warning
_ROLLED = "the leaves around leave no room. Lower the density of their regions, or ruffle them"
_RAISED = (
    "wings, tail or rows lie over it, or the skin is hollow. Open these, or leave the regions out"
)
_FRAMES_PER_LOOK = 4  # at the skin, for creases: they open and close over several frames
_CEILING_GRID = 21, 4  # rows and columns of what lies over a coat


class CoatStage(Stage):
    """Feathers of a shot that lie on a skin.

    The solver sees them on roots that the skin carries rigidly. Their deviation from rest there,
    which is zero for rigid ones, is written on the leaf of each on the moving skin.
    """

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        shot = run.shot
        assert shot.skin is not None
        self._coat: MovingCoat | None = None
        every = np.flatnonzero(self._may_lie())
        self._surfaces = [each for each, _ in surfaces_under(shot.skin, every, shot.run_up)]
        if all(each.surface.sampled is None for each in self._surfaces) and not shot.channels:
            self._surfaces = []
        self._members = np.intersect1d(every, run.wanted)
        if self._surfaces and len(self._members):
            # all that bend make the field, whichever are wanted
            run.lifted = self._find_lifted(every)
            bent = np.setdiff1d(every, run.lifted)
            run.pose_also(bent)
            self._members = np.union1d(self._members, bent)

    def prepare(self) -> None:
        """Lay the feathers that keep a leaf on it."""
        run, shot = self.run, self.run.shot
        surfaces = self._surfaces if len(self._members) else []
        self._sound = [
            (each, each.volume(each.surface.rest)) for each in surfaces if each.surface.closed.any()
        ]
        if not surfaces:
            return
        own = [shot.groom.feathers[f] for f in self._members]
        coat = shot.groom.coat.coat
        skin = CarriedPoints(coat.mesh.points, surfaces)
        above = self._find_above() if shot.channels else None
        bent = np.flatnonzero(~np.isin(self._members, run.lifted))
        drawn = [run.drawn[f] for f in self._members]
        self._coat, self._bent = MovingCoat(coat, skin, own, drawn, bent, above), bent
        self._bridge_creases(self._coat)
        self._motion: Roots = run.motion
        if shot.channels:  # which turn feathers on their leaves
            plain = undirected_motion(shot)
            whole: Roots = RunUpRoots(plain, shot.run_up) if shot.run_up.duration else plain
            clock = StageClock(0.0, 1.0, shot.frames_per_second, shot.frame_cuts)
            self._motion = CutRoots(whole, clock)
            self._warn_of_limits(self._coat)

    def _bridge_creases(self, coat: MovingCoat) -> None:
        """Let feathers bridge creases that fold beneath them in the shot; warn of them once."""
        shot = self.run.shot
        first, last = shot.first_frame, shot.last_frame
        frames = [*range(first, last, _FRAMES_PER_LOOK), last]
        times = [(each - first) / shot.frames_per_second for each in frames]
        found = self.run.kept(
            "folds", [self._members], lambda: {"shares": coat.find_bridges(times)}
        )
        coat.shares = shares = found["shares"]
        shares = np.where(np.isin(self._members, self.run.wanted), shares, 0.0)
        wholly = np.flatnonzero(shares == 1.0)
        if len(wholly):
            message = (
                f"{shot.source}: the skin folds by 90 degrees or more beneath"
                f" {count_feathers(len(wholly))} of the coat, as"
                f" '{shot.groom.feathers[self._members[wholly[0]]].id}', and by 45 or more beneath"
                f" {np.count_nonzero(shares)}. They keep their shape, wholly or in part, and follow"
                " their roots. Shorten them there, or smooth the weights of the skin"
            )
            warnings.warn(message, InputWarning, stacklevel=2)

    def _find_lifted(self, every: Indices) -> Indices:
        """Numbers of those guided feathers of a coat, by numbers, all of whose guides are of it:
        they take the coat's lift."""
        guidance = self.run.guidance
        if guidance is None or courses(self.run.shot, ("follow",)):
            return self.run.lifted
        others = ~np.isin(guidance.guides, every)
        own = guidance.weights @ others.astype(float) == 0.0
        return np.intersect1d(guidance.members[own], every)

    def _warn_of_limits(self, coat: MovingCoat) -> None:
        """Warn once of feathers whose channels ask for more than there is room for."""
        shot, placements = self.run.shot, [self.run.shot.groom.feathers[f] for f in self._members]
        wanted = {name: np.zeros(len(placements)) for name in ("turn", "ruffle", "puff")}
        for course in courses(shot, tuple(wanted)):
            peak = np.abs(course.curve.values).max()
            wanted[course.channel.name] += peak * course.weights[self._members]
        length = np.array([each.kind.length for each in placements])
        wished = np.isin(self._members, self.run.wanted)
        turn, ruffle = np.radians(wanted["turn"]), np.radians(wanted["ruffle"])
        rise = length * np.tan(np.minimum(ruffle, OPEN)) + wanted["puff"]
        for what, asked, got, (unit, per), rest in (
            ("roll", turn, coat.limit_rolls(turn), ("degrees", np.radians(1.0)), _ROLLED),
            ("rise", rise, coat.limit_tips(rise), ("mm", 1e-3), _RAISED),
        ):
            less = np.flatnonzero((asked - got > _TOLD_RATIO * asked) & wished)
            if len(less):
                worst = less[(asked - got)[less].argmax()]
                message = (
                    f"{shot.source}: channel: {count_feathers(len(less))} of the coat {what} by"
                    f" less than channels ask for, as '{placements[worst].id}'"
                    f" by {got[worst] / per:.2g} of {asked[worst] / per:.3g} {unit}: {rest}"
                )
                warnings.warn(message, InputWarning, stacklevel=2)

    def _find_above(self) -> Array:
        """Return (N, 3) m, points of the feathers that are not of the coat, at rest."""
        others = [each for each in self.run.shot.groom.feathers if each.leaf is None]
        shapes = build_feathers(others, *_CEILING_GRID) if others else []
        points = [
            place(shape.rest, own.position, own.rotation).nodes.reshape(-1, 3)
            for shape, own in zip(shapes, others, strict=True)
        ]
        return np.concatenate([np.empty((0, 3)), *points])

    def _may_lie(self) -> Flags:
        """(F,) feathers of the coat that nothing but skin, loads, guides and channels moves."""
        run, shot = self.run, self.run.shot
        placements = shot.groom.feathers
        led = {each.feather for each in shot.grips}
        rules = last_fitting((*shot.detachments, *shot.targets), placements)
        free = [
            each.leaf is not None and each.id not in led and rule < 0
            for each, rule in zip(placements, rules, strict=True)
        ]
        limbs = limbs_of(shot.groom) if shot.motion.of_limbs else moving_limbs(shot)
        return np.array(free) & (run.islands == ALONE) & np.equal(limbs, 0)

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Draw the feathers on their leaves at a sample."""
        if self._coat is None:
            return
        span = self.run.time(index - 1), self.run.time(index)
        self._warn_inside_out(index, span[1])
        members = self._members.tolist()
        before = [poses[f][:3] for f in self._members[self._bent].tolist()]
        given = [stacked(each) for each in zip(*before, strict=True)]
        roots = self._root_rates(self._motion, span)
        led = None if self._motion is self.run.motion else self._root_rates(self.run.motion, span)
        moving = self._coat.follow(given, roots, span, led, self.run.rates)
        drawn = dict(zip(members, FeatherPose.each(moving), strict=True))
        for f in drawn.keys() & poses.keys():
            drawn[f] = drawn[f]._replace(gaps=poses[f].gaps, clumped=poses[f].clumped)
        poses |= drawn

    def _root_rates(self, motion: Roots, span: tuple[float, float]) -> list[RootFrames]:
        """Roots of the coat's feathers at the end of a span (s), and their two rates."""
        rates = root_rates(motion, *span)
        return [RootFrames(*(values[self._members] for values in each)) for each in rates]

    def _warn_inside_out(self, index: int, time: float) -> None:
        """Warn once of each surface whose closed parts turn inside out."""
        for each, rest in list(self._sound):
            surface, now = each.surface, each.volume(each.points(time))
            side = -1.0 if surface.is_mirrored(each.clock.code(time)) else 1.0
            if side * now * rest < 0.0:
                self._sound.remove((each, rest))
                message = (
                    f"{surface.file}: {surface.path}: turns inside out at frame"
                    f" {self.run.number(index):g}: its faces enclose {now:.3g} m^3, at rest"
                    f" {rest:.3g}. Feathers point into it. Give a pose whose faces look outwards"
                )
                warnings.warn(message, InputWarning, stacklevel=2)
