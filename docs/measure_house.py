"""Lines of each room of the program, what they are, and what is counted of its functions.

python docs/measure_house.py [folder]
"""

from __future__ import annotations

import ast
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

MOST_PARAMETERS = 8
COLUMNS = "lines", "docstrings", "blank", "comments", "imports", "code", "statements"
Function = ast.FunctionDef, ast.AsyncFunctionDef


def lines_of(nodes: list[ast.stmt]) -> set[int]:
    return {line for node in nodes for line in range(node.lineno, (node.end_lineno or 0) + 1)}


def docstrings(tree: ast.Module) -> Iterator[ast.stmt]:
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, *Function)) and ast.get_docstring(node):
            yield node.body[0]


def counted(text: str, tree: ast.Module) -> Counter[str]:
    """Of a file, each line once."""
    told = lines_of([*docstrings(tree)])
    named = lines_of([each for each in tree.body if isinstance(each, (ast.Import, ast.ImportFrom))])
    found: Counter[str] = Counter()
    for number, line in enumerate(text.splitlines(), 1):
        if number in told:
            kind = "docstrings"
        elif not line.strip():
            kind = "blank"
        elif line.lstrip().startswith("#"):
            kind = "comments"
        else:
            kind = "imports" if number in named else "code"
        found += Counter((kind, "lines"))
    found["statements"] = sum(isinstance(node, ast.stmt) for node in ast.walk(tree))
    return found


def takes_many(node: ast.AST) -> bool:
    if not isinstance(node, Function):
        return False
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return sum(each.arg not in ("self", "cls") for each in given) > MOST_PARAMETERS


def main(folder: Path) -> None:
    rooms: dict[str, Counter[str]] = defaultdict(Counter)
    many, inside, files = [], set(), sorted(folder.rglob("*.py"))
    for file in files:
        text = file.read_text()
        tree, place = ast.parse(text), file.relative_to(folder)
        found = counted(text, tree)
        rooms[place.parts[0] if len(place.parts) > 1 else "root"] += found
        rooms["all"] += found
        functions = [node for node in ast.walk(tree) if isinstance(node, Function)]
        many += [f"{place} {node.name}" for node in functions if takes_many(node)]
        inside |= {
            (place, each.lineno)
            for node in functions
            for each in ast.walk(node)
            if isinstance(each, (ast.Import, ast.ImportFrom))
        }
    print("| room |", " | ".join(COLUMNS), "|\n|" + "---|" * (len(COLUMNS) + 1))
    for room, found in sorted(rooms.items(), key=lambda each: -each[1]["lines"]):
        print(f"| {room} |", " | ".join(f"{found[each]:,}" for each in COLUMNS), "|")
    print(f"\n{len(files)} files; imports inside functions: {len(inside)}")
    print(f"more than {MOST_PARAMETERS} parameters besides self: {', '.join(many) or 'none'}")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2] or ["featherfx"]))
