"""Numbers of the model and the solver: each says where it comes from, or is in the table of tuned
numbers (docs/decisions/constants.md)."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "featherfx"
TABLE = ROOT / "docs/decisions/constants.md"
PACKAGES = "coat", "feather", "groom", "mechanics", "shot", "solver"
# to be replaced as a whole
EXEMPT = "shot/contact/", "solver/contact/"


LABELS = {-3, -2, -1, 0, 1, 2, 3}  # states, columns and directions, not quantities


def is_number(node):
    """Return whether an expression is made of numbers that are written here."""
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, ast.Tuple) and all(map(is_number, node.elts))


def is_label(node):
    """Return whether all numbers of an expression are small whole ones."""
    values = eval(ast.unparse(node))
    return set(values if isinstance(values, tuple) else [values]) <= LABELS


def uncommented(text):
    """Yield names of numeric constants of a module with no comment at or above their lines."""
    lines = text.splitlines()
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign) and is_number(node.value) and not is_label(node.value):
            own = "".join(lines[node.lineno - 1 : node.end_lineno])
            if "#" not in own and not lines[node.lineno - 2].startswith("#"):
                names = [each for each in ast.walk(node.targets[0]) if isinstance(each, ast.Name)]
                yield from (each.id for each in names if each.id.isupper())


def listed():
    """Return file and name of each row of the table."""
    return re.findall(r"^\| `(\w+)` \| `(\S+)` \|", TABLE.read_text(encoding="utf-8"), re.M)


def modules():
    for package in PACKAGES:
        for file in sorted((PACKAGE / package).rglob("*.py")):
            name = file.relative_to(PACKAGE).as_posix()
            if not name.startswith(EXEMPT):
                yield name, file.read_text(encoding="utf-8")


def test_numbers_say_where_they_come_from():
    told = {(file, name) for name, file in listed()}
    found = {(file, name) for file, text in modules() for name in uncommented(text)}
    assert sorted(found - told) == []


def test_listed_numbers_exist():
    for name, file in listed():
        assert re.search(rf"\b{name}\b.*=", (PACKAGE / file).read_text(encoding="utf-8")), name


def test_a_number_without_a_comment_is_noticed():
    text = (
        "import a\n\nX = 9\n# m\nY = -2.0, 9\n_Z, W = 4, 1 / 3\nV = 5  # s\nU = {1: 2}\nT = 0, 1\n"
    )
    assert list(uncommented(text)) == ["X", "_Z", "W"]
