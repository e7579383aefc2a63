"""The error of feathers that push each other, measured on patches of a shot.

A patch is a feather that loads bend most of its kind, and its nearest neighbours on the same grid.
It is simulated in contact where the shot begins, settling included, as the shot says, and finer:

    e = e_space + e_time,     e_space = 4/3 |x - x_s|,     e_time = 5/4 |x - x_t|

with the distances and finer settings of window_runs.py. Where a tenth of the tolerance leads
elsewhere, and a hundredth is no nearer to it, feathers have no unique answer.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import SimulationError
from featherfx.files.disk_cache import digest, kept, nothing_kept, shot_settings
from featherfx.shot.loads import estimate_deflections, estimate_loads
from featherfx.shot.loop.run import drawn_feathers, report_errors
from featherfx.shot.loop.window_runs import (
    MIN_FALL,
    REST_RATIOS,
    TIGHTER_RATIO,
    WINDOW,
    WindowRun,
    refine_quality,
    run_distance,
    simulate_window,
)
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import FeatherOptions, resolve_options
from featherfx.shot.roots import NO_RUN_UP
from featherfx.shot.types import Shot, may_touch, part_of

# patches of a shot, and feathers of a patch, at most
_MAX_PATCHES, PATCH_SIZE = 4, 3


class PatchErrors(NamedTuple):
    """Errors of S feathers in contact. feathers: (S,) numbers. error: (S,) over the length. unique:
    (S,) whether finer steps come nearer to each other, and could be solved."""

    feathers: Indices
    error: Array
    unique: Array


def add_contact_error(shot: Shot, report: Mapping[str, Any]) -> dict[str, Any]:
    """Add errors of feathers that push each other to the report of a shot (report_errors), where an
    error is asked for; or why there are none."""
    promised = shot.quality.promised
    if shot.contact is None or promised is None:
        return {**report}
    if report.get("contact", {}).get("feathers_whose_contacts_yielded"):
        # they keep no error, and finer steps are yet harder to solve
        return {**report, "error_not_promised": "contacts were left out that could not be solved"}
    arrays = kept(
        "contact-errors", [digest(shot_settings(shot))], lambda: _measured(shot)._asdict()
    )
    found = PatchErrors(**arrays)
    numbers, errors, unique = (each.tolist() for each in found)
    if not numbers:
        return {**report, "error_not_promised": "no two feathers on one grid push each other"}
    known = [(error if own else math.inf, own) for error, own in zip(errors, unique, strict=True)]
    told = {**report, **report_errors(shot, promised, dict(zip(numbers, known, strict=True)))}
    before, after = report["undefined"], told["undefined"]
    told["undefined"] = {
        kind: sorted({*before.get(kind, ()), *after.get(kind, ())}) for kind in {**before, **after}
    }
    return {key: each for key, each in told.items() if key != "error_not_promised"}


def nearest_pushing(shot: Shot, options: Sequence[FeatherOptions], centre: int) -> Indices:
    """Return the numbers, ascending, of the patch of a feather. options: of all feathers."""
    assert shot.contact is not None
    grids = [(each.is_simulated, each.rows, each.columns, each.coefficients) for each in options]
    alike = np.array([each == grids[centre] for each in grids]) & may_touch(shot, shot.contact)
    middles = np.array(
        [p.position + 0.5 * p.kind.length * p.rotation[:, 0] for p in shot.groom.feathers]
    )
    away = np.linalg.norm(middles - middles[centre], axis=1)
    near = np.flatnonzero(alike & (away < shot.groom.feathers[centre].kind.length))
    return np.sort(near[np.argsort(away[near], kind="stable")[:PATCH_SIZE]])


def _measured(shot: Shot) -> PatchErrors:
    drawn, motion = drawn_feathers(shot), root_motion(shot)
    options = resolve_options(shot, drawn, motion).feathers
    deflections = estimate_deflections(shot, drawn, estimate_loads(shot, motion), range(len(drawn)))
    found: dict[int, tuple[float, bool]] = {}
    with nothing_kept(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the bake itself warns
        for patch in _patches(shot, options, [each.rachis for each in deflections]):
            for f, error, unique in zip(
                patch.tolist(), *_errors(shot, options, patch), strict=True
            ):
                before = found.get(f, (0.0, True))
                found[f] = max(error, before[0]), bool(unique and before[1])
    numbers = sorted(found)
    return PatchErrors(
        np.array(numbers, dtype=np.int64),
        np.array([found[f][0] for f in numbers]),
        np.array([found[f][1] and math.isfinite(found[f][0]) for f in numbers], dtype=np.bool_),
    )


def _patches(shot: Shot, options: Sequence[FeatherOptions], bent: Sequence[float]) -> list[Indices]:
    """Patches about the feathers that bend most of their kind, for their length (m)."""
    assert shot.contact is not None
    placements, pushing = shot.groom.feathers, may_touch(shot, shot.contact)
    some = [f for f in range(len(bent)) if pushing[f] and options[f].is_simulated]
    some.sort(key=lambda f: -bent[f] / placements[f].kind.length)
    first: dict[str, int] = {}
    for f in some:
        first.setdefault(placements[f].kind.name, f)
    patches = dict.fromkeys(tuple(nearest_pushing(shot, options, f)) for f in first.values())
    return [np.array(each) for each in patches if len(each) > 1][:_MAX_PATCHES]


def _errors(
    shot: Shot, options: Sequence[FeatherOptions], patch: Indices
) -> tuple[list[float], list[bool]]:
    """Errors of the feathers of a patch, over their lengths, and whether they are unique."""
    promised, grid = shot.quality.promised, options[int(patch[0])]
    assert promised is not None
    part = replace(part_of(shot, patch), run_up=NO_RUN_UP, preroll=0)
    targets = tuple(each for each in shot.targets if each.points is None)
    part = replace(part, details=(), level_of_detail=None, targets=targets)
    plain = part.quality.on_grid(
        grid.rows, grid.columns, grid.coefficients, tolerance=grid.tolerance
    )
    contact = part.contact
    assert contact is not None
    lengths = [placement.kind.length for placement in part.groom.feathers]

    def run(name: str = "", times: int = 0) -> list[WindowRun] | None:
        quality = refine_quality(plain, name, times) if name else plain
        # errors of steps go with the square of their length
        steps = round(contact.steps * TIGHTER_RATIO ** (0.5 * times * (name == "time")))
        shot = replace(part, quality=quality, contact=replace(contact, steps=steps))
        try:
            return simulate_window(shot, (0, window))
        except SimulationError:
            return None

    def apart(one: list[WindowRun] | None, other: list[WindowRun] | None) -> Array:
        if one is None or other is None:
            return np.full(len(lengths), math.inf)
        pairs = zip(one, other, lengths, strict=True)
        return np.array([run_distance(a, b) / size for a, b, size in pairs])

    window = min(max(2, round(WINDOW * shot.frames_per_second)), shot.last_frame - shot.first_frame)
    own, tight = run(), run("time", 1)
    time = apart(own, tight)
    error = REST_RATIOS["time"] * time + REST_RATIOS["space"] * apart(own, run("space", 1))
    unique = np.ones(len(lengths), dtype=np.bool_)
    if (REST_RATIOS["time"] * time > promised).any():
        left = apart(tight, run("time", 2))
        unique = (time <= promised) | (left <= MIN_FALL * time)
    return error.tolist(), unique.tolist()
