"""Names of what only compiling needs: it is imported when a kernel is compiled that uses it.

Kernels whose machine code is stored run without the compiler, which takes 70 MiB and a quarter of a
second of a process.
"""

from __future__ import annotations

import importlib
from typing import Any

# modules of all that is named
MODULES: list[str] = []
# addresses of what kernels call that is not the system's, by name
GIVEN: dict[str, int] = {}


class Late:
    """Something of a module that imports numba, for kernels to use."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name
        if module not in MODULES:
            MODULES.append(module)

    @property
    def _numba_type_(self) -> Any:
        from numba.core.registry import cpu_target

        meant = getattr(importlib.import_module(self._module), self._name)
        return cpu_target.typing_context.resolve_value_type(meant)


def give(name: str, address: int) -> None:
    """Let machine code call a function by a name."""
    GIVEN[name] = address


def import_all() -> None:
    """Import them, before anything is compiled."""
    for each in MODULES:
        importlib.import_module(each)
