"""Warnings and notes about a finished bake, from its report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from featherfx.cli.program import tell
from featherfx.errors import as_figure, some_of

# counts of a report's substeps that were too long, and what for
_TOO_LONG = {
    "substeps_over_tolerance": "{} with a local error above the tolerance",
    "substeps_with_barbs_passing": "{} in which loose barbs pass through each other",
    "substeps_with_hooks_slipping": "{} in which hooks slip by more than a step should",
}
_FIXED_STEPS = "[contact] steps"
_UNLAID = (
    "Feathers of regions lie as they were placed. Give the groom a [layout], and they lie over each"
    " other and keep to the skin as it moves"
)
_MAX_CHANGES = 12  # printed of a bake that reused samples of an earlier one


def print_bake_notes(result: dict[str, Any]) -> None:
    """Print what a bake simulated again, its warnings, and why no error is promised."""
    if again := result.get("again"):
        tell(
            f"{again['feathers_simulated']} feathers simulated again,"
            + f" {again['feathers_taken_over']} taken over from the cache that was there"
        )
        for change in again["changed"][:_MAX_CHANGES]:
            tell(f"  {change}")
        if len(again["changed"]) > _MAX_CHANGES:
            tell(f"  and {len(again['changed']) - _MAX_CHANGES} more changes")
    if cut := result.get("variation_cut"):
        tell(_cut(cut))
    print_warnings(result)
    print_missing_promise(result)


def _cut(cut: dict[str, Any]) -> str:
    """The note of feathers that vary less than their regions ask for."""
    units = {"tip": ("tips deviate", 1e3, "mm"), "roll": ("vanes roll", 1.0, "degrees")}
    parts = [
        f"{what} by {as_figure(factor * cut[key]['median'])} {unit} less at the median,"
        f" '{cut[key]['feather']}' by {as_figure(factor * cut[key]['worst'])}"
        for key, (what, factor, unit) in units.items()
        if key in cut
    ]
    return (
        f"{cut['feathers']} of {cut['coat']} feathers of the coat have no room for their variation:"
        f" {', '.join(parts)}. For more lower the density of their regions, or raise them by a"
        " [[channel]] `ruffle`"
    )


def print_warnings(result: dict[str, Any]) -> None:
    """Print the warnings that the report of a bake, or of a partition, gives reason for."""
    if result.get("worst_substeps"):
        tell("\n".join(_too_long(result)))
    if result.get("worst_unsolved"):
        tell("\n".join(_unsolved(result)))
    if (contact := result.get("contact")) and contact["steps_with_contacts_off"]:
        tell(_off(contact))
    for each in result.get("grips_at_limit", ()):
        tell(_at_limit(each))
    if over := result.get("over_promised"):
        tell(_over(result["error_promised"], over))
    if result.get("undefined"):
        tell("\n".join(_undefined(result["undefined"])))
    for text in result.get("bounds_passed", ()):
        tell(f"featherfx: warning: {text}")
    if (deep := result.get("skin_depth")) and deep["feathers_over"] and deep["unlaid"]:
        tell(_UNLAID)


def _off(contact: dict[str, Any]) -> str:
    """The warning of steps that were taken although their contacts were out of balance."""
    return (
        f"featherfx: warning: contact: {contact['steps_with_contacts_off']} of {contact['steps']}"
        " steps were taken with contacts out of balance. Within steps feathers are up to"
        f" {as_figure(1e3 * contact['worst_depth'])} mm in each other. Raise [contact] max_steps"
    )


def print_missing_promise(result: dict[str, Any]) -> None:
    """Print why a report promises no error, if it says so."""
    if why := result.get("error_not_promised"):
        tell(f"featherfx: no error is promised: {why}")


def _unsolved(result: dict[str, Any]) -> Iterator[str]:
    """The warning of steps that are no solutions: of which feathers, and where."""
    count = result["feathers_unsolved"]
    yield (
        f"featherfx: warning: {count} feather{'s have' if count > 1 else ' has'} sub-steps that"
        " were not solved: poses that feathers can have, where forces do not balance. Look at"
        " how roots move, at grips, forces and stiffness"
    )
    for each in result["worst_unsolved"]:
        far = f"{as_figure(1e3 * each['distance'], 3)} mm"
        yield f"  {each['feather']} at frame {each['frame']:g}: {far} from the solution"


def _at_limit(each: dict[str, Any]) -> str:
    """The warning of a grip whose point stayed behind."""
    return (
        f"featherfx: warning: the grip on '{each['feather']}' at row = {each['row']:g} pulls with"
        f" its largest force of {as_figure(each['force'], 3)} N from frame {each['frame']:g} on:"
        f" its point is {as_figure(1e3 * each['distance'], 3)} mm behind, and the rachis is"
        f" stretched by {as_figure(100.0 * each['strain'])} %. Shorten its displacement, or"
        " give max_force"
    )


def _over(promised: float, over: dict[str, float]) -> str:
    """The warning of kinds that the finest grids and tolerances do not bring to what was asked
    for, percent."""
    kinds = ", ".join(f"{as_figure(each)} % by {kind}" for kind, each in sorted(over.items()))
    return (
        f"featherfx: warning: an error of {promised:g} % was asked for and cannot be kept: measured"
        f" were {kinds}. Ask for that, or give numbers (rows, tolerance) instead of an error"
    )


def _undefined(undefined: dict[str, list[str]]) -> Iterator[str]:
    """The warning of feathers without a unique answer, by kind."""
    count = sum(map(len, undefined.values()))
    yield (
        f"featherfx: warning: {count} feather{'s have' if count > 1 else ' has'} no unique answer:"
        " finer grids or another start lead elsewhere, as where it flutters or has several rest"
        " poses. Shelter it from the wind, or make it stiffer"
    )
    for kind, names in sorted(undefined.items()):
        yield f"  {kind}: {some_of(names)}"


def _too_long(result: dict[str, Any]) -> Iterator[str]:
    """The warning of sub-steps that were too long: how many, why, what helps, and where."""
    count = result["feathers_over_tolerance"]
    told = "; ".join(text.format(result[key]) for key, text in _TOO_LONG.items() if result[key])
    yield (
        f"featherfx: warning: sub-steps of {count} feather{'s' if count > 1 else ''} were longer"
        f" than their errors allow: {told}."
        f" None shorter is allowed: {_shorter(result['substep_limits'])}"
    )
    for each in result["worst_substeps"]:
        yield f"  {each['feather']} at frame {each['frame']:g}: {', '.join(_why(each))}"


def _shorter(limits: dict[str, int]) -> str:
    """Name the settings that allow shorter substeps, where these limits bound them."""
    fixed = limits.get(_FIXED_STEPS)
    leave = [f"leave out {_FIXED_STEPS} = {fixed}, which fixes their number"] if fixed else []
    raised = [f"{key} ({most})" for key, most in limits.items() if key != _FIXED_STEPS]
    return ", and ".join(leave + ([f"raise {' and '.join(raised)}"] if raised else []))


def _why(each: dict[str, Any]) -> Iterator[str]:
    """List reasons why the substeps of one feather and frame were too long."""
    if count := each["substeps"]:
        over = each["error"] / each["tolerance"]
        yield (
            f"error of {as_figure(1e3 * each['error'], 3)} mm, {as_figure(over, 3)} times the"
            f" tolerance, in {_substeps(count)}"
        )
    if count := each["substeps_with_barbs_passing"]:
        yield f"loose barbs pass through each other in {_substeps(count)}"
    if count := each["substeps_with_hooks_slipping"]:
        yield f"hooks slip too far in {_substeps(count)}"


def _substeps(count: int) -> str:
    return f"{count} sub-step{'' if count == 1 else 's'}"
