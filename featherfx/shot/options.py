"""Options of every feather of a shot: resolved once, before the first frame.

Shot, quality, level of detail and the error that is asked for give one FeatherOptions for each
feather. All that is simulated later takes grids and tolerances from there.

The meshes always have the quality's rows and columns; a feather that is simulated on another grid
is carried over to them (featherfx/feather/density.py). Levels of detail:

    full      the rows and columns that the quality or its error asks for
    coarse    half of both, one coefficient
    rachis    half the rows, one column of rigid barbs
    guided    nothing is solved: follows simulated feathers of its region
    rigid     nothing is solved: the rest shape follows the root
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Flags, Indices
from featherfx.errors import Problem, require
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.resolution import GRID_SCALE, coefficients_for, may_slip, rows_for
from featherfx.packages import brought, load_name
from featherfx.shot.loads import (
    Deflection,
    LoadEstimate,
    estimate_deflections,
    estimate_loads,
    vane_pressure,
)
from featherfx.shot.patterns import UNSOLVED_LEVELS, last_fitting
from featherfx.shot.roots import Roots
from featherfx.shot.types import MeasuredGrid, Quality, Shot, may_touch
from featherfx.solver.solver import Settings

# the options that a shot decides, in the order in which they are told
_NAMES = (
    "level", "rows", "columns", "coefficients", "tolerance", "newton_tolerance", "max_substeps",
    "spectral_radius", "contact_tolerance", "unpressed_newton_tolerance",
)  # fmt: skip
# the solver's name of an option
_FIELDS = {"newton_tolerance": "newton"}
# value of a quality's key by which the number is chosen here
CHOSEN = -1
# fewest rows and columns of feathers with less than full detail
_MIN_ROWS, _MIN_COLUMNS = 6, 2
# Newton stops at this fraction of the step's tolerance from the step's solution: what is left adds
# as much to the step's error, and less costs more
NEWTON_RATIO = 0.1
# the same where forces of contact follow from the poses, so that feathers in balance come to rest;
# and m, a small part of what any gap may be off, below which that says nothing
_CONTACT_NEWTON_RATIO, _MIN_CONTACT_NEWTON = 1e-3, 2e-7
# displacement that one more round of contact may cause, over the tolerance of steps
_CONTACT_RATIO = 0.05
# rows, columns and coefficients that keep an error: each errs by about half of the one before
SPACE = (
    (6, 2, 1), (8, 3, 1), (11, 4, 1), (15, 4, 2), (21, 6, 2), (29, 8, 2), (41, 10, 3), (57, 12, 3),
)  # fmt: skip
SPACE_NUMBERS = "rows", "columns", "coefficients"
# tolerances over the length, likewise
TIME = (2.2e-2, 8e-3, 3e-3, 1.2e-3, 4.5e-4, 1.7e-4, 6.5e-5, 2.5e-5, 1e-5)
# bound of the quality's key; to begin with, an error times the square of intervals of rows, and the
# tolerance over the error; tolerances per octave, so
# that feathers of about one length stay together
MAX_COEFFICIENTS, _ROW_RATIO, _STEP_RATIO, _TOLERANCES_PER_OCTAVE = 6, 2.0, 0.1, 2


def first_grid(error: float) -> MeasuredGrid:
    """Return the grid to begin with for an error over the length."""
    return MeasuredGrid(first_space(error), first_time(error), math.inf, True)


@dataclass(frozen=True, kw_only=True)
class FeatherOptions(Settings):
    """Options of one feather, beside those of its steps in Settings.

    level: of detail. rows: of nodes along the rachis, columns: of nodes along each barb,
    coefficients: of curvature per barb and direction. Of guided and rigid feathers, rows and
    columns are those of the obstacle that others meet. contact_tolerance: m, what a gap of this
    feather may be off; contact keeps to the smallest of those that may touch. Feathers that differ
    in that alone are stepped in one batch. unpressed_newton_tolerance: m, of a feather that nothing
    presses, where that may be more. Both are None where it pushes nothing. sources: of each option
    the key, preset, table or rule that it comes from.
    """

    level: str
    rows: int
    columns: int
    coefficients: int
    contact_tolerance: float | None = field(default=None, compare=False)
    unpressed_newton_tolerance: float | None = None
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    @property
    def is_simulated(self) -> bool:
        """Return whether anything is solved of the feather."""
        return self.level not in UNSOLVED_LEVELS

    def values(self) -> dict[str, Any]:
        """Return every option that a shot decides by its name."""
        return {name: getattr(self, _FIELDS.get(name, name)) for name in _NAMES}

    def by(self, source: str, **values: Any) -> FeatherOptions:
        """Return the options with other values, all of them from a source."""
        sources = {**self.sources, **dict.fromkeys(values, source)}
        fields = {_FIELDS.get(name, name): value for name, value in values.items()}
        return replace(self, **fields, sources=sources)

    def at_level(self, level: str, quality: Quality) -> FeatherOptions:
        """Return the options of full detail at another level."""
        if level == "full":
            return self
        if level in UNSOLVED_LEVELS:
            grid = {"rows": quality.rows, "columns": quality.own_columns, "coefficients": 0}
            return self.by(f"level {level}: the grid of the meshes", level=level, **grid)
        rows = min(self.rows, max(_MIN_ROWS, (self.rows + 1) // 2))
        columns = min(self.columns, max(_MIN_COLUMNS, (self.columns + 1) // 2))
        grid = {"rows": rows, "columns": columns, "coefficients": min(self.coefficients, 1)}
        if level == "rachis":
            grid |= {"columns": 1, "coefficients": 0}
        return self.by(f"level {level}: half of full detail at most", level=level, **grid)


@dataclass(frozen=True)
class ShotOptions:
    """The options of all feathers of a shot.

    feathers: of each. full: of each as it would be in full detail. free: (F,) which leave their
    roots. measured: of each, what was found on the sample of its stratum, or the levels to begin
    with where nothing is solved of it; empty where no error is promised. is_measured: whether the
    time sufficed for that. promised_error: over a feather's length, None: none is promised, and
    why_not_promised.
    """

    feathers: tuple[FeatherOptions, ...]
    full: tuple[FeatherOptions, ...]
    free: Flags
    measured: tuple[MeasuredGrid, ...]
    is_measured: bool
    promised_error: float | None
    why_not_promised: str

    @property
    def simulated(self) -> Flags:
        """(F,) which feathers are solved."""
        return np.array([each.is_simulated for each in self.feathers], dtype=np.bool_)

    @property
    def leading(self) -> Indices:
        """Numbers of the feathers that may guide others: solved, and never free."""
        return np.flatnonzero(self.simulated & ~self.free)

    def at_level(self, level: str) -> Indices:
        """Return the numbers of the feathers at a level."""
        return np.flatnonzero([each.level == level for each in self.feathers])


def resolve_options(
    shot: Shot,
    feathers: Sequence[Feather],
    motion: Roots,
    until: float = math.inf,
    keep: Callable[..., Any] = lambda what, inputs, compute: compute(),
) -> ShotOptions:
    """Resolve how every feather of a shot is simulated.

    feathers: as the meshes have them. until: s of CPU time of this process when measuring ends.
    keep: as ShotRun.kept.
    Raises InputError for feathers that are not simulated but pulled, or that lack guides.
    """
    quality, placements = simulation_quality(shot), shot.groom.feathers
    source_of = _QualitySources(shot)
    free = np.array(last_fitting(shot.detachments, placements), dtype=np.int64) >= 0
    levels = _choose_levels(shot, motion, free, source_of)
    given = given_by_quality(quality, source_of)
    full = [given] * len(feathers)
    pushing = np.zeros(len(feathers), dtype=np.bool_)
    if shot.contact is not None:
        pushing = np.array(may_touch(shot, shot.contact), dtype=np.bool_)
    # what is drawn of feathers on a grid of their own would pass where that touches; in a coat,
    # chords of neighbours lie alike
    as_drawn = pushing & np.array([each.leaf is None for each in placements], dtype=np.bool_)
    as_drawn &= quality.tolerance is not None
    measured: Sequence[MeasuredGrid] = ()
    is_measured = True
    if quality.promised is not None or CHOSEN in (quality.coefficients, quality.simulated_rows):
        solved = [f for f, (level, _) in enumerate(levels) if level not in UNSOLVED_LEVELS]
        looked_at = [*range(len(feathers))] if quality.promised is None else solved
        found = keep("loads", looked_at, lambda: estimate_loads(shot, motion, looked_at)._asdict())
        loads = LoadEstimate(**found)
        deflections = estimate_deflections(shot, feathers, loads, frozenset(looked_at))
        if quality.promised is not None:
            measure = load_name("loop.grids:measure_grids")
            some = np.array([f for f in solved if not as_drawn[f]], dtype=np.int64)
            found = measure(shot, some, loads, deflections, free, until)
            is_measured = found is not None
            measured = found or [first_grid(quality.promised)] * len(feathers)
            why = f"measured for an error of {100.0 * quality.promised:g} % ({source_of('error')})"
        for f, (feather, placement) in enumerate(zip(feathers, placements, strict=True)):
            kind, bent = placement.kind, deflections[f]
            if measured and not as_drawn[f]:
                own = _measured_options(full[f], quality, kind.length, measured[f], why)
            else:
                pressure = vane_pressure(kind, loads, f)
                own = choose_grid(full[f], quality, feather, kind, bent, pressure)
            if may_slip(kind):
                own = own.by(f"hooks that slip ({source_of('columns')})", columns=quality.columns)
            if quality.coefficients == CHOSEN and not kind.vane_material.ribbon:
                # the vane's shear bends barbs as well, and what pulls or bears them bends them more
                least = 2 if bent.is_pulled or free[f] else 1
                if own.coefficients < least:
                    source = "grip, force or free flight" if least > 1 else "shear of the vane"
                    own = own.by(source, coefficients=least)
            full[f] = own
    full = [_of_kind(own, shot, p.kind, source_of) for own, p in zip(full, placements, strict=True)]
    if measured and (pushing & ~as_drawn).any():
        full = _in_coats(shot, full, np.flatnonzero(pushing), given)
    common = common_tolerance(shot) if pushing.any() else 0.0
    for f in range(len(placements)):
        if pushing[f]:
            full[f] = _in_contact(full[f], shot, common)
        else:
            newton = NEWTON_RATIO * full[f].tolerance
            full[f] = full[f].by(f"{NEWTON_RATIO:g} of tolerance", newton_tolerance=newton)
    resolved = tuple(
        each.at_level(level, quality).by(source, level=level)
        for each, (level, source) in zip(full, levels, strict=True)
    )
    return ShotOptions(resolved, tuple(full), free, tuple(measured), is_measured, *_promise(shot))


def common_tolerance(shot: Shot) -> float:
    """Return the tolerance (m) of what concerns all feathers of a shot: contact, and whether roots
    begin at rest. Without one, that of a feather of median length to begin with."""
    quality = shot.quality.pushing
    if quality.tolerance is not None:
        return quality.tolerance
    error = quality.promised
    assert error is not None
    length = float(np.median([each.kind.length for each in shot.groom.feathers] or [1.0]))
    return length * TIME[first_time(error)]


def first_space(error: float) -> int:
    """Return the level of SPACE to begin with for an error over the length."""
    fits = (k for k, (rows, _, _) in enumerate(SPACE) if error * (rows - 1) ** 2 >= _ROW_RATIO)
    return next(fits, len(SPACE) - 1)


def first_time(error: float) -> int:
    """Return the level of TIME to begin with for an error over the length."""
    return next((k for k, each in enumerate(TIME) if each <= _STEP_RATIO * error), len(TIME) - 1)


def stepped_down(tolerance: float) -> float:
    """Return the next lower of the tolerances (m) that there are."""
    octaves = math.floor(_TOLERANCES_PER_OCTAVE * math.log2(tolerance)) / _TOLERANCES_PER_OCTAVE
    return float(2.0**octaves)


class _QualitySources:
    """Sources of the values of a shot's quality, by key."""

    def __init__(self, shot: Shot) -> None:
        self._quality, self._known = shot.quality, dict[str, str]()
        own = ("shot.quality.", "presets.quality/")
        self._inputs = {key: text for key, text in shot.inputs.items() if key.startswith(own)}

    def __call__(self, key: str) -> str:
        """Return the key of the shot, the preset, or "default"."""
        if key not in self._known:
            self._known[key] = self._find(key)
        return self._known[key]

    def _find(self, key: str) -> str:
        value, name = getattr(self._quality, key), self._quality.name
        # integers of a file may be numbers here
        texts = json.dumps(value), f"{value:g}" if isinstance(value, float) else ""
        said = [each for each, text in self._inputs.items() if text in texts]
        presets = [each.partition("/")[2] for each in said if each.endswith(f".{key}")]
        if f"shot.quality.{key}" in said:
            return f"quality.{key}"
        if presets:
            return f"quality preset {presets[0].removesuffix(f'.{key}')}"
        # a preset that has come in place of the shot's is not among what its files say
        is_read = any(each.startswith(f"presets.quality/{name}.") for each in self._inputs)
        is_default = value == getattr(Quality(name=""), key)
        return "default" if is_read or is_default else f"quality preset {name}"


def simulation_quality(shot: Shot) -> Quality:
    """Return the quality by which feathers are simulated: where they push each other, with its
    tolerance for that."""
    if shot.contact is None:
        return shot.quality
    return replace(shot.quality.pushing, error=shot.quality.error)


def _pulled(shot: Shot) -> set[str]:
    """Return the ids of the feathers that a grip or a force acts on."""
    return {grip.feather for grip in shot.grips} | {force.feather for force in shot.forces}


def given_by_quality(quality: Quality, source_of: Any = str) -> FeatherOptions:
    """Return the options that the numbers of a quality give. source_of: of its keys."""
    few_rows, few_columns = quality.simulated_rows > 0, quality.simulated_columns > 0
    keys = {
        "rows": "simulated_rows" if few_rows else "rows",
        "columns": "simulated_columns" if few_columns else "columns",
        "coefficients": "coefficients",
        "tolerance": "tolerance",
        "max_substeps": "max_substeps",
        "spectral_radius": "spectral_radius",
    }
    if quality.tolerance is not None and quality.tolerance == quality.contact_tolerance:
        keys["tolerance"] = "contact_tolerance"
    return FeatherOptions(
        level="full",
        rows=min(quality.simulated_rows, quality.rows) if few_rows else quality.rows,
        columns=quality.own_columns,
        coefficients=quality.coefficients,
        # where an error is promised, it is measured
        tolerance=quality.tolerance or 0.0,
        max_substeps=quality.max_substeps,
        spectral_radius=quality.spectral_radius,
        sources={name: source_of(key) for name, key in keys.items()},
    )


def choose_grid(
    given: FeatherOptions,
    quality: Quality,
    feather: Feather,
    kind: FeatherKind,
    deflection: Deflection,
    pressure: float,
) -> FeatherOptions:
    """Choose the rows and coefficients of a feather where a quality leaves them open (-1).

    The fewest whose error stays below GRID_SCALE tolerances. given: by the numbers of the quality.
    feather: as the meshes have it. deflection: m. pressure: Pa, on its vane.
    """
    assert quality.tolerance is not None
    own, most = given, GRID_SCALE * quality.tolerance
    if quality.simulated_rows == CHOSEN:
        rows = rows_for(deflection.rachis, most, quality.rows)
        own = own.by("deflection and tolerance", rows=rows)
    if quality.coefficients == CHOSEN:
        count = coefficients_for(feather, kind, _doubled(pressure), most)
        own = own.by("deflection and tolerance", coefficients=count)
    return own


def _measured_options(
    given: FeatherOptions, quality: Quality, length: float, measured: MeasuredGrid, why: str
) -> FeatherOptions:
    """Return the options that were measured for a feather of a length (m), but for what the
    quality's own numbers say. why: source of the error that is asked for."""
    own = given_grid(quality)
    grid = zip(SPACE_NUMBERS, SPACE[measured.space], strict=True)
    found: dict[str, Any] = {name: number for name, number in grid if name not in own}
    if not quality.tolerance:
        found["tolerance"] = stepped_down(TIME[measured.time] * length)
    return given.by(why, **found)


def given_grid(quality: Quality) -> dict[str, int]:
    """Return those of SPACE_NUMBERS that a quality gives, which overrule measured ones."""
    rows, columns = (each or CHOSEN for each in (quality.simulated_rows, quality.simulated_columns))
    numbers = rows, columns, quality.coefficients
    return {name: each for name, each in zip(SPACE_NUMBERS, numbers, strict=True) if each != CHOSEN}


def _doubled(pressure: float) -> float:
    """Return the next power of two: loads within a factor of two are treated alike."""
    return float(2.0 ** np.ceil(np.log2(max(pressure, 1e-9))))


def _of_kind(
    own: FeatherOptions, shot: Shot, kind: FeatherKind, source_of: _QualitySources
) -> FeatherOptions:
    """Return the options with what follows from the kind: the tolerance is at most a part of the
    length, but where feathers push each other and take common steps; splits are drawn where they
    are simulated."""
    if shot.quality.tolerance is not None and shot.contact is None:
        most = stepped_down(shot.quality.relative_tolerance * kind.length)
        if most < own.tolerance:
            why = f"relative_tolerance ({source_of('relative_tolerance')})"
            own = own.by(why, tolerance=most)
    if may_slip(kind):
        own = own.by(f"hooks that slip ({source_of('rows')})", rows=shot.quality.rows)
    return own


def _in_contact(own: FeatherOptions, shot: Shot, common: float) -> FeatherOptions:
    """Return the options of a feather that pushes others. common: m, tolerance of all of these."""
    assert shot.contact is not None
    newton = max(_CONTACT_NEWTON_RATIO * own.tolerance, _MIN_CONTACT_NEWTON)
    newton = min(NEWTON_RATIO * own.tolerance, newton)
    own = own.by("tolerance, in contact", newton_tolerance=newton)
    own = own.by(f"{_CONTACT_RATIO:g} of tolerance", contact_tolerance=_CONTACT_RATIO * common)
    own = own.by("tolerance", unpressed_newton_tolerance=NEWTON_RATIO * common)
    if shot.contact.max_steps <= own.max_substeps:
        own = own.by("[contact] max_steps", max_substeps=shot.contact.max_steps)
    return own


def _in_coats(
    shot: Shot, full: Sequence[FeatherOptions], pushing: Indices, given: FeatherOptions
) -> list[FeatherOptions]:
    """Return the options of all feathers, those that push others on no finer grid than the given
    one of the meshes, and on that where a coarser one has them through each other at rest."""
    found, placements = list(full), shot.groom.feathers
    own = [found[f] for f in pushing]
    grids = [(min(each.rows, given.rows), min(each.columns, given.columns)) for each in own]
    refine = load_name("contact.pairs:finer_where_crossed")
    fine = given.rows, given.columns
    grids = refine([placements[f] for f in pushing], shot.contact, grids, fine)
    for f, (rows, columns) in zip(pushing.tolist(), grids, strict=True):
        if (rows, columns) != (found[f].rows, found[f].columns):
            found[f] = found[f].by("meshes, in contact", rows=rows, columns=columns)
    return found


def _promise(shot: Shot) -> tuple[float | None, str]:
    """Return the error that is promised over a feather's length, or why none is."""
    error = simulation_quality(shot).promised
    if error is None and shot.quality.promised is None:
        return None, "the quality has a tolerance and no error"
    if error is None or shot.contact is not None:
        return None, "feathers push each other ([contact] forces); a report measures their error"
    return error, ""


def _choose_levels(
    shot: Shot, motion: Roots, free: Flags, source_of: _QualitySources
) -> list[tuple[str, str]]:
    """Choose the level of every feather, and tell its source.

    By the last [[detail]] that fits the feather, else by its length; where the shot asks for that,
    by its size in the image. free: (F,) which leave their roots.
    """
    placements, entries = shot.groom.feathers, last_fitting(shot.details, shot.groom.feathers)
    pulled, factor = _pulled(shot), length_factor(shot)
    levels = [
        (shot.details[entry].level, f"[[detail]] {entry + 1}")
        if entry >= 0
        else _level_of_length(shot, placement.kind.length / factor, source_of)
        for placement, entry in zip(placements, entries, strict=True)
    ]
    problems = [
        Problem(str(shot.source), "detail", f"feather '{placement.id}' is {level}, but {why}")
        for placement, (level, _), is_free in zip(placements, levels, free, strict=True)
        for why in (
            *(["a grip or a force pulls it"] if placement.id in pulled else []),
            *(["it leaves its root"] if is_free else []),
        )
        if level in UNSOLVED_LEVELS
    ]
    require(*problems)
    # no camera changes these, as the level of a vane whose slip a new one would lose
    pinned = [
        entry >= 0 or p.id in pulled or may_slip(p.kind) or bool(is_free)
        for p, entry, is_free in zip(placements, entries, free, strict=True)
    ]
    for refine in brought(shot, "levels"):
        levels = refine(shot, motion, levels, entries, pinned)
    return levels


def _level_of_length(shot: Shot, length: float, source_of: _QualitySources) -> tuple[str, str]:
    """Return the level that a quality gives feathers of a length (m), and its source."""
    for level in ("rigid", "guided", "rachis", "coarse"):
        if length < getattr(shot.quality, key := f"{level}_below"):
            return level, f"{key} ({source_of(key)})"
    return "full", "default"


def length_factor(shot: Shot) -> float:
    """Return the factor of the quality's lengths on the shot's body."""
    if not shot.quality.body_size or not shot.groom.feathers:
        return 1.0
    corners = shot.skin_corners()
    places = [each.position for each in shot.groom.feathers]
    points = np.reshape(places if corners is None else corners, (-1, 3))
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if corners is None:
        # a feather on its own has no box
        size = max(size, *(each.kind.length for each in shot.groom.feathers))
    return size / shot.quality.body_size
