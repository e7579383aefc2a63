"""Machine code of kernels: compiled anew where it must be, and only there."""

import ctypes
import shutil
import struct
from collections import namedtuple
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from kernel_runs import NONE, ROOT
from numba import typeof

from featherfx.algebra import vector_kernels
from featherfx.jit import code_cache
from featherfx.jit.compiler import describe_types
from featherfx.jit.kernel_calls import describe_argument


@pytest.fixture
def folder_after_change(monkeypatch):
    """Names of the folder (before, after) of one kernel file when another one changes."""
    read = Path.read_bytes

    def folders(source, changed):
        code_cache.hash_source.cache_clear()
        before = code_cache.hash_source(ROOT / source)
        with monkeypatch.context() as patch:
            edited = ROOT / changed
            patch.setattr(
                Path, "read_bytes", lambda self: read(self) + (b"#" if self == edited else b"")
            )
            code_cache.hash_source.cache_clear()
            after = code_cache.hash_source(ROOT / source)
        code_cache.hash_source.cache_clear()
        return before, after

    return folders


@pytest.mark.parametrize(
    "changed",
    ["solver/step/frame_kernels.py", "mechanics/vane_membrane_kernels.py", "solver/types.py"],
)
def test_what_a_kernel_is_made_of_counts(folder_after_change, changed):
    before, after = folder_after_change("solver/step/frame_kernels.py", changed)
    assert before != after


def test_a_folder_that_is_left_of_an_earlier_version_does_not_count(tmp_path, monkeypatch):
    monkeypatch.setattr(code_cache, "ROOT", tmp_path)
    (tmp_path / "loads").mkdir()
    (tmp_path / "loads.py").write_text("")
    source = tmp_path / "step_kernels.py"
    source.write_text("from featherfx.loads import push\n")
    assert code_cache._find_imports(source) == {source, tmp_path / "loads.py"}


@pytest.mark.parametrize("changed", ["algebra/views.py"])
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
        ("solver/step/frame_kernels.py", "solver/contact/sweep_kernels.py"),
    ],
)
def test_other_files_do_not_count(folder_after_change, source, changed):
    before, after = folder_after_change(source, changed)
    assert before == after


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


LLVM = "from featherfx.jit import code_cache as o; o.can_load = lambda: False"


def test_llvm_loads_what_is_not_loaded_here(run_kernels, tmp_path, compiled_once):
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    assert run_kernels(tmp_path / "here", before=LLVM) == ["4.0", NONE]


def test_an_address_that_a_place_cannot_hold_is_left_to_llvm():
    place = ctypes.create_string_buffer(16)
    half = struct.pack("<QQq", 0, 2, 0)  # to symbol 0, from the place on, half a word
    with pytest.raises(code_cache.CannotBeLoadedError):
        code_cache._relocate(half, ctypes.addressof(place), [ctypes.addressof(place) + (1 << 40)])


@pytest.mark.slow
def test_types_of_another_version_are_no_obstacle(run_kernels, tmp_path):
    """Who calls a kernel may have moved what he calls it with, while the kernel stayed."""
    run_kernels(tmp_path / "before", "old_types")
    assert run_kernels(tmp_path / "after", "new_types") == ["4.0", NONE]


def test_fields_in_another_order_are_compiled_anew():
    def named(*fields):
        return namedtuple("Pair", fields)(1.0, 2.0)

    assert describe_argument(named("a", "b")) != describe_argument(named("b", "a"))
    assert describe_argument((named("a", "b"),)) != describe_argument((named("b", "a"),))


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
    ids=lambda value: describe_argument(value)[:30],
)
def test_values_and_numbas_types_of_them_have_one_text(value):
    assert describe_types((typeof(value),)) == describe_argument(value)


@pytest.mark.parametrize("value", ["text", 1j, [1.0], np.int8(1)])
def test_what_kernels_do_not_take_is_refused(value):
    with pytest.raises(TypeError, match=f"no {type(value).__name__}"):
        vector_kernels.copy_values(value, np.zeros(1))
