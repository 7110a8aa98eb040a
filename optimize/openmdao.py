"""A study's design as a component of an OpenMDAO model, with exact derivatives.

Needs the extra `openmdao`.
"""

from typing import Any

import jax
import jax.numpy as jnp
import openmdao.api as om

from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.numbers import unit_of, with_values

from .problem import Measured, measured, own_values, part_counts, with_tied
from .quantities import find_quantity
from .study import Study, split_name

_SPELLED = {"rad/s": "rad/s", "N m": "N*m", "N m/rad": "N*m/rad", "N m^2": "N*m**2", "": None}


def variable_name(name: str) -> str:
    """A name as OpenMDAO allows it: "pulley.water pump.radius" is "pulley_water_pump_radius"."""
    return "".join(c if c.isalnum() else "_" for c in name)


class DriveComponent(om.ExplicitComponent):
    """Inputs: a study's variables. Outputs: `objective`, and its constrained quantities.

    A quantity of many parts is an array; its limits are the model's to give. All in SI. A design
    that has no answer raises `openmdao.api.AnalysisError`, from which drivers step back. A study
    with tolerances raises `ValueError`.
    """

    def initialize(self) -> None:
        """Declare the study."""
        self.options.declare("study", types=Study, desc="what is measured, and where")

    def setup(self) -> None:
        """Declare inputs, outputs and that all partial derivatives are exact."""
        study: Study = self.options["study"]
        if study.scatter is not None:  # a quantity has two values, one for either limit
            raise ValueError("DriveComponent: the study has tolerances; use `minimize`.")
        own = own_values(study)
        for name in study.variables.names:
            self.add_input(variable_name(name), own[name], units=_units(unit_of(study.drive, name)))
        self.add_output("objective", 0.0)
        counts = part_counts(study)
        for name, parts in zip(study.constraints.names, counts, strict=True):
            unit = find_quantity(split_name(name)[0], study.drive).unit
            self.add_output(variable_name(name), shape=parts, units=_units(unit))
        self.declare_partials("*", "*")

    def compute(self, inputs: Any, outputs: Any) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Measure one design."""
        at, _ = self._at(inputs)
        outputs["objective"] = at.objective
        for name, value in zip(self.options["study"].constraints.names, at.greatest, strict=True):
            outputs[variable_name(name)] = value

    def compute_partials(self, inputs: Any, partials: Any) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Exact derivatives of all outputs."""
        _, slopes = self._at(inputs)
        study: Study = self.options["study"]
        outputs = [("objective", slopes.objective)]
        outputs += zip(map(variable_name, study.constraints.names), slopes.greatest, strict=True)
        for i, name in enumerate(study.variables.names):
            for output, slope in outputs:
                partials[output, variable_name(name)] = slope[..., i]

    def _at(self, inputs: Any) -> tuple[Measured, Measured]:
        study: Study = self.options["study"]
        x = jnp.array([inputs[variable_name(name)][0] for name in study.variables.names])
        at, slopes = jax.device_get(quickly_compiled(_with_slopes)(study, x))
        if not at.found:
            raise om.AnalysisError("no drive runs with these numbers")
        return at, slopes


def _with_slopes(study: Study, x: jax.Array) -> tuple[Measured, Measured]:
    """The measured quantities at the values x of the variables, and their derivatives."""

    def at(x: jax.Array) -> tuple[Measured, Measured]:
        values = dict(zip(study.variables.names, x, strict=True))
        found = measured(study, with_values(study.drive, with_tied(study.ties, values)))
        return found._replace(found=jnp.zeros(())), found

    slopes, found = jax.jacfwd(at, has_aux=True)(x)
    return found, slopes


def _units(unit: str) -> str | None:
    return _SPELLED.get(unit, unit.replace("^", "**"))
