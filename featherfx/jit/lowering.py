"""How kernels' variables become LLVM's: as values where they can be, not as places in memory.

numba gives a variable a place in memory when several blocks of its function use it, stores it there
once and loads it whole for every use. Where a variable is a tuple of a hundred arrays LLVM has to
take each of these apart again. A variable that is assigned in one place, which every use comes
after, is a value here: arguments above all.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from numba.core import ir
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
from numba.core.compiler import DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering


class KernelLower(Lower):
    """As numba's, with more values."""

    def _find_singly_assigned_variable(self) -> None:
        super()._find_singly_assigned_variable()
        self._singly_assigned_vars |= values_of(self.blocks)


def values_of(blocks: Any) -> set[str]:
    """Variables that are assigned once, in a block that every other block that uses them comes
    after."""
    defined = defaultdict(list)
    for label, block in blocks.items():
        for each in block.find_insts(ir.Assign):
            defined[each.target.name].append(label)
    found = {name for name, at in defined.items() if len(at) == 1} - must_use_alloca(blocks)
    before = compute_cfg_from_blocks(blocks).dominators()
    for label, used in compute_use_defs(blocks).usemap.items():
        for name in found & set(used):
            (at,) = defined[name]
            if at >= label or at not in before.get(label, ()):
                found.discard(name)
    return found


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """numba's step from typed to LLVM's intermediate code, by KernelLower."""

    _name = "kernel_lowering"

    @property
    def lowering_class(self) -> type[KernelLower]:
        return KernelLower


def pipeline_of(state: Any, lowering: type[KernelLowering]) -> Any:
    """numba's own steps of compiling, with another step to intermediate code."""
    steps = DefaultPassBuilder.define_nopython_pipeline(state).passes
    manager = PassManager("nopython")
    manager.passes.extend(
        (lowering if step is NativeLowering else step, says) for step, says in steps
    )
    manager.finalize()
    return manager
