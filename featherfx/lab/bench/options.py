"""Options of `featherfx bench`; imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from featherfx.limits import option


@dataclass(frozen=True)
class BenchOptions:
    """Choice and extent of the measurements."""

    quick: bool = option(False, "A smaller set of settings, in two minutes of one core.")
    peers: bool = option(
        False, 'Beside MuJoCo and Newton (extra "peers"): error against time of strips.'
    )
    contact: bool = option(False, "Ways to solve the contact forces of a stack, side by side.")
    birds: bool = option(False, "Whole birds at each quality, beside a fine reference.")
    skips: tuple[Path, ...] = option(
        (),
        "What skipping work saves and costs on a shot; once for each shot.",
        several=True,
        there=True,
        metavar="SHOT",
    )
    promise: int | None = option(
        None, "Number of random shots of which the promised error is measured.", least=1
    )
    only: str = option("*", "Of --skips: names of skips, with * and ?.")
    frames: int | None = option(None, "Of --skips: frames of each.", least=2)
    every: int = option(1, "Of --skips: every n-th feather of each shot alone.", least=1)
    as_json: bool = option(
        False,
        "Of --promise and --birds: what is measured, as JSON.",
        flag="--json",
    )
    seed: int = option(0, "First one, of --promise.", least=0)
    jobs: int | None = option(None, "Threads.  [default: all cores]", least=1)
    output: Path | None = None
