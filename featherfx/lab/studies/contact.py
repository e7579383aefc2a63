"""Plates in contact beside closed forms, at falling tolerances and steps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from featherfx.lab.contact.experiments import ContactTest, run_contact
from featherfx.lab.studies.study import Comparisons, StudyResult, independent

_BEAM = independent("one slender cantilever of the plates' sums (Timoshenko and Young 1961)")
_COULOMB, _NEWTON = independent("Coulomb's friction"), independent("Newton's third law")
_TOLERANCES, _STEPS = (6e-4, 1.5e-4, 2e-5), (4, 16, 64)


def plates_at_rest(folder: Path) -> StudyResult:
    """Plates that hang on each other, and one that rests on an edge, by tolerance."""
    rows = Comparisons()
    for test, allowed in (
        (ContactTest(case="plates"), 0.01),
        (ContactTest(case="stack", n=8), 0.02),
        (ContactTest(case="graded", n=8), 0.02),
        (ContactTest(case="wedge"), 0.02),
    ):
        for tolerance in _TOLERANCES:
            found = run_contact(replace(test, tolerance=tolerance, at_rest=True))
            text = f"of {test.case}, tolerance {tolerance:g} m"
            assert found.droop is not None
            assert found.droop_exact is not None
            rows.compare(f"droop {text}", found.droop, found.droop_exact, allowed, _BEAM, unit="m")
            if found.weight:
                assert found.reaction_sum is not None
                values = found.reaction_sum, found.weight, allowed, _NEWTON
                rows.compare(f"sum of reactions {text}", *values, unit="N")
    return StudyResult(rows)


def plates_in_motion(folder: Path) -> StudyResult:
    """Plates that swing, slide and collide, by steps a frame of 1/24 s, 0 as the tolerance asks."""
    rows, names = Comparisons(), {"frequency": "Hz", "acceleration": "m/s^2", "momentum": "N s"}
    for case, name, allowed, source in (
        ("plates", "frequency", 0.02, _BEAM),
        ("slide", "acceleration", 0.02, _COULOMB),
        ("collide", "momentum", 1e-3, _NEWTON),
    ):
        for steps in (0, *_STEPS):
            found = run_contact(ContactTest(case=case, steps=steps))  # type: ignore[arg-type]
            text = f"of {case}, {steps} steps"
            values = getattr(found, name), getattr(found, f"{name}_exact"), allowed, source
            rows.compare(f"{name} {text}", *values, unit=names[name])
            assert found.energy_gain is not None
            text = f"energy gained over the largest kinetic energy {text}"
            rows.bound(text, found.energy_gain, independent("no work is done"), at_most=1e-3)
    return StudyResult(rows)
