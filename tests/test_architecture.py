"""The shape of the program: imports point one way, heavy libraries stay where they belong."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "featherfx"
ORDER = ("groom", "feather", "mechanics", "solver", "shot", "usd", "render", "lab", "cli")
FOR_ALL = {"errors", "compiled", "kernel_parts", "__version__"}
FORBIDDEN = {"lab": {"usd", "render"}, "usd": {"solver"}}
HOME_OF = {
    "pxr": {"usd"},
    "embreex": {"render"},
    "PIL": {"render", "usd"},
    "click": {"cli"},
    "alembic3d": {"usd"},
}
HEAVY = ("numba", "numpy", "pxr", "scipy", "trimesh", "embreex", "PIL")


def imports_of(file):
    """(module, line) of all imports of a file, also those inside functions."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: write imports in full"
            for alias in node.names:
                yield f"{node.module}.{alias.name}", node.lineno


def wrong_arrows(package, file):
    allowed = set(ORDER[: ORDER.index(package) + 1]) | FOR_ALL
    if package == "cli":
        allowed |= {"pipeline", "__version__"}
    allowed -= FORBIDDEN.get(package, set())
    for module, line in imports_of(file):
        parts = module.split(".")
        if parts[0] == "featherfx" and parts[1] not in allowed:
            yield f"{file.relative_to(ROOT)}:{line}: {package} imports {module}"


def test_every_package_has_its_place():
    folders = {each.name for each in PACKAGE.iterdir() if (each / "__init__.py").exists()}
    assert folders == set(ORDER)


@pytest.mark.parametrize("package", ORDER)
def test_imports_point_one_way(package):
    files = sorted((PACKAGE / package).rglob("*.py"))
    assert files
    assert [wrong for file in files for wrong in wrong_arrows(package, file)] == []


def test_a_wrong_arrow_is_seen(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    file = tmp_path / "bad.py"
    file.write_text("def late():\n    from featherfx.shot.types import Shot\n")
    assert list(wrong_arrows("solver", file)) == [
        "bad.py:2: solver imports featherfx.shot.types.Shot"
    ]
    assert list(wrong_arrows("usd", file)) == []


@pytest.mark.parametrize("library", HOME_OF)
def test_libraries_stay_in_their_package(library):
    strays = [
        str(file.relative_to(ROOT))
        for file in sorted(PACKAGE.rglob("*.py"))
        if file.relative_to(PACKAGE).parts[0] not in HOME_OF[library]
        for module, _ in imports_of(file)
        if module.split(".")[0] == library
    ]
    assert strays == []


@pytest.mark.parametrize("module", ["featherfx", "featherfx.cli.main", "featherfx.pipeline"])
def test_light_imports(module):
    code = f"import sys, {module}; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.strip() == "[]"
