"""The steady state by collocation: a route to it that uses no closed form."""

import equinox as eqx
from jaxtyping import Array, Float

from beltjax.analysis.steady import AbstractSteadyMethod
from beltjax.drive.components import as_real
from beltjax.numerics.bvp.gauss import MOST_STAGES, gauss
from beltjax.physics import steady as physics
from beltjax.physics import steady_collocation as collocation


class Collocation(AbstractSteadyMethod):
    """The nonlinear model by Gauss collocation on each span, (3.48)-(3.55) for n pulleys.

    `intervals` a span, dense in the ends' layers: the default resolves eps from 0.001 to 0.3.
    `tol` is the estimated error allowed in (3.41), in mean span lengths; above it the result is
    `RESULTS.mesh_exhausted`. The mesh is held under differentiation.
    """

    intervals: int = eqx.field(static=True, default=24)
    stages: int = eqx.field(static=True, default=4)
    tol: Float[Array, ""] = eqx.field(converter=as_real, default=1e-9)

    def __check_init__(self):
        if self.intervals < 4:
            raise ValueError(f"Collocation: intervals must be at least 4, not {self.intervals}.")
        if not 2 <= self.stages < MOST_STAGES:
            raise ValueError(
                f"Collocation: stages must be from 2 to {MOST_STAGES - 1}, not {self.stages}."
            )

    def solve(self, model: physics.SteadyModel) -> physics.SteadySolution:
        """All spans at once; T and q by Newton's method on the equations that join them."""
        scheme, finer = gauss(self.stages), gauss(self.stages + 1)
        return collocation.collocated(model, scheme, finer, self.intervals, self.tol)

    def coupling(
        self, model: physics.SteadyModel, solved: physics.SteadySolution
    ) -> Float[Array, " spans"]:
        """By the Gauss formula, on the mesh of the solution."""
        assert solved.coupling is not None
        return solved.coupling

    def deflection(self, model: physics.SteadyModel, q, Q, i, x: Array) -> Array:
        """The collocation polynomial."""
        scheme = gauss(self.stages)
        return collocation.deflection(model, q, Q, i, x, scheme, self.intervals)
