"""Size of each package, and what it holds."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

_COLUMNS = "files", "lines"
_CHANGE = "Change here: "


def package_table(folder: Path) -> Iterator[str]:
    """Yield the lines of a Markdown table: each package, its counts, what it holds, what to change.

    The last two are the first line of a package's docstring and its line "Change here: ...".
    """
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for file in sorted(folder.rglob("*.py")):
        found = Counter(files=1, lines=len(file.read_text(encoding="utf-8").splitlines()))
        parents = file.relative_to(folder).parents
        for package in parents:
            if package.parent == Path() or (folder / package / "__init__.py").is_file():
                counts["all" if package == Path() else package.as_posix()] += found
    yield f"| package | {' | '.join(_COLUMNS)} | holds | change here |"
    yield "|---|" + "---|" * (len(_COLUMNS) + 2)
    for name, found in sorted(counts.items(), key=lambda each: (each[0] == "all", each)):
        start = folder / name / "__init__.py"
        text = ast.get_docstring(ast.parse(start.read_text("utf-8"))) if start.is_file() else ""
        lines = (text or "").splitlines()
        holds = lines[0] if lines else ""
        change = next((each for each in lines if each.startswith(_CHANGE)), "")[len(_CHANGE) :]
        numbers = " | ".join(f"{found[each]:,}" for each in _COLUMNS)
        yield f"| {name} | {numbers} | {holds} | {change} |"
