"""Feathers of a shot in batches that are stepped together: those of one grid."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.feather.build import build_feather
from featherfx.feather.density import PointCarrier, scaled_map
from featherfx.feather.shapes import build_feathers, build_unit_maps
from featherfx.feather.types import Feather, RowMap
from featherfx.files.disk_cache import kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import FeatherKind, Placement, Splits
from featherfx.mechanics.batch import barb_course, has_elastic_clamp, make_model, may_slip, resized
from featherfx.mechanics.model import Loads, Model
from featherfx.phases import counted
from featherfx.shot.detail.cycle import Cycle
from featherfx.shot.detail.detail import Resolution
from featherfx.shot.direction.channels import courses
from featherfx.shot.direction.material_channels import NAMES, Blown, Matter, matter_of
from featherfx.shot.direction.targets import Pulls, pulls_of
from featherfx.shot.frames import FeatherPose
from featherfx.shot.islands import ALONE
from featherfx.shot.loads.forces import force_weights, grip_node
from featherfx.shot.loads.loads import frame_loads
from featherfx.shot.loads.types import Force, Grip
from featherfx.shot.loads.wet import Water
from featherfx.shot.loads.wind import exposures, sheltered
from featherfx.shot.motion.roots import Roots, arrived
from featherfx.shot.patterns import last_fitting
from featherfx.shot.types import Shot
from featherfx.solver.solver import Settings, Solver, compile_steps
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.modes import with_damping

# Newton stops at this fraction of the step's tolerance from the step's solution: what is left adds
# as much to the step's error, and less costs more (docs/log.md)
NEWTON_FRACTION = 0.1
# the same where forces of contact follow from the poses, so that feathers in balance come to rest;
# and m, a small part of what any gap may be off, below which that says nothing
CONTACT_NEWTON_FRACTION, CONTACT_NEWTON = 1e-3, 2e-7
# places of a groom whose maps are kept together
PART = 128


@dataclass
class Group:
    """Feathers that share a grid: their places in the groom, solver, state and loads.

    resolution: what is simulated. exposure: to the air (loads/wind.py). island: of feathers that
    may touch (islands.py). feathers: as simulated. maps: to the meshes' grid, where that is another
    one. own: model of dry feathers that nothing directs. cycle: of a shot that repeats. water: of
    feathers that are wet at times. free: s, time at which they leave their roots, None: never.
    matter: as channels have it. blown: channels of wind, and felt: how much of each acts
    (direction/matter.py). pulls: towards shapes (direction/targets.py).
    """

    resolution: Resolution
    exposure: float
    island: int
    members: Indices
    feathers: list[Feather]
    maps: list[RowMap | None]
    names: list[str]
    grips: list[tuple[int, Grip]]
    forces: list[tuple[int, Force, Array]]
    solver: Solver
    own: Model
    state: State
    start: Array
    loads: Loads | None = None
    cycle: Cycle | None = None
    water: Water | None = None
    free: float | None = None
    matter: Matter | None = None
    blown: Blown | None = None
    felt: tuple[float, ...] = ()
    pulls: Pulls | None = None

    @property
    def level(self) -> str:
        """Of detail."""
        return self.resolution.level

    @cached_property
    def carrier(self) -> PointCarrier | None:
        """To the meshes' grid, where that is another one."""
        maps = [each for each in self.maps if each is not None]
        return PointCarrier(maps) if maps else None

    @property
    def flying(self) -> bool:
        """Whether the feathers have left their roots."""
        return not self.solver.model.held.any()

    def leave_roots(self) -> None:
        """From here on the feathers are free, with the velocities that they have."""
        model = self.solver.model
        self.solver.model = model._replace(held=np.zeros_like(model.held))

    def begin_anew(self, step: float) -> None:
        """The next step, of `step` s, finds the accelerations first: what acts has changed."""
        self.state = self.state.copy()
        self.state.step[:], self.state.proposal[:] = 0.0, step

    @property
    def changes(self) -> bool:
        """Whether its model is another one at times."""
        return self.water is not None or (self.matter is not None and self.matter.changes_model)

    def renew(self, time: float) -> bool:
        """Give the solver the model at a time (s since the first frame); whether it is new."""
        wet = self.water is not None and self.water.soak(time)
        other = self.matter is not None and self.matter.renew(time)
        if wet or other:
            model = self.own if self.matter is None else self.matter.model(self.own)
            model = model if self.water is None else self.water.model(model)
            self.solver.model = model._replace(held=self.solver.model.held)
        return wet or other


class _Alike(NamedTuple):
    """What feathers of one batch have in common. taper: of barbs. clamp: whether it is elastic.
    wet, free: number of the rule, or -1. felt: of Group."""

    island: int
    resolution: Resolution
    taper: Hashable
    clamp: bool
    hooked: bool
    exposure: float
    wet: int
    free: int
    felt: tuple[float, ...]


def make_groups(
    shot: Shot,
    drawn: Sequence[Feather],
    resolutions: Sequence[Resolution],
    solved: Indices,
    motion: Roots,
    jobs: int,
    islands: Indices,
    time: float = 0.0,
) -> list[Group]:
    """Batches of feathers of one island, grid, barb taper, clamp, hooks, exposure, wetness,
    freedom and felt wind, at a time in s.

    drawn: all feathers of the groom on the meshes' grid. resolutions: of each. solved: numbers of
    the feathers that are wanted, of which those that are simulated come into batches. islands:
    (F,) numbers, or ALONE.
    """
    alike: dict[_Alike, list[int]] = {}
    exposed, placements = exposures(shot).tolist(), shot.groom.feathers
    wets, detachments = (
        last_fitting(shot.wets, placements),
        last_fitting(shot.detachments, placements),
    )
    blown, directing = Blown(shot), courses(shot, NAMES)
    for index in solved.tolist():
        kind, resolution = placements[index].kind, resolutions[index]
        if resolution.is_simulated:
            taper, clamp = barb_course(kind), has_elastic_clamp(kind)
            hooked = _slips(kind, resolution)
            rules = exposed[index], wets[index], detachments[index], blown.weights[index]
            key = _Alike(int(islands[index]), resolution, taper, clamp, hooked, *rules)
            alike.setdefault(key, []).append(index)
    groups = [
        _group(shot, drawn, np.array(members), key, motion, jobs, time)
        for key, members in counted("building", alike.items(), len(alike))
    ]
    for group in groups:
        group.blown = blown
        group.matter = matter_of(directing, group.members, np.asarray(shot.gravity))
    return groups


def give_cycles(shot: Shot, groups: Sequence[Group], subframes: int) -> None:
    """Give cycles to batches that may repeat: what slips, dries, is directed or leaves does not."""
    for group in groups:
        if not group.changes and group.free is None and not group.solver.model.hooked:
            tolerance, count = group.solver.settings.tolerance, len(group.members)
            group.cycle = Cycle(shot.cycle * subframes, tolerance, count)


def _group(
    shot: Shot,
    drawn: Sequence[Feather],
    members: Indices,
    key: _Alike,
    motion: Roots,
    jobs: int,
    time: float,
) -> Group:
    quality, resolution = shot.quality, key.resolution
    placements = [shot.groom.feathers[i] for i in members]
    grid = resolution.rows, resolution.columns
    some = [drawn[i] for i in members]
    as_drawn = grid == (some[0].rows, some[0].columns)
    feathers = some if as_drawn else build_feathers(placements, *grid)
    pushes = shot.contact is not None and key.island != ALONE
    model = model_of(placements, feathers, resolution, pushes)
    positions, rotations = motion.frames(time)
    state = rest_state(model, positions[members], rotations[members])
    state.time[:] = time
    place = {p.id: k for k, p in enumerate(placements)}
    newton = NEWTON_FRACTION * resolution.tolerance
    if pushes:
        newton = min(newton, max(CONTACT_NEWTON_FRACTION * resolution.tolerance, CONTACT_NEWTON))
    settings = Settings(
        tolerance=resolution.tolerance,
        newton=newton,
        max_substeps=quality.max_substeps,
        spectral_radius=quality.spectral_radius,
    )
    return Group(
        resolution=resolution,
        exposure=key.exposure,
        island=key.island,
        members=members,
        feathers=feathers,
        maps=maps_between(members, placements, feathers, some),
        names=[p.id for p in placements],
        grips=grips_of([p.id for p in placements], shot.grips),
        forces=[
            (place[each.feather], each, force_weights(each, feathers[place[each.feather]]))
            for each in shot.forces
            if each.feather in place
        ],
        solver=Solver(model, settings, jobs),
        own=model,
        state=state,
        start=state.points.nodes.copy(),
        water=None if key.wet < 0 else Water(shot.wets[key.wet], feathers, placements),
        free=None if key.free < 0 else shot.time_of(shot.detachments[key.free].frame),
        felt=key.felt,
        pulls=pulls_of(shot, drawn, feathers, members, motion, model),
    )


def grips_of(names: Sequence[str], grips: Sequence[Grip]) -> list[tuple[int, Grip]]:
    """Those on a batch of feathers with these ids, each with its place in the batch."""
    place = {name: k for k, name in enumerate(names)}
    return [(place[each.feather], each) for each in grips if each.feather in place]


def pulled(group: Group, pulls: Sequence[tuple[Grip, Array]]) -> list[tuple[int, Grip]]:
    """Grips on a group that lead their points to places (3,) m in the world, all the time."""
    found = []
    for grip, to in pulls:
        for place, each in grips_of(group.names, [grip]):
            start = group.start[place][grip_node(each, group.feathers[place])]
            led = replace(each, displacement=to - start, start=-np.inf, end=-np.inf)
            found.append((place, led))
    return found


def model_of(
    placements: Sequence[Placement],
    feathers: Sequence[Feather],
    resolution: Resolution,
    touching: bool,
) -> Model:
    """Constant arrays of a batch: made once for feathers of one shape, or of one shape and size
    where their materials do not follow from the size.

    touching: whether loose barbs do not pass through each other. Of what is not solved, nothing is
    damped.
    """
    units = [_of_unit_size(each, resolution) for each in placements]
    shapes: list[tuple[Any, ...]] = [
        (id(unit), p.mirrored) if unit else (id(p.prototype or p.kind), p.kind, p.size, p.mirrored)
        for p, unit in zip(placements, units, strict=True)
    ]
    first: dict[tuple[Any, ...], int] = {}
    for k, shape in enumerate(shapes):
        first.setdefault(shape, k)
    number = {shape: n for n, shape in enumerate(first)}
    own = [(placements[k], units[k], feathers[k]) for k in first.values()]
    grid = resolution.rows, resolution.columns

    def compute() -> dict[str, Any]:
        some = [
            build_feather(unit, *grid, placement.mirrored) if unit else feather
            for placement, unit, feather in own
        ]
        kinds = [_as_simulated(unit or placement.kind, resolution) for placement, unit, _ in own]
        model = make_model(some, kinds, resolution.coefficients, touching)
        if not resolution.is_simulated:
            return model.arrays()
        compile_steps(model)  # while this process finds frequencies
        return with_damping(model, kinds).arrays()

    inputs = [_constant(placement, unit) for placement, unit, _ in own]
    how = resolution.level, *grid, resolution.coefficients, touching
    found = Model.from_arrays(kept("models", [inputs, *how], compute))
    model = found.some([number[shape] for shape in shapes])
    sizes = [1.0 if unit is None else p.size for p, unit in zip(placements, units, strict=True)]
    return resized(model, np.array(sizes)) if any(units) else model


def _constant(placement: Placement, unit: FeatherKind | None) -> list[Any]:
    """What the constants of a feather, or of one of unit size, depend on."""
    if unit is not None:
        return [unit.uncoloured, placement.mirrored]
    kind, prototype = placement.kind, placement.prototype
    shape = prototype and prototype.uncoloured
    return [kind.uncoloured, shape, placement.size, placement.mirrored]


def _of_unit_size(placement: Placement, resolution: Resolution) -> FeatherKind | None:
    """The kind that a feather is `size` times as large as, if all of its constants follow."""
    unit = placement.prototype
    if unit is None or unit.scaling != "similar" or _slips(unit, resolution):
        return None
    return unit if adjusted(unit, Change(scale=placement.size)) == placement.kind else None


def _slips(kind: FeatherKind, resolution: Resolution) -> bool:
    """Hooks of vanes that are simulated with less detail hold."""
    return resolution.level == "full" and may_slip(kind)


def _as_simulated(kind: FeatherKind, resolution: Resolution) -> FeatherKind:
    if _slips(kind, resolution) or not may_slip(kind):
        return kind
    return replace(
        kind,
        vane_material=replace(kind.vane_material, hooks="closed"),
        leading=replace(kind.leading, splits=Splits()),
        trailing=replace(kind.trailing, splits=Splits()),
    )


def loads_within(
    shot: Shot, group: Group, motion: Roots, start: float, end: float, gripped: bool
) -> Loads:
    """What acts on a group from start to end (s).

    gripped: whether grips act. They take hold of the settled feathers, so not while those settle.
    """
    roots = None
    if shot.wind_source is not None:
        roots = motion.frames(0.5 * (start + end))[0][group.members]
        roots = group.state.centre[:, 0] if group.flying else roots
    grips = group.grips if gripped else []
    points = list(group.start)
    loads = frame_loads(shot, grips, group.feathers, points, start, end, roots, group.forces)
    if group.pulls is not None:
        loads = group.pulls.added(loads, start, end)
    if group.blown is not None:
        loads = group.blown.through(loads, group.felt, 0.5 * (start + end))
    if group.matter is not None:
        loads = group.matter.weighed(loads, group.solver.model.mass, start, end)
    if group.water is not None:
        loads = group.water.through(loads)
    if group.exposure == 1.0 or group.flying:
        return loads
    before, after = arrived(motion, start), motion.frames(end)
    way = (after.positions - before.positions)[group.members]
    return sheltered(loads, group.exposure, way, end - start)


def poses_of(group: Group) -> dict[int, FeatherPose]:
    """Return points and rates of a group's feathers, by their numbers, on the grid of the
    meshes."""
    state, hooked = group.state, group.solver.model.hooked
    numbers = group.members.tolist()
    if (carrier := group.carrier) is not None:
        every = np.arange(len(numbers))
        moving = carrier(every, state.points, state.velocity, state.acceleration)
        each = moving.points.each(), moving.velocities.each(), moving.accelerations.each()
        given = zip(numbers, *each, strict=True)
        return {f: FeatherPose(points, rate, second) for f, points, rate, second in given}
    found = {}
    for k, f in enumerate(numbers):
        gaps = state.gaps_of(k) if hooked else None
        points, rate, second = state.points.at(k), state.velocity.at(k), state.acceleration.at(k)
        found[f] = FeatherPose(points, rate, second, gaps)
    return found


def maps_between(
    members: Indices,
    placements: Sequence[Placement],
    simulated: Sequence[Feather],
    drawn: Sequence[Feather],
) -> list[RowMap | None]:
    """From the simulated grids to those drawn; None where they are the same. members: numbers in
    the groom, ascending."""
    if not placements or simulated[0].cell.shape == drawn[0].cell.shape:
        return [None] * len(placements)
    coarse, fine = simulated[0], drawn[0]
    grids = (coarse.rows, coarse.columns), (fine.rows, fine.columns)
    # one map for all feathers that differ in size only; a wind in which some feathers are simulated
    # otherwise leaves most parts of a groom as they were
    known: dict[tuple[int, bool], RowMap] = {}
    for part in np.split(np.arange(len(members)), np.flatnonzero(np.diff(members // PART)) + 1):
        own = {}
        for placement in (placements[k] for k in part):
            shape = placement.prototype or placement.kind
            if (id(shape), placement.mirrored) not in known:
                own[id(shape), placement.mirrored] = shape, placement.mirrored
        known |= zip(own, build_unit_maps(tuple(own.values()), *grids), strict=True)
    found: list[RowMap | None] = []
    for placement in placements:
        unit = known[id(placement.prototype or placement.kind), placement.mirrored]
        size = placement.size if placement.prototype is not None else 1.0
        found.append(scaled_map(unit, size, coarse.rows))
    return found
