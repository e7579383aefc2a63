"""Kernels as Python calls them: stored machine code is loaded without the compiler.

What is not stored is compiled by inner.py, which alone knows numba.
"""

from __future__ import annotations

import functools
import importlib
import threading
from collections.abc import Callable
from typing import Any

from featherfx.jit.forms import call_of, text_of
from featherfx.jit.loaded import OWN, Loaded
from featherfx.jit.objects import CannotBeLoadedError, loaded
from featherfx.jit.stored import Code, Kept, Link

# threads load one kernel after another, each with all that it calls
_LOADING = threading.RLock()


class Kernel:
    """A compiled function as Python calls it.

    returns: what a shared one returns: None, bool, int, float or a NamedTuple of these; apart: no
    two of its arrays overlap; compiled: for how many types it was compiled by this process.
    """

    def __init__(
        self, function: Callable[..., Any], returns: Any = OWN, apart: bool = False
    ) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.returns, self.apart, self.compiled = function, returns, apart, 0
        self._by_form: dict[tuple[Any, ...], Loaded] = {}
        self._by_text: dict[str, Loaded] = {}

    def __call__(self, *arguments: Any) -> Any:
        form, words = call_of(arguments)
        code = self._by_form.get(key := tuple(form))
        if code is None:
            text = _text(arguments)
            code = self.found(text)
            if code is None:
                from featherfx.jit.inner import types_of

                code = self.compile_for(text, types_of(arguments))
            self._by_form[key] = code
        return code(words)

    @functools.cached_property
    def kept(self) -> Kept:
        """What is stored of it."""
        return Kept(self.py_func)

    @functools.cached_property
    def linked(self) -> Any:
        """How numba sees it in other kernels."""
        from featherfx.jit.inner import linked_of

        return linked_of(self)

    @property
    def _numba_type_(self) -> Any:
        return self.linked._numba_type_

    @property
    def is_asked_for(self) -> bool:
        """Whether others know it already, for whatever types: loaded, or compiled ahead."""
        return bool(self._by_text) or bool("linked" in vars(self) and self.linked.overloads)

    def compile_ahead(self, arguments: tuple[Any, ...]) -> None:
        """Have it compiled by others if it is not stored."""
        if not self.is_there(_text(arguments)):
            from featherfx.jit.inner import types_of

            self.linked.compile(types_of(arguments))

    def is_there(self, text: str) -> bool:
        """Whether there is machine code for arguments of a text, loaded or stored."""
        return text in self._by_text or self.kept.holds(text)

    def for_types(self, text: str, types: tuple[Any, ...]) -> Loaded:
        """Machine code for numba's types, loaded or compiled."""
        return self.found(text) or self.compile_for(text, types)

    def compile_for(self, text: str, types: tuple[Any, ...]) -> Loaded:
        """Compile it for numba's types, unless others have meanwhile, and store it."""
        from featherfx.jit.inner import compile_entry, wait_for

        if self.returns is not OWN:
            wait_for(self, types)
        with _LOADING:
            if (found := self.found(text)) is None:
                code, found = compile_entry(self, types)
                self.compiled += 1
                self.kept.save(text, code)
                self._by_text[text] = found
        return found

    def found(self, text: str) -> Loaded | None:
        """What is loaded, or stored and can be loaded."""
        with _LOADING:
            if text not in self._by_text:
                for code in self.kept.load(text):
                    if (found := _load(code)) is not None:
                        self._by_text[text] = found
                        break
            return self._by_text.get(text)


def _text(arguments: tuple[Any, ...]) -> str:
    return ", ".join(map(text_of, arguments))


def _load(code: Code) -> Loaded | None:
    """Stored machine code with all that it calls; None where some of that is of types that are
    gone."""
    links: dict[str, int] = {}
    for link in code.links:
        if (own := _linked(link)) is None:
            return None
        links[link.symbol] = own
    try:
        found = loaded(code.machine, links)
    except CannotBeLoadedError:
        from featherfx.jit.inner import loaded_by_llvm

        found = loaded_by_llvm(code, links)
    return Loaded(found[code.entry], found[code.own], code.returns)


def _linked(link: Link) -> int | None:
    """Address of a shared kernel that stored code calls."""
    kernel = getattr(importlib.import_module(link.module), link.name)
    if (found := kernel.found(link.text)) is None:
        from featherfx.jit.inner import types_in

        if (types := types_in(link)) is None:
            return None
        found = kernel.compile_for(link.text, types)
    return int(found.own)
