"""The language of the program: names that mean one thing, docstrings that say what is done."""

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "featherfx"
# a docstring begins with a verb or a noun phrase, not with one of these
RIDDLES = ("What", "Whether", "How", "Of", "Where", "Which", "Who")
MISLEADING = """
    again alone aside beneath carried collecting crew crowds deaf earlier felt held_types late
    lie lips lying matter mend parts past raised store sunk take_up team through tightest
    together told twins whole
"""
# the lists below may only shrink
SHARED_CLASSES = ""
AMBIGUOUS_CONSTANTS = ""
MISLEADING_MODULES: list[str] = []
RIDDLES_ALLOWED: dict[str, int] = {}


@cache
def parsed_modules() -> dict[str, ast.Module]:
    """Return the syntax tree of each module by its path from the root."""
    files = sorted(PACKAGE.rglob("*.py"))
    return {each.relative_to(ROOT).as_posix(): ast.parse(each.read_text()) for each in files}


def public_classes(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.name


def public_constants(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield name and source text of each constant that a module assigns."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple):
                    values = getattr(node.value, "elts", [node.value] * len(target.elts))
                    pairs = list(zip(target.elts, values, strict=True))
                for name, value in pairs:
                    if isinstance(name, ast.Name) and name.id.isupper() and name.id[0] != "_":
                        yield name.id, ast.unparse(value)


def riddles(tree: ast.Module) -> Iterator[str]:
    """Yield the first lines of docstrings that begin with the wrong word."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    for node in ast.walk(tree):
        text = ast.get_docstring(node) if isinstance(node, kinds) else None
        if text and text.split()[0].strip(",.:;") in RIDDLES:
            yield text.splitlines()[0]


def test_public_classes_have_names_of_their_own():
    count = Counter(name for tree in parsed_modules().values() for name in public_classes(tree))
    shared = {name for name, times in count.items() if times > 1}
    assert sorted(shared - set(SHARED_CLASSES.split())) == []


def test_public_constants_have_one_value():
    values = defaultdict(set)
    for tree in parsed_modules().values():
        for name, value in public_constants(tree):
            values[name].add(value)
    ambiguous = {name for name, given in values.items() if len(given) > 1}
    assert sorted(ambiguous - set(AMBIGUOUS_CONSTANTS.split())) == []


def test_docstrings_begin_with_a_verb_or_a_noun():
    found = defaultdict(list)
    for file, tree in parsed_modules().items():
        package = Path(file).relative_to("featherfx").parts[0].removesuffix(".py")
        found[package] += [f"{file}: {line}" for line in riddles(tree)]
    for package, lines in found.items():
        assert len(lines) <= RIDDLES_ALLOWED.get(package, 0), "\n".join(lines)


def test_modules_have_names_that_say_what_they_hold():
    wrong = {
        name
        for name in parsed_modules()
        if set(Path(name).with_suffix("").parts) & set(MISLEADING.split())
    }
    assert sorted(wrong - set(MISLEADING_MODULES)) == []


def test_wrong_language_is_noticed():
    tree = ast.parse(
        '"""What is told."""\nclass Told:\n    """Of it."""\nA, B = 1, 2\n_C = 3\nD: int = 4'
    )
    assert list(riddles(tree)) == ["What is told.", "Of it."]
    assert list(public_classes(tree)) == ["Told"]
    assert [name for name, _ in public_constants(tree)] == ["A", "B", "D"]
