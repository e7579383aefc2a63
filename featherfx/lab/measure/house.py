"""Lines of each package: what they are, and what the package holds."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

_COLUMNS = "files", "lines", "docstrings", "comments", "code"


def _docstrings(tree: ast.Module) -> Iterator[ast.stmt]:
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node):
            yield node.body[0]


def count_lines(text: str) -> Counter[str]:
    """Count each line of a module once, as docstring, comment, code or blank."""
    described = {
        line
        for node in _docstrings(ast.parse(text))
        for line in range(node.lineno, (node.end_lineno or 0) + 1)
    }
    found = Counter({"files": 1})
    for number, line in enumerate(text.splitlines(), 1):
        kind = "comments" if line.lstrip().startswith("#") else "code" if line.strip() else "blank"
        found += Counter(("docstrings" if number in described else kind, "lines"))
    return found


def package_table(folder: Path) -> Iterator[str]:
    """Yield the lines of a Markdown table: each package, its counts and what it holds."""
    packages: dict[str, Counter[str]] = defaultdict(Counter)
    for file in sorted(folder.rglob("*.py")):
        place = file.relative_to(folder).parts
        found = count_lines(file.read_text(encoding="utf-8"))
        packages[place[0] if len(place) > 1 else "(modules beside them)"] += found
        packages["all"] += found
    yield f"| package | {' | '.join(_COLUMNS)} | holds |"
    yield "|---|" + "---|" * (len(_COLUMNS) + 1)
    for name, found in sorted(packages.items(), key=lambda each: -each[1]["lines"]):
        start = folder / name / "__init__.py"
        text = ast.get_docstring(ast.parse(start.read_text("utf-8"))) if start.is_file() else None
        counts = " | ".join(f"{found[each]:,}" for each in _COLUMNS)
        yield f"| {name} | {counts} | {text.splitlines()[0] if text else ''} |"
