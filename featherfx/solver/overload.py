"""Overload of a feather that could not be solved: more energy in its pose than keratin bears."""

from __future__ import annotations

from collections.abc import Callable

from featherfx.mechanics.model import Model
from featherfx.solver.state import State
from featherfx.solver.step.energy_kernels import elastic_energy

# J/kg, of keratin of 2.5 GPa (Bonser and Purslow 1995) and 1300 kg/m3 that is strained by a tenth
# throughout, about where it breaks
_BREAKING_ENERGY = 1e4


def specific_energy(model: Model, state: State, f: int) -> float:
    """Elastic energy of feather f over its mass, J/kg."""
    strains, gaps = state.strains.at(f, 0), state.gaps_of(f)
    energy = float(elastic_energy(model, f, strains, strains, gaps, 0.0))
    return energy / float(model.mass[f].sum())


def describe_overload(held: float) -> str:
    """Describe the overload of a feather that holds so much (J/kg); empty where it is none."""
    if not held > _BREAKING_ENERGY:
        return ""
    return (
        f"its pose holds {held:.2g} J/kg, {held / _BREAKING_ENERGY:.2g} times what keratin breaks "
        "at: look at how its root moves, at grips and forces, and at its stiffness"
    )


def overload_describer(model: Model, state: State) -> Callable[[int], str]:
    """Return the function that describes the overload of feather f of a state, for
    raise_if_failed."""
    return lambda f: describe_overload(specific_energy(model, state, f))
