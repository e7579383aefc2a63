"""Damaged inputs by the thousand: `python -m tests.fuzz --cases 300 --seed 0 usd`.

And bakes that are killed: `python -m tests.fuzz --cases 30 kill`, and scenes in which feathers are
thrown together: `python -m tests.fuzz --cases 1000 contact`. Several kinds, one after another, each
cut among processes: `python -m tests.fuzz --cases 2500 --jobs 16 --json found.json toml usd`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from tests.fuzz import contact, kill, toml, usd
from tests.fuzz.cases import FINE, Failure, Found, run

Run = Callable[[Sequence[int], int, Path | None], Found]
KINDS: dict[str, Run] = {
    "toml": partial(run, toml.KIND),
    "usd": partial(run, usd.KIND),
    "contact": lambda cases, seed, _: contact.run(cases, seed),
    "kill": kill.run,
}
# of the cases for each job, so that those which end early take more
PIECES = 4


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("kinds", nargs="+", choices=sorted(KINDS), metavar="|".join(KINDS))
    parser.add_argument("--cases", type=int, default=300, metavar="N", help="of each kind")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="for inputs that fail")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes at a time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="for what was found")
    given = parser.parse_args()
    told = []
    for kind in given.kinds:
        start = time.monotonic()
        if given.jobs > 1:
            found = _in_pieces(kind, given)
        else:
            numbers = range(given.first, given.first + given.cases)
            found = KINDS[kind](numbers, given.seed, given.keep)
        told.append(_summary(kind, given, found, time.monotonic() - start))
        counts = ", ".join(f"{name} {count}" for name, count in sorted(found.outcomes.items()))
        print(f"{kind}: {given.cases} cases in {told[-1]['seconds']:.0f} s; {counts}", flush=True)
    if given.json:
        given.json.write_text(json.dumps(told, indent=2) + "\n")
    return int(not all(each["fine"] for each in told))


def _summary(kind: str, given: argparse.Namespace, found: Found, seconds: float) -> dict[str, Any]:
    """What is written of one kind. fine: whether every case ended as it should."""
    return {
        "kind": kind,
        "seed": given.seed,
        "first": given.first,
        "cases": given.cases,
        "seconds": round(seconds, 1),
        "fine": set(found.outcomes) <= {*FINE, "killed", "named"} and not found.failures,
        "outcomes": dict(sorted(found.outcomes.items())),
        "failures": [failure._asdict() for failure in found.failures],
        "scenes": found.scenes,
    }


def _in_pieces(kind: str, given: argparse.Namespace) -> Found:
    """The cases of one kind by several processes at a time; what they print is passed on."""
    size = -(-given.cases // (PIECES * given.jobs))
    end = given.first + given.cases
    starts = range(given.first, end, size)
    whole = Found(Counter(), [], [])
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(given.jobs) as pool:

        def piece(first: int) -> tuple[str, Any]:
            file = Path(name) / f"{first}.json"
            count = min(size, end - first)
            own = ["--first", str(first), "--cases", str(count), "--seed", str(given.seed)]
            keep = ["--keep", str(given.keep)] if given.keep else []
            command = [sys.executable, "-m", "tests.fuzz", kind, *own, *keep, "--json", str(file)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if file.is_file():
                return done.stdout, json.loads(file.read_text())[0]
            said = f"ended with {done.returncode}: {done.stderr}"
            failed = {"outcomes": {"unfit": count}, "failures": [{"case": first, "said": said}]}
            return said + "\n", failed

        for text, part in pool.map(piece, starts):
            sys.stdout.write("".join(text.splitlines(keepends=True)[:-1]))
            whole.outcomes.update(part["outcomes"])
            whole.failures.extend(Failure(**each) for each in part["failures"])
            whole.scenes.extend(part.get("scenes", []))
    return whole


sys.exit(main())
