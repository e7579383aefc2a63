"""Damaged inputs by the thousand: `python -m tests.fuzz --cases 300 --seed 0 usd`.

And bakes that are killed: `python -m tests.fuzz --cases 30 kill`, and scenes in which feathers are
thrown together: `python -m tests.fuzz --cases 1000 contact`.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tests.fuzz import contact, kill, toml, usd
from tests.fuzz.cases import FINE, run

KINDS = {"toml": toml.KIND, "usd": usd.KIND}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("kind", choices=sorted([*KINDS, "contact", "kill"]))
    parser.add_argument("--cases", type=int, default=300, metavar="N")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="for inputs that fail")
    given = parser.parse_args()
    start = time.monotonic()
    numbers = range(given.first, given.first + given.cases)
    if given.kind == "kill":
        outcomes = kill.run(numbers, given.seed, given.keep)
    elif given.kind == "contact":
        outcomes = contact.run(numbers, given.seed)
    else:
        outcomes = run(KINDS[given.kind], numbers, given.seed, given.keep)
    counts = ", ".join(f"{name} {count}" for name, count in sorted(outcomes.items()))
    print(f"{given.cases} cases in {time.monotonic() - start:.0f} s; {counts}")
    return int(bool(set(outcomes) - {*FINE, "killed", "named"}))


sys.exit(main())
