"""All studies, by name, in the order of the report. Listing them imports nothing heavy."""

from __future__ import annotations

from collections.abc import Sequence

from featherfx.errors import InputError, Problem
from featherfx.lab.study import Study, later

STUDIES: tuple[Study, ...] = (
    Study(
        "elastica",
        "Cantilever under a force at its tip",
        "Bisshopp and Drucker 1945; Mattiasson 1981, table 1",
        later("featherfx.lab.studies.rods:elastica"),
    ),
)


def studies(names: Sequence[str] = ()) -> list[Study]:
    """The studies of the given names, or all; in the order of the report.

    Raises InputError with every name that there is no study of.
    """
    known = {study.name: study for study in STUDIES}
    wrong = [name for name in dict.fromkeys(names) if name not in known]
    if wrong:
        allowed = ", ".join(known)
        raise InputError(
            *(Problem("lab", "only", f"'{each}'; allowed: {allowed}") for each in wrong)
        )
    return [study for study in STUDIES if not names or study.name in names]
