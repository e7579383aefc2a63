"""Messages are sentences that say what is wrong and what to do: all of them, read from the sources.

A message prints as `source: key: message.`; source and key may be its subject. Commands
end it with a period.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from featherfx.errors import Problem, as_sentence
from featherfx.groom.read.toml_text import located

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "featherfx"
# calls that take a message, and the number of its argument
MESSAGES = {
    "Problem": 2,
    "UsageError": 0,
    "BadParameter": 0,
    "ClickException": 0,
    "warn": 0,
    "warn_input": 0,
    "SimulationError": 2,
    "fail": 0,
    "refuse": 0,
    "unknown": 0,
    "add": 2,
}
# what a message may ask for or offer, besides a sentence that begins with an imperative
ADVICE = re.compile(
    r"\b(not one of|none of|expects?|needs?|takes?|must|goes? with|go with|belongs? to"
    r"|belong together|is for|are for|for --|exclude each other|more than|less than|below|within"
    r"|did you mean|has to|have to|at least|at most|may|instead|such as|docs/)\b"
    r"|--\w|\bpip install\b"
    r"|\{\}"  # the text of a variable may hold it
)
IMPERATIVE = re.compile(
    r"(^|[.:,;] |\bor |\band )(Give|Use|Choose|Name|Leave|Set|Move|Remove|Put|Run|Open|Bake|Make"
    r"|Draw|Bring|Merge|Keep|Place|Ask|Lower|Raise|Look|Add|Take|Check|Install|Write)\b",
    re.I,
)
# messages that offer nothing to do, by package; the numbers may only shrink
WITHOUT_ADVICE = {"cli": 2, "groom": 8, "lab": 10, "shot": 3, "usd": 4, "view": 1}


def texts(node: ast.expr | None, known: dict[str, list[str]]) -> list[str]:
    """Return the texts that an expression may give, with {} for what varies."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.JoinedStr):
        found = [""]
        for part in node.values:
            value = part.value if isinstance(part, ast.FormattedValue) else part
            own = texts(value, known) or ["{}"]
            found = [before + each for before in found for each in own][:8]
        return found
    if isinstance(node, ast.IfExp):
        return texts(node.body, known) + texts(node.orelse, known)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = (texts(each, known) or ["{}"] for each in (node.left, node.right))
        return [a + b for a in left for b in right][:8]
    if isinstance(node, ast.Name):
        return known.get(node.id, [])
    return []


def messages(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and text of every message of a module."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        known: dict[str, list[str]] = {}
        for node in ast.walk(function):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                known.setdefault(node.targets[0].id, []).extend(texts(node.value, known))
        for node in ast.walk(function):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            place = MESSAGES.get(name)
            if place is not None and len(node.args) > place and (name != "add" or place == 2):
                for text in texts(node.args[place], known):
                    if " " in text:
                        yield node.lineno, text


@cache
def every_message() -> list[tuple[str, int, str]]:
    found = set()
    for file in sorted(PACKAGE.rglob("*.py")):
        for line, text in messages(ast.parse(file.read_text())):
            found.add((file.relative_to(PACKAGE).as_posix(), line, text))
    return sorted(found)


def test_sources_hold_messages():
    assert len(every_message()) > 300


def test_advice_is_a_sentence_of_its_own():
    wrong = [each for each in every_message() if re.search(r"; |\ballowed:|, allowed ", each[2])]
    assert wrong == []


def test_messages_say_what_to_do():
    lacking: dict[str, list[str]] = {}
    for file, line, text in every_message():
        if not (ADVICE.search(text) or IMPERATIVE.search(text)):
            lacking.setdefault(file.partition("/")[0], []).append(f"{file}:{line}: {text}")
    for package, found in lacking.items():
        assert len(found) <= WITHOUT_ADVICE.get(package, 0), "\n".join(found)


@pytest.mark.parametrize("end", ["", "."])
def test_a_command_prints_a_problem_as_sentences(tmp_path, end):
    shot = tmp_path / "shot.toml"
    shot.write_text("name = 'a'\n[wind]\ngust = -3\n")
    problem = Problem(str(shot), "wind.gust", f"-3 is negative. Give 0 to 1{end}")
    assert located(problem) == f"{shot}:3: wind.gust: -3 is negative. Give 0 to 1."
    assert as_sentence("did you mean 'a'?") == "did you mean 'a'?"


@pytest.mark.parametrize(
    ("key", "line"),
    [
        ("bird.type", 2),
        ("bird.landmarks.beak[0]", 4),
        ("bird.landmarks.tail", 3),
        ('bird.type.colours."breast*".base', 2),
        ("region[1].flow.away", 10),
        ("region[0].flow.away", 6),
        ("region[1].where[0].sphere", 8),
    ],
)
def test_keys_of_tables_in_tables_are_told_by_their_own_lines(tmp_path, key, line):
    groom = tmp_path / "groom.toml"
    groom.write_text(
        "[bird]\ntype = 'owl'\n[bird.landmarks]\nbeak = [nan, 0, 0]\n"
        "[[region]]\nflow = { away = 1 }\n\n[[region]]\n[region.flow]\naway = 2\n"
    )
    assert located(Problem(str(groom), key, "x. Give y")).startswith(f"{groom}:{line}: ")


if __name__ == "__main__":
    for file, line, text in every_message():
        print(f"{file}:{line}: {as_sentence(text)}")
