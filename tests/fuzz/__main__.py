"""Damaged inputs by the thousand: `python -m tests.fuzz --cases 300 --seed 0 usd`.

Also commands that are killed (kill), scenes in which feathers are thrown together (contact),
extreme shots (extreme), random feathers and loads (solver) and requests to the servers of pages
(requests). Several kinds, one after
another, each cut among processes:
`python -m tests.fuzz --cases 2500 --jobs 16 --json found.json toml usd`. How far it is, is told
every 25 cases; interrupted (Ctrl-C), it tells what was found so far.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import Any

from tests.fuzz import contact, extreme, kill, pictures, requests, solver, toml, usd
from tests.fuzz.cases import FINE, Failure, Found, nothing, run

Run = Callable[[Sequence[int], int, Path | None], Iterator[Found]]
KINDS: dict[str, Run] = {
    "toml": partial(run, toml.KIND),
    "usd": partial(run, usd.KIND),
    "pictures": partial(run, pictures.KIND),
    "contact": lambda cases, seed, _: contact.run(cases, seed),
    "extreme": partial(run, extreme.KIND),
    "kill": kill.run,
    "requests": requests.run,
    "solver": solver.run,
}
# of cases that ended as they should, beside FINE
COUNTS = ("failed", "iterations", "killed", "named", "steps", "steps_over_tolerance", "unsolved")
# of the cases for each job, so that those which end early take more; most of a piece, and between
# two lines that tell how far it is
PIECES, OFTEN = 4, 25


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("kinds", nargs="+", choices=sorted(KINDS), metavar="|".join(KINDS))
    parser.add_argument("--cases", type=int, default=300, metavar="N", help="of each kind")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--seconds", type=float, help="after which no other case of a kind begins")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="for inputs that fail")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes at a time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="for what was found")
    given = parser.parse_args()
    # whoever starts it in the background may have made it deaf to Ctrl-C
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.default_int_handler)
    told: list[dict[str, Any]] = []
    for kind in given.kinds:
        start, whole = time.monotonic(), nothing()
        interrupted = _gathered(kind, given, whole)
        told.append(_summary(kind, given, whole, time.monotonic() - start))
        when = f"of seed {given.seed} in {told[-1]['seconds']:.0f} s"
        print(_line(kind, whole, when), flush=True)
        if interrupted:
            print(f"interrupted: {given.cases - len(whole.through)} cases were not tried")
            break
    if given.json:
        given.json.write_text(json.dumps(told, indent=2) + "\n")
    return int(not all(each["fine"] for each in told))


def _gathered(kind: str, given: argparse.Namespace, whole: Found) -> bool:
    """Whether the cases of one kind were interrupted. whole: takes what is found."""
    numbers = range(given.first, given.first + given.cases)
    some = (
        _in_pieces(kind, given) if given.jobs > 1 else KINDS[kind](numbers, given.seed, given.keep)
    )
    told, begin = 0, time.monotonic()
    try:
        for part in some:
            _print_bad(part, given.seed)
            whole.outcomes.update(part.outcomes)
            whole.failures.extend(part.failures)
            whole.scenes.extend(part.scenes)
            whole.through.extend(part.through)
            if given.seconds and time.monotonic() - begin > given.seconds:
                return False
            if len(whole.through) // OFTEN > told // OFTEN:
                told = len(whole.through)
                print(_line(kind, whole, f"of {given.cases} so far"), flush=True)
    except KeyboardInterrupt:
        return True
    return len(whole.through) < given.cases


def _print_bad(found: Found, seed: int) -> None:
    """Cases that are not fine, and scenes that ended with a reason."""
    for each in found.failures:
        print(f"--- case {each.case} of seed {seed}\n{each.said}", flush=True)
    for scene in found.scenes:
        if scene["outcome"] == "named":
            print(f"case {scene['number']} of seed {seed}: {scene['said']}", flush=True)


def _line(kind: str, found: Found, when: str) -> str:
    counts = ", ".join(f"{name} {count}" for name, count in sorted(found.outcomes.items()))
    return f"{kind}: {len(found.through)} cases {when}; {counts}"


def _summary(kind: str, given: argparse.Namespace, found: Found, seconds: float) -> dict[str, Any]:
    """What is written of one kind. fine: whether every case ended as it should."""
    return {
        "kind": kind,
        "seed": given.seed,
        "first": given.first,
        "cases": len(found.through),
        "numbers": sorted(found.through),
        "seconds": round(seconds, 1),
        "fine": set(found.outcomes) <= {*FINE, *COUNTS} and not found.failures,
        "outcomes": dict(sorted(found.outcomes.items())),
        "failures": [failure._asdict() for failure in found.failures],
        "scenes": found.scenes,
    }


def _in_pieces(kind: str, given: argparse.Namespace) -> Iterator[Found]:
    """The cases of one kind by several processes at a time, which hand in what they have when they
    are interrupted."""
    size = min(OFTEN, -(-given.cases // (PIECES * given.jobs)))
    end = given.first + given.cases
    begun: list[subprocess.Popen[str]] = []
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(given.jobs) as pool:

        def piece(first: int) -> Found:
            file = Path(name) / f"{first}.json"
            count = min(size, end - first)
            own = ["--first", str(first), "--cases", str(count), "--seed", str(given.seed)]
            keep = ["--keep", str(given.keep)] if given.keep else []
            command = [sys.executable, "-m", "tests.fuzz", kind, *own, *keep, "--json", str(file)]
            # in a session of its own, so that it is interrupted once, from here
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
            process = subprocess.Popen(command, start_new_session=True, **pipes)
            begun.append(process)
            _, said = process.communicate()
            if file.is_file():
                return _handed_in(json.loads(file.read_text())[0])
            failure = Failure(first, f"ended with {process.returncode}: {said}")
            numbers = list(range(first, first + count))
            return Found(Counter({"unfit": count}), [failure], [], numbers)

        left = {pool.submit(piece, first) for first in range(given.first, end, size)}
        while left:
            try:
                done, left = wait(left, return_when=FIRST_COMPLETED)
            except KeyboardInterrupt:
                pool.shutdown(wait=False, cancel_futures=True)
                for process in begun:
                    process.send_signal(signal.SIGINT)
                continue
            yield from (each.result() for each in done if not each.cancelled())


def _handed_in(summary: dict[str, Any]) -> Found:
    """What another process found, from its summary."""
    failures = [Failure(**each) for each in summary["failures"]]
    outcomes = Counter(summary["outcomes"])
    return Found(outcomes, failures, summary["scenes"], summary["numbers"])


sys.exit(main())
