"""The shape of the program: imports point one way, heavy libraries stay where they belong."""

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "featherfx"
# rooms, and the modules beside them at the root, from the ground floor up
ORDER = (
    "_version",
    "errors",
    "limits",
    "phases",
    "packages",
    "files",
    "jit",
    "algebra",
    "groom",
    "coat",
    "feather",
    "mechanics",
    "solver",
    "shot",
    "usd",
    "trace",
    "render",
    "api",
    "baking",
    "view",
    "farm",
    "__init__",
    "lab",
    "cli",
    "__main__",
)
FORBIDDEN = {"lab": {"usd", "render", "baking"}, "usd": {"solver"}, "cli": {"__init__"}}
# what only the lab needs lives in the lab: the commands of the lab and of benchmarks may enter it
LAB_ENTRIES = ("cli/lab/",)
HOME_OF = {
    "pxr": {"usd", "plugins"},
    "embreex": {"render"},
    "PIL": {"render", "trace", "usd"},
    "click": {"cli"},
    "alembic3d": {"usd"},
    "distributed": {"farm"},
}
HEAVY = ("numba", "numpy", "pxr", "scipy", "trimesh", "embreex", "PIL", "distributed")


def imports_of(file):
    """(module, line) of all imports of a file, also those inside functions."""
    return imports_in(file.read_text())


@cache
def imports_in(text):
    return list(_found(text))


def _found(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: write imports in full"
            for alias in node.names:
                yield f"{node.module}.{alias.name}", node.lineno
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "KernelModule":
            yield f"{node.args[0].value}.*", node.lineno


def wrong_arrows(room, file):
    allowed = set(ORDER[: ORDER.index(room) + 1]) - FORBIDDEN.get(room, set())
    if room == "cli" and not file.relative_to(PACKAGE).as_posix().startswith(LAB_ENTRIES):
        allowed.discard("lab")
    for module, line in imports_of(file):
        parts = module.split(".")
        # what is not a room or a module is a name of featherfx/__init__.py
        target = parts[1] if parts[1:2] and parts[1] in ORDER else "__init__"
        if parts[0] == "featherfx" and target not in allowed:
            yield f"{file.relative_to(ROOT)}:{line}: {room} imports {module}"


def test_every_room_has_its_place():
    rooms = {each.stem for each in PACKAGE.glob("*.py")}
    rooms |= {each.parent.name for each in PACKAGE.glob("*/__init__.py")}
    assert rooms == set(ORDER)


@pytest.mark.parametrize("room", ORDER)
def test_imports_point_one_way(room):
    files = sorted((PACKAGE / room).rglob("*.py")) or [PACKAGE / f"{room}.py"]
    assert [wrong for file in files for wrong in wrong_arrows(room, file)] == []


def test_a_wrong_arrow_is_seen(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    file = tmp_path / "bad.py"
    file.write_text("def late():\n    from featherfx.shot.types import Shot\n")
    assert list(wrong_arrows("solver", file)) == [
        "bad.py:2: solver imports featherfx.shot.types.Shot"
    ]
    assert list(wrong_arrows("usd", file)) == []
    file.write_text("from featherfx.lab.nodal.model import nodal_model\n")
    for room in ("solver", "baking", "cli"):
        assert len(list(wrong_arrows(room, file))) == 1
    file.write_text("from featherfx import simulate\n")
    assert len(list(wrong_arrows("shot", file))) == 1


def imported_files(files):
    """Of each file, those of them that it imports, for types alone too."""
    named = {".".join(each.relative_to(ROOT).with_suffix("").parts): each for each in files}
    found = {}
    for file in files:
        # a module, or a name within one
        names = [n for module, _ in imports_of(file) for n in (module, module.rpartition(".")[0])]
        found[file] = {named[name] for name in names if name in named}
    return found


def test_no_files_import_each_other(tmp_path, monkeypatch):
    TopologicalSorter(imported_files(sorted(PACKAGE.rglob("*.py")))).prepare()
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    one, other = tmp_path / "one.py", tmp_path / "other.py"
    one.write_text("def late():\n    from other import name\n")
    other.write_text("from one import late\n")
    with pytest.raises(CycleError):
        TopologicalSorter(imported_files([one, other])).prepare()


def folder_arrows(package):
    """(folder, folder) of a package where one imports the other; modules beside folders are "."."""
    found = set()
    for file in sorted(package.rglob("*.py")):
        own = file.relative_to(package).parts
        for module, _ in imports_of(file):
            names = module.split(".")
            if names[:2] == ["featherfx", package.name] and len(names) > 2:
                is_folder = (package / names[2]).is_dir()
                found.add((own[0] if len(own) > 1 else ".", names[2] if is_folder else "."))
    return {(one, other) for one, other in found if one != other}


def test_no_two_folders_of_a_shot_import_each_other(tmp_path):
    arrows = folder_arrows(PACKAGE / "shot")
    assert [each for each in sorted(arrows) if each[::-1] in arrows] == []
    package = tmp_path / "shot"
    for folder in ("one", "other"):
        (package / folder).mkdir(parents=True)
    (package / "one" / "it.py").write_text("from featherfx.shot.other.that import name\n")
    (package / "other" / "that.py").write_text("import featherfx.shot.types\n")
    assert folder_arrows(package) == {("one", "other"), ("other", ".")}


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


def test_light_imports():
    code = "import sys, featherfx.cli.main, featherfx.baking.pipeline; "
    code += f"print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.strip() == "[]"


def test_files_of_tests_have_names_of_their_own():
    """Of two with one name in different folders only one can be imported."""
    count = Counter(each.name for each in Path(__file__).parent.rglob("test_*.py"))
    assert [name for name, times in count.items() if times > 1] == []


def _takes(node: ast.stmt) -> tuple[int, int] | None:
    """Fewest and most arguments of a function or of a NamedTuple."""
    if isinstance(node, ast.FunctionDef) and not (node.args.vararg or node.args.kwarg):
        most = len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs)
        free = len(node.args.defaults) + sum(k is not None for k in node.args.kw_defaults)
        # numba gives an intrinsic its typing context itself
        most -= any(ast.unparse(each) == "intrinsic" for each in node.decorator_list)
        return most - free, most
    if isinstance(node, ast.ClassDef) and [ast.unparse(b) for b in node.bases] == ["NamedTuple"]:
        fields = [each for each in node.body if isinstance(each, ast.AnnAssign)]
        return sum(each.value is None for each in fields), len(fields)
    return None


def miscalled(tree: ast.Module, known: dict[str, dict[str, tuple[int, int]]]) -> list[str]:
    """Calls of a module with too many or too few arguments, of what it or others define."""
    callees = {n.name: t for n in tree.body if (t := _takes(n)) and hasattr(n, "name")}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module in known:
            own = known[node.module]
            callees |= {a.asname or a.name: own[a.name] for a in node.names if a.name in own}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            given = [*node.args, *node.keywords]
            spread = any(isinstance(a, ast.Starred) for a in node.args)
            if node.func.id in callees and not spread and all(k.arg for k in node.keywords):
                fewest, most = callees[node.func.id]
                if not fewest <= len(given) <= most:
                    found.append(f"{node.func.id}, line {node.lineno}: {len(given)} arguments")
    return found


def test_kernels_call_each_other_with_what_is_taken():
    """Nothing else sees it before they are compiled, which no quick test has all be."""
    trees = {path: ast.parse(path.read_text()) for path in PACKAGE.rglob("*.py")}
    known = {}
    for path, tree in trees.items():
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        known[name] = {n.name: t for n in tree.body if (t := _takes(n)) and hasattr(n, "name")}
    for path, tree in trees.items():
        if "import kernel" in path.read_text():
            assert miscalled(tree, known) == [], path
    planted = (
        "from featherfx.solver.step.newton_kernels import NewtonResult\n"
        "NewtonResult(0, 1, 1, 0.0, 1.0, 0.0)"
    )
    assert miscalled(ast.parse(planted), known) == ["NewtonResult, line 2: 6 arguments"]
