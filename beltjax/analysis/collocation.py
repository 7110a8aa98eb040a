"""The steady state by collocation, which uses no closed form."""

import equinox as eqx
from jaxtyping import Array, Float

from beltjax.analysis.steady import AbstractSteadyMethod
from beltjax.drive.components import as_real
from beltjax.numerics.bvp.gauss import MOST_STAGES, gauss
from beltjax.physics import steady as physics
from beltjax.physics import steady_collocation as collocation


class Collocation(AbstractSteadyMethod):
    """The nonlinear model by Gauss collocation on each span, (3.48)-(3.55) for n pulleys.

    Each span has `intervals` intervals with `stages` collocation points each, most of them in the
    layers at its ends: the default resolves eps from 0.001 to 0.3. `tol` is the estimated error
    allowed in (3.41), in mean span lengths; above it the result is `RESULTS.mesh_exhausted`. The
    mesh is held fixed under differentiation. Raises `ValueError` for fewer than 4 intervals, and
    for fewer than 2 stages or more than 7.
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
        """Tensions and coordinates by Newton's method on the equations that join the spans."""
        scheme, finer = gauss(self.stages), gauss(self.stages + 1)
        return collocation.collocated(model, scheme, finer, self.intervals, self.tol)

    def coupling(
        self, model: physics.SteadyModel, solved: physics.SteadySolution
    ) -> Float[Array, " spans"]:
        """Gamma_i by the Gauss formula on the mesh of the solution."""
        assert solved.coupling is not None
        return solved.coupling

    def deflection(
        self,
        model: physics.SteadyModel,
        q: physics.Coordinates,
        Q: physics.Spans,
        i: physics.Index,
        x: Array,
    ) -> Array:
        """w_i(x) by the collocation polynomial."""
        scheme = gauss(self.stages)
        return collocation.deflection(model, q, Q, i, x, scheme, self.intervals)
