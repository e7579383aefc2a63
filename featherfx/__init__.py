"""featherfx: from feather grooms to simulated, time-sampled USD geometry.

`featherfx.bake` and `featherfx.export_groom` do what the commands of the same kind do; they are
loaded when first asked for, so that `import featherfx` stays light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from featherfx.pipeline import bake, export_groom

__version__ = "0.1.0"
__all__ = ["__version__", "bake", "export_groom"]


def __getattr__(name: str) -> Any:
    if name in ("bake", "export_groom"):
        from featherfx import pipeline

        return getattr(pipeline, name)
    raise AttributeError(f"module 'featherfx' has no attribute '{name}'")
