"""The bounds that a written cache is held to, and sentences about those that it passes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

# of the rest length of a rachis or barb, what a written one may be off by; and the same of a
# feather that is simulated, whose material stretches
MAX_LENGTH_ERROR, MAX_SIMULATED_LENGTH_ERROR = 0.005, 0.01
# of a feather's length, a second difference of a point from one sample to the next that the rigid
# motion of its root does not explain; and times that of its root, below which it is none
MAX_JUMP, MAX_ROOT_JUMP_RATIO = 0.1, 3.0
# of a second difference, what velocities that explain it may leave: those that follow a jump by
# central differences leave three quarters, those of a motion of 2 rad a sample a third
MAX_UNEXPLAINED_RATIO = 0.5
# of the rms speed, what 99 of 100 velocities may differ by from differences of points over five
# samples, or over three before or after a kink, beyond what those over five and three differ by;
# and what 99 of 100 of these may differ by where the samples resolve the motion
MAX_VELOCITY_MISMATCH, MAX_UNRESOLVED_SPEED = 0.03, 0.05
# what keratin bears: Pa, stress at which rachises of pigeons break in bending (Corning and Biewener
# 1998, J. exp. Biol. 201, 3057), over the mean modulus of a rachis, as strength rises outwards no
# less than modulus (Wang and Meyers 2017, Acta Biomater. 48, 270, abstract); modulus where a cache
# tells none, and of what is softer, which bears no more strain (Bonser and Purslow 1995, J. exp.
# Biol. 198, 1029); kg/m^3
MAX_STRESS, KERATIN_MODULUS, KERATIN_DENSITY = 137e6, 2.5e9, 1150.0
# m, by which a vane may be under the skin where a cache does not tell its thickness (Jouve 2024,
# Numerical Modeling of Feathers, table 3.1: 103 to 155 micrometres of swans)
USUAL_THICKNESS = 1.2e-4
# of the histogram of errors: bins of a factor of two, and the exponent that the first is of
BINS_PER_OCTAVE, MIN_EXPONENT, OCTAVES = 32, -60, 100


def list_passed_bounds(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each bound that a report of the judge passes."""
    lengths, pops = report["lengths"], report["pops"]
    if lengths["feathers_over"]:
        worst = lengths["worst"][0]
        yield (
            f"{_feathers(lengths['feathers_over'])} rachises or barbs that are longer or shorter"
            f" than at rest: the {worst['part']} of {worst['feather']} at frame {worst['frame']:g}"
            f" by {_percent(worst['of_length'])} (bound {_percent(worst['bound'])})"
        )
    if pops["unexplained"]:
        worst = pops["worst_unexplained"]
        yield (
            f"{_feathers(pops['unexplained'])} points that jump: {worst['feather']} at frame"
            f" {worst['frame']:g} by {_percent(worst['of_length'])} of its length"
            f" (bound {_percent(MAX_JUMP)})"
        )
    worst = report["strain_worst"]
    if worst and worst["strain"] > worst["bound"]:
        yield (
            f"the rachis of {worst['feather']} is strained by {_percent(worst['strain'])} at frame"
            f" {worst['frame']:g}, {worst['energy']:.0f} J/kg: more than keratin bears"
            f" (bound {_percent(worst['bound'])})"
        )
    deep = report["skin_depth"]
    if deep["feathers_over"]:
        worst = deep["worst"]
        yield (
            f"{_feathers(deep['feathers_over'])} vanes in the skin: {worst['feather']} at frame"
            f" {worst['frame']:g} is {1e3 * worst['depth']:.3g} mm deep (bound: a thickness,"
            f" {1e3 * deep['thickness']:.3g} mm)"
        )
    mismatch = report["velocity_unexplained"]
    if mismatch is not None and report["velocity_resolved"] and mismatch > MAX_VELOCITY_MISMATCH:
        yield (
            f"velocities differ from the motion of the points by {_percent(mismatch)} of the rms"
            f" speed (99 of 100 by less; bound {_percent(MAX_VELOCITY_MISMATCH)}), unless they"
            " vibrate between samples, as a bake with --subframes 16 shows"
        )


def _feathers(count: int) -> str:
    return f"{count} feather{' has' if count == 1 else 's have'}"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.3g} %"
