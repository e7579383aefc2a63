"""Options of `featherfx bench`; imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from featherfx.limits import option

_STRESS_CASES, _QUICK_STRESS_CASES = 10_000, 200


@dataclass(frozen=True)
class BenchOptions:
    """Choice and extent of the measurements."""

    quick: bool = option(False, "A smaller set of settings, in two minutes of one core.")
    stress: bool = option(False, "Random absurd cases instead of measurements.")
    peers: bool = option(False, 'Beside MuJoCo (extra "peers"): error against time of a strip.')
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
    cases: int | None = option(
        None,
        f"Number of random cases.  [default: {_STRESS_CASES}, quick: {_QUICK_STRESS_CASES}]",
        least=1,
    )
    as_json: bool = option(
        False,
        "Of --stress and --promise: counts, and cases with their causes or errors, as JSON.",
        flag="--json",
    )
    hooks: bool = option(False, "Of --stress: vanes that slip, split and are zipped up.")
    seed: int = option(0, "First one, of --stress and --promise.", least=0)
    jobs: int | None = option(None, "Threads.  [default: all cores]", least=1)
    output: Path | None = None

    @property
    def seeds(self) -> range:
        """Seeds of the random cases."""
        count = self.cases or (_QUICK_STRESS_CASES if self.quick else _STRESS_CASES)
        return range(self.seed, self.seed + count)
