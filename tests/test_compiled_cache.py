"""Machine code of kernels: compiled anew where it must be, and only there."""

import ctypes
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import tomllib
from collections import namedtuple
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import numpy as np
import pytest
from numba import typeof
from packaging.specifiers import SpecifierSet

from featherfx.algebra import array_kernels
from featherfx.errors import InputError
from featherfx.files.trust import distrust
from featherfx.jit import cache, objects, ship, shipped
from featherfx.jit.compiled import TRIED
from featherfx.jit.crew import compilers
from featherfx.jit.forms import text_of
from featherfx.jit.type_text import text_of_types

ROOT = Path(cache.__file__).parents[1]


@pytest.fixture
def folder_after_change(monkeypatch, tmp_path):
    """Cache folders (before, after) of one kernel file when another one changes."""
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path))
    read = Path.read_bytes

    def folders(source, changed):
        cache.cache_folder.cache_clear()
        before = cache.cache_folder(ROOT / source)
        with monkeypatch.context() as patch:
            edited = ROOT / changed
            patch.setattr(
                Path, "read_bytes", lambda self: read(self) + (b"#" if self == edited else b"")
            )
            cache.cache_folder.cache_clear()
            after = cache.cache_folder(ROOT / source)
        cache.cache_folder.cache_clear()
        return before, after

    return folders


@pytest.mark.parametrize(
    "changed",
    [
        "solver/step/frame_kernels.py",
        "mechanics/vane_membrane_kernels.py",
        "solver/status.py",
    ],
)
def test_what_a_kernel_is_made_of_counts(folder_after_change, changed):
    before, after = folder_after_change("solver/step/frame_kernels.py", changed)
    assert before != after


@pytest.mark.parametrize("changed", ["jit/team.py", "jit/views.py"])
def test_how_threads_meet_and_what_views_are_counts_where_kernels_call_it(
    folder_after_change, changed
):
    before, after = folder_after_change("solver/contact/sweep_kernels.py", changed)
    assert before != after


@pytest.mark.parametrize(
    ("source", "changed"),
    [
        ("groom/regions/scatter_kernels.py", "mechanics/vane_membrane_kernels.py"),
        ("solver/step/frame_kernels.py", "errors.py"),
        ("solver/step/frame_kernels.py", "jit/team.py"),
    ],
)
def test_other_files_do_not_count(folder_after_change, source, changed):
    before, after = folder_after_change(source, changed)
    assert before == after


TYPES = """
from typing import NamedTuple

import numpy as np


class Pair(NamedTuple):
    values: np.ndarray
    first: float
"""
KERNELS = """
from typing import NamedTuple

from featherfx.jit.compiled import kernel, shared_kernel


class Total(NamedTuple):
    result: float
    count: int


@kernel
def square(x):
    return x * x


@shared_kernel(Total)
def total(values, first):
    result = first
    for i in range(values.shape[0]):
        result += square(values[i])
    return Total(result, values.shape[0])


@kernel
def mean(pair):
    result, count = total(pair.values, pair.first)
    return result / count
"""
RUN = """
import numpy as np
from trial_kernels import mean, square, total
from TYPES import Pair


def compiled(kernel):
    stats = getattr(kernel, "stats", None)  # numba's own, where kernels are compiled by its ways
    return sum(stats.cache_misses.values()) if stats else kernel.compiled


found = mean(Pair(np.arange(4.0), 2.0))
print(found, tuple(total(np.ones(3), 0.0)), square(3.0), end=" ")
print(sorted(k.__name__ for k in (mean, total, square) if compiled(k)))
"""


@pytest.fixture
def run_kernels(tmp_path):
    """As run_in, with a cache beside; stderr of the last run is its attribute."""

    def run(folder, module="trial_types", before="", **variables):
        cache = {"FEATHERFX_CACHE": str(tmp_path / "cache")}
        found, run.stderr = run_in(folder, module, before, cache | variables)
        return found

    return run


def run_in(folder, module, before, variables):
    """Runs RUN in a process of its own, with the kernels in a folder and the type that it calls
    them with in a module there; what it prints, and its stderr."""
    folder.mkdir(exist_ok=True)
    (folder / f"{module}.py").write_text(TYPES)
    (folder / "trial_kernels.py").write_text(KERNELS)
    paths = os.pathsep.join([str(folder), str(ROOT.parent)])
    done = subprocess.run(
        [sys.executable, "-c", before + RUN.replace("TYPES", module)],
        env=os.environ | {"PYTHONPATH": paths, "FEATHERFX_COMPILERS": "1"} | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split(maxsplit=1), done.stderr


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory):
    """What the first run printed, and the cache that it left."""
    folder = tmp_path_factory.mktemp("first")
    cache = {"FEATHERFX_CACHE": str(folder / "cache")}
    return run_in(folder / "here", "trial_types", "", cache)[0], folder / "cache"


def test_another_process_loads_what_one_compiled(run_kernels, tmp_path, compiled_once):
    (value, rest), cache = compiled_once
    # (2 + 0 + 1 + 4 + 9) / 4
    assert float(value) == 4.0
    assert rest == "(3.0, 3) 9.0 ['mean', 'square', 'total']\n"
    # also where the same files were installed anew
    shutil.copytree(cache, tmp_path / "cache")
    before = "import atexit, sys; atexit.register(lambda: print(PART in sys.modules))"
    before = before.replace("PART", "'numba'")
    value, rest = run_kernels(tmp_path / "there", before=before)
    assert (value, rest) == ("4.0", "(3.0, 3) 9.0 []\nFalse\n"), "the compiler was loaded, too"


LLVM = "from featherfx.jit import objects; objects.can_load = lambda: False"


def test_llvm_loads_what_is_not_loaded_here(run_kernels, tmp_path, compiled_once):
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    assert run_kernels(tmp_path / "here", before=LLVM) == ["4.0", NONE]


def test_an_address_that_a_place_cannot_hold_is_left_to_llvm():
    place = ctypes.create_string_buffer(16)
    half = struct.pack("<QQq", 0, 2, 0)  # to symbol 0, from the place on, half a word
    with pytest.raises(objects.CannotBeLoadedError):
        objects._fill(half, ctypes.addressof(place), [ctypes.addressof(place) + (1 << 40)])


@pytest.mark.slow
def test_types_of_another_version_are_no_obstacle(run_kernels, tmp_path):
    """Who calls a kernel may have moved what he calls it with, while the kernel stayed."""
    run_kernels(tmp_path / "before", "old_types")
    assert run_kernels(tmp_path / "after", "new_types") == ["4.0", NONE]


def test_fields_in_another_order_are_compiled_anew():
    def named(*fields):
        return namedtuple("Pair", fields)(1.0, 2.0)

    assert text_of(named("a", "b")) != text_of(named("b", "a"))
    assert text_of((named("a", "b"),)) != text_of((named("b", "a"),))


class Inner(NamedTuple):
    number: int
    there: bool


class Line(NamedTuple):
    values: Any
    inner: Inner


@pytest.mark.parametrize(
    "value",
    [
        1,
        np.int64(1),
        True,
        np.True_,
        1.0,
        np.float64(1.0),
        np.float32(1.0),
        None,
        np.zeros((2, 3)),
        np.asfortranarray(np.zeros((2, 3))),
        np.zeros((4, 6))[::2, ::2],
        np.frombuffer(bytes(16)),
        np.zeros(3, dtype=np.int8),
        np.zeros(2, dtype=[("a", np.float64), ("b", np.int64, (3, 2))]),
        (1.0, (2, True), ()),
        Line(np.zeros(3, dtype=np.float32), Inner(1, False)),
    ],
    ids=lambda value: text_of(value)[:30],
)
def test_values_and_numbas_types_of_them_have_one_text(value):
    assert text_of_types((typeof(value),)) == text_of(value)


@pytest.mark.parametrize("value", ["text", 1j, [1.0], np.int8(1)])
def test_what_kernels_do_not_take_is_refused(value):
    with pytest.raises(TypeError, match=f"no {type(value).__name__}"):
        array_kernels.copy_values(value, np.zeros(1))


ALL, NONE = "(3.0, 3) 9.0 ['mean', 'square', 'total']\n", "(3.0, 3) 9.0 []\n"


def cut(file):
    file.write_bytes(file.read_bytes()[:-100])


def flip(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x10
    file.write_bytes(content)


def empty(file):
    file.write_bytes(b"")


def other(file):
    """Sound, but of another kernel."""
    sizes = {each: each.stat().st_size for each in file.parent.iterdir()}
    file.write_bytes(max(sizes, key=sizes.get).read_bytes())


def folder_instead(file):
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(cut, marks=pytest.mark.slow),
        flip,
        pytest.param(empty, marks=pytest.mark.slow),
        pytest.param(other, marks=pytest.mark.slow),
    ],
)
def test_damaged_machine_code_is_compiled_anew(run_kernels, tmp_path, compiled_once, damage):
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    for file in sorted((tmp_path / "cache").rglob("*.code"))[1:]:
        damage(file)
    healed = run_kernels(tmp_path / "here")
    assert healed[0] == "4.0"
    assert healed[1] != NONE
    assert run_kernels(tmp_path / "here") == ["4.0", NONE]
    assert not run_kernels.stderr


@pytest.mark.slow
def test_a_folder_in_the_place_of_an_entry_does_not_stop_the_work(run_kernels, tmp_path):
    run_kernels(tmp_path / "here")
    for file in (tmp_path / "cache").rglob("*.code"):
        folder_instead(file)
    assert run_kernels(tmp_path / "here")[1] == ALL
    assert run_kernels.stderr.count("InputWarning") == 1


FULL_DISK = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
"""


def test_a_full_disk_is_named_and_the_work_goes_on(run_kernels, tmp_path):
    assert run_kernels(tmp_path / "here", before=FULL_DISK)[0] == "4.0"
    assert run_kernels.stderr.count("InputWarning") == 1
    assert str(tmp_path / "cache") in run_kernels.stderr
    assert not list((tmp_path / "cache").rglob("*.*"))


SHIPPED = """
from pathlib import Path
from featherfx.jit import shipped
shipped.FOLDER = Path(FOLDER)
"""


@pytest.fixture(scope="module")
def shipped_code(tmp_path_factory):
    """What a machine that builds wheels has compiled, for a common processor."""
    if not shipped.of_this_machine():
        pytest.skip("no machine code is shipped for this processor")
    folder = tmp_path_factory.mktemp("shipped")
    for_it = {"NUMBA_CPU_NAME": shipped.of_this_machine()[0].name, "NUMBA_CPU_FEATURES": ""}
    run_in(folder / "here", "trial_types", "", for_it | {"FEATHERFX_CACHE": str(folder / "code")})
    return folder / "code"


def test_machine_code_that_came_with_the_program_is_loaded(run_kernels, tmp_path, shipped_code):
    before = SHIPPED.replace("FOLDER)", f"{str(shipped_code)!r})")
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", NONE]
    assert not list((tmp_path / "cache").rglob("*.code"))
    # not for a processor that it may not be for
    other = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}
    assert run_kernels(tmp_path / "here", before=before, **other) == ["4.0", ALL]


@pytest.mark.parametrize(
    "harm",
    [
        pytest.param(flip, marks=pytest.mark.slow),
        pytest.param(lambda file: file.chmod(0o666), id="open"),
    ],
)
def test_shipped_code_that_was_changed_or_could_be_is_not_loaded(
    run_kernels, tmp_path, shipped_code, harm
):
    folder = shutil.copytree(shipped_code, tmp_path / "code")
    for file in folder.rglob("*.code"):
        harm(file)
    before = SHIPPED.replace("FOLDER)", f"{str(folder)!r})")
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", ALL]
    assert run_kernels.stderr.count("InputWarning") == (harm is not flip)


def test_all_that_was_compiled_is_put_into_the_wheels_folder(
    tmp_path, monkeypatch, capsys, compiled_once
):
    def compiled(folder, processor):
        shutil.copytree(compiled_once[1], folder, dirs_exist_ok=True)

    monkeypatch.setattr(ship, "fill", compiled)
    monkeypatch.setattr(ship, "FOLDER", tmp_path / "code")
    (tmp_path / "code" / "old").mkdir(parents=True)
    ship.main()
    assert capsys.readouterr().out.count(": 3 kernels, 0.") == len(shipped.of_this_machine())
    found = {each.name: each.read_bytes() for each in (tmp_path / "code").glob("*/*")}
    compiled = {each.name: each.read_bytes() for each in compiled_once[1].glob("*/*.code")}
    assert found == compiled


def test_a_checkout_takes_the_machine_code_of_a_wheel(tmp_path, monkeypatch, compiled_once):
    monkeypatch.setattr(ship, "FOLDER", tmp_path / "new" / "code")
    wheel = tmp_path / "a.whl"
    with pytest.raises(SystemExit, match=r"a\.whl: .*No such file"):
        ship.main(str(wheel))
    entries = list(compiled_once[1].glob("*/*.code"))
    with ZipFile(wheel, "w") as file:
        for name in ("featherfx/errors.py", "featherfx/_machine_code/../away.code"):
            file.writestr(name, "")
    with pytest.raises(SystemExit, match=r"a\.whl: holds no machine code"):
        ship.main(str(wheel))
    with ZipFile(wheel, "a") as file:
        for each in entries:
            file.write(each, f"featherfx/_machine_code/{each.parent.name}/{each.name}")
    ship.main(str(wheel))
    taken = {each.name: each.read_bytes() for each in (tmp_path / "new").rglob("*.code")}
    assert taken == {each.name: each.read_bytes() for each in entries}


def test_a_numba_of_unknown_inner_classes_compiles_as_it_does(run_kernels, tmp_path):
    """Slower, and nothing is kept; it is said once."""
    before = "import numba; numba.__version__ = '99.0'"
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", ALL]
    assert run_kernels.stderr.count("InputWarning: numba 99.0 is none of") == 1
    assert not list((tmp_path / "cache").rglob("*.code"))
    project = tomllib.loads((ROOT.parent / "pyproject.toml").read_text())["project"]
    (bound,) = (each for each in project["dependencies"] if each.startswith("numba"))
    assert SpecifierSet(bound.removeprefix("numba")) == TRIED


BY_NUMBA = """
import numba
numba.__version__ = "99.0"
import numpy as np
from typing import NamedTuple
from featherfx.algebra.lanes import load, put
from featherfx.jit.compiled import kernel
from featherfx.jit.views import shaped, viewed, views_of


class Line(NamedTuple):
    values: np.ndarray


@kernel
def double(views):
    values = shaped(viewed(views, 0).values, (4,))
    put(values, 0, 2.0 * load(values, 0))


held = views_of([Line(np.arange(4.0).reshape(2, 2))])
double(held.views)
print(held.tuples[0].values.tolist())
"""


def test_what_kernels_have_of_their_own_is_known_to_such_a_numba():
    done = subprocess.run(
        [sys.executable, "-c", BY_NUMBA], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[[0.0, 2.0], [4.0, 6.0]]\n"


needs_posix = pytest.mark.skipif(os.name == "nt", reason="modes of files are POSIX")


@needs_posix
def test_a_folder_that_others_can_write_to_is_not_used(run_kernels, tmp_path, compiled_once):
    shared = tmp_path / "cache"
    shared.mkdir()
    shared.chmod(0o777)
    before = set(Path(tempfile.gettempdir()).glob("featherfx-*"))
    assert run_kernels(tmp_path / "here")[1] == ALL
    assert "others can write to" in run_kernels.stderr
    assert run_kernels.stderr.count("InputWarning") == 1
    assert not list(shared.iterdir())
    # nothing is left of the folder that was used instead
    assert set(Path(tempfile.gettempdir()).glob("featherfx-*")) <= before
    trusted = {"FEATHERFX_TRUSTED_CACHE": str(shared)}
    shutil.copytree(compiled_once[1], shared, dirs_exist_ok=True)
    shared.chmod(0o777)
    assert run_kernels(tmp_path / "here", **trusted)[1] == NONE


READ_ONLY = """
import os
access = os.access
os.access = lambda path, mode, **how: mode != os.W_OK and access(path, mode, **how)
"""


@needs_posix
@pytest.mark.parametrize("lacks", ["", "total", "mean"])
def test_a_folder_that_can_only_be_read_is_loaded_from(run_kernels, tmp_path, compiled_once, lacks):
    """What it lacks is compiled, told once, and not kept."""
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    for file in (tmp_path / "cache").rglob(f"*.{lacks}-*") if lacks else ():
        file.unlink()
    before = sorted((tmp_path / "cache").rglob("*"))
    value, rest = run_kernels(tmp_path / "here", before=READ_ONLY)
    assert (value, rest) == ("4.0", NONE.replace("[]", f"['{lacks}']" if lacks else "[]"))
    assert run_kernels.stderr.count("no permission to write to") == bool(lacks)
    assert sorted((tmp_path / "cache").rglob("*")) == before


@needs_posix
def test_who_may_write_above_a_folder_counts(tmp_path):
    folder = tmp_path / "above" / "cache"
    folder.mkdir(parents=True)
    assert distrust(folder) == ""
    folder.parent.chmod(0o777)
    assert str(folder.parent) in distrust(folder)
    assert str(folder.parent) in distrust(folder / "not" / "yet")
    # where all may make files but remove only their own, as in /tmp
    folder.parent.chmod(0o1777)
    assert distrust(folder) == ""
    link = tmp_path / "link"
    link.symlink_to(folder)
    folder.parent.chmod(0o777)
    assert str(folder.parent) in distrust(link)
    folder.parent.chmod(0o755)
    assert distrust(link) == ""


@needs_posix
def test_a_folder_of_another_user_is_not_trusted(tmp_path):
    folder = tmp_path / "cache"
    folder.mkdir()
    try:
        os.chown(folder, 54321, 54321)
    except PermissionError:
        pytest.skip("only root can give a folder away")
    assert distrust(folder) == f"{folder} belongs to another user"


ELSEWHERE = """
import threading
from featherfx.jit import crew
BREAK
done = threading.Event()
crew.LISTENERS.append(lambda need: done.set())
import trial_kernels
from featherfx.jit.compiled import compile_ahead
compile_ahead(trial_kernels.total, __import__("numpy").ones(3), 0.0)
done.wait(0.5)
"""


@pytest.mark.parametrize(
    "broken",
    [
        "crew.SERVE = 'import sys; sys.exit(1)'",
        pytest.param("import sys; sys.executable = '/none'", marks=pytest.mark.slow),
    ],
)
def test_where_helpers_end_all_is_compiled_here(run_kernels, tmp_path, broken):
    before = ELSEWHERE.replace("BREAK", broken)
    assert run_kernels(tmp_path / "here", before=before, FEATHERFX_COMPILERS="3") == ["4.0", ALL]


WAITED = """
import sys, time
import numpy as np
import trial_kernels
from featherfx.jit.compiled import compile_ahead
from featherfx.phases import Account

compile_ahead(trial_kernels.total, np.ones(3), 0.0)
time.sleep(0.3)  # a helper has taken it up
told = []
with Account(told.append) as own:
    trial_kernels.total(np.ones(3), 0.0)
    share = own.spent("compiling") / own.elapsed
known = [each.left for each in told if each.left is not None]
print(share > 0.3, len(known) > 0, all(left >= 0.0 for left in known), file=sys.stderr)
"""


def test_a_helper_compiles_what_is_needed_later_and_waiting_for_it_is_told(run_kernels, tmp_path):
    found = run_kernels(tmp_path / "here", before=WAITED, FEATHERFX_COMPILERS="2")
    assert found == ["4.0", "(3.0, 3) 9.0 ['mean', 'square']\n"]
    assert run_kernels.stderr == "True True True\n"


def test_what_a_shared_kernel_returns_is_what_it_declares(run_kernels, tmp_path):
    wrong = """
from typing import NamedTuple
import trial_kernels
Other = NamedTuple("Other", [("result", float), ("count", float)])
trial_kernels.total.returns = Other
"""
    with pytest.raises(subprocess.CalledProcessError) as error:
        run_kernels(tmp_path / "here", before=wrong)
    assert "total returns Total(" in error.value.stderr
    assert "declared: Other(" in error.value.stderr


@pytest.mark.parametrize("given", ["0", "65", "two", "-1"])
def test_a_number_of_compilers_that_cannot_be_is_named(monkeypatch, given):
    monkeypatch.setenv("FEATHERFX_COMPILERS", given)
    with pytest.raises(InputError, match=f"FEATHERFX_COMPILERS.*'{given}'.*1 to 64"):
        compilers()
