"""Kernels that Python calls by the names of their modules, which only compiling imports."""

import ast
import importlib
import subprocess
import sys

import pytest
from kernel_runs import ROOT

from featherfx.jit.compiled import Kernel

SUM_ROWS = """
import sys
import numpy as np
from featherfx.algebra.interpolation import rows_of
rows = rows_of(np.array([[2.0, 3.0]]), np.array([[0, 1]]))
print((rows @ np.ones((2, 1))).item(), "featherfx.algebra.element_kernels" in sys.modules)
"""


def named_kernels():
    """(file, module, kernel) of every kernel that is called by its module's name."""
    for file in sorted(ROOT.rglob("*.py")):
        if "KernelModule(" not in (text := file.read_text()):
            continue
        nodes = [*ast.walk(ast.parse(text))]
        modules = {
            node.targets[0].id: node.value.args[0].value
            for node in nodes
            if isinstance(node, ast.Assign)
            and isinstance(node.value, ast.Call)
            and getattr(node.value.func, "id", "") == "KernelModule"
        }
        for node in nodes:
            if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") in modules:
                yield file.name, modules[node.value.id], node.attr


@pytest.mark.parametrize(("file", "module", "name"), sorted(set(named_kernels())))
def test_every_named_kernel_is_there(file, module, name):
    assert isinstance(getattr(importlib.import_module(module), name), Kernel)


def test_stored_code_runs_without_the_module_of_its_kernel():
    runs = [subprocess.run([sys.executable, "-c", SUM_ROWS], capture_output=True) for _ in range(2)]
    assert runs[1].stdout.split() == [b"5.0", b"False"], runs[1].stderr
