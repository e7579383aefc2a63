"""How much `featherfx bench` measures; imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

STRESS_CASES, QUICK_STRESS_CASES = 10_000, 200


@dataclass(frozen=True)
class BenchOptions:
    """What to measure and how much of it; see `featherfx bench --help`."""

    quick: bool
    stress: bool
    peers: bool
    skips: tuple[Path, ...]
    front: bool
    promise: tuple[Path, ...]
    error: tuple[float, ...]
    only: str
    frames: int | None
    every: int
    cases: int | None
    seed: int
    as_json: bool
    jobs: int | None
    output: Path | None

    @property
    def seeds(self) -> range:
        """Of the random cases."""
        count = self.cases or (QUICK_STRESS_CASES if self.quick else STRESS_CASES)
        return range(self.seed, self.seed + count)
