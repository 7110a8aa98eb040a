"""Linearization of a drive about its steady state: mass, gyroscopic and stiffness matrices."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from beltjax.analysis.steady import SteadyState
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import Drive, as_optional
from beltjax.drive.groups import Scales
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.physics import span
from beltjax.physics.vibration import (
    VibrationModel,
    assembled,
    elongations,
    turning_strains,
)
from beltjax.results import RESULTS, frozen_where_failed, raise_unless_successful, succeeded


class Linearization(eqx.Module):
    """M z'' + G z' + K z = f about a steady state, dimensionless.

    Coordinates: the basis functions of span 1, of span 2, .., the rotations of the pulleys
    `pulleys` [rad, in the direction of belt travel], the arm's rotation if there is an arm.
    Energies are in P0 r_t, times in `scales.time`. The driver is held unless `free`. The matrices
    follow from `model` and `elongations`, through which the derivatives of undamped frequencies
    are taken: a change to a matrix alone has none.
    """

    mass: Float[Array, "size size"]
    gyroscopic: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]
    elongations: Float[Array, "spans size"]  # strain of each span per unit of each coordinate
    driving: Float[Array, " spans"]  # and per radian of the driver, where it is held
    model: VibrationModel
    pulleys: Int[Array, " turning"]  # places of the pulleys that turn, in the drive's list
    driver: Int[Array, ""]  # place of the driver in that list
    steady: SteadyState
    result: RESULTS
    basis: AbstractBasis
    free: bool = eqx.field(static=True)
    has_arm: bool = eqx.field(static=True)
    mixed: bool = eqx.field(static=True)  # parts of it belong to different steady states

    @property
    def scales(self) -> Scales:
        """What lengths, tensions and times are measured in."""
        return self.steady.scales

    @property
    def joules(self) -> Float[Array, ""]:
        """P0 r_t, the unit of energies and moments [J]."""
        return self.scales.tension * self.model.rho * self.scales.length

    @property
    def spans(self) -> int:
        """Number of spans."""
        return len(self.model.lam)

    def split(self, z: Array) -> tuple[Array, Array, Array]:
        """Coordinates [..., size] as fields [..., spans, n], rotations [..., pulleys] and arm.

        Rotations of pulleys that are held, and of an arm that is not there, are zero.
        """
        n = self.spans * self.basis.size
        fields = z[..., :n].reshape(*z.shape[:-1], self.spans, self.basis.size)
        turning = z[..., n : n + len(self.pulleys)]
        whole = jnp.zeros((*z.shape[:-1], self.spans), z.dtype)
        arm = z[..., -1] if self.has_arm else jnp.zeros(z.shape[:-1], z.dtype)
        return fields, whole.at[..., self.pulleys].set(turning), arm

    def deflection(self, z: Array, i, x: Array, order: int = 0) -> Array:
        """w_i at x [...] for coordinates z [size], or its derivative of order 1 or 2.

        Both w and x are over the span's own length; the arm's lift is counted.
        """
        fields, _, arm = self.split(z)
        m = self.model
        lift = (m.w_start[i] + m.a[i] * x, m.a[i], 0.0)[order]
        return self.basis.values(x, order) @ fields[i] + lift * arm


def linearize(
    steady: SteadyState,
    basis: AbstractBasis | None = None,
    *,
    free: bool = False,
    fixed_steady: SteadyState | None = None,
    fixed_bending: Float[Array, ""] | float | None = None,
    throw: bool = True,
) -> Linearization:
    """Mass, gyroscopic and stiffness matrices of the drive about its steady state.

    Kong (2003), chapter 4, for any number of pulleys: the second variation of the drive's energy.
    `basis` is `Legendre(24)` unless given; `Sine(n)` is the source's. The driver is held still,
    or with `free` turns as the other pulleys do (and the drive has a rigid rotation).

    To tell apart the two ways in which bending stiffness acts, as Fig. 4.6 does:
    `fixed_steady` takes deflections and tensions from another steady state, `fixed_bending` the
    belt's resistance to bending (eps) from elsewhere.

    Raises `ValueError` where a pulley or the arm has no inertia. Fails as the steady states
    failed. With `throw=False` read `.result`: the matrices of a failed state are placeholders
    without derivatives.
    """
    basis = Legendre(24) if basis is None else basis
    if not isinstance(basis, AbstractBasis):
        raise ValueError(f"basis: found {basis!r}; give Sine(n) or Legendre(n).")
    bending = as_optional(fixed_bending)
    found = _linearized(strongly_typed(steady), basis, free, strongly_typed(fixed_steady), bending)
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _linearized(steady, basis, free: bool, fixed_steady, fixed_bending) -> Linearization:
    shaped = steady if fixed_steady is None else fixed_steady
    model = _model(steady, shaped, fixed_bending)
    result = RESULTS.where(succeeded(steady.result), shaped.result, steady.result)
    has_arm = steady.reference.arm_angle is not None
    order, driver = _turning(steady)
    pulleys = order if free else order[1:]
    d = elongations(model, basis, pulleys, has_arm)
    whole = assembled(model, basis, d, pulleys, has_arm)
    good, unit = succeeded(result), jnp.eye(len(whole.mass))
    linearization = Linearization(
        mass=jnp.where(good, whole.mass, unit),
        gyroscopic=jnp.where(good, whole.gyroscopic, 0.0),
        stiffness=jnp.where(good, whole.stiffness, unit),
        elongations=jnp.where(good, d, 0.0),
        driving=jnp.where(good, turning_strains(model)[:, driver], 0.0) * (not free),
        model=model,
        pulleys=pulleys,
        driver=driver,
        steady=steady,
        result=result,
        basis=basis,
        free=free,
        has_arm=has_arm,
        mixed=fixed_steady is not None or fixed_bending is not None,
    )
    return frozen_where_failed(linearization, result)


def _turning(steady: SteadyState) -> tuple[Int[Array, " pulleys"], Int[Array, ""]]:
    """Places of all pulleys, the driver first and the others in listed order; the driver's."""
    drives = steady.groups.drives
    order = jnp.argsort(-drives, stable=True)
    return order, order[0]


def _model(steady: SteadyState, shaped: SteadyState, eps) -> VibrationModel:
    """The drive in the letters of the source, its deflections and tensions as in `shaped`."""
    g, h = steady.groups, shaped.groups
    if g.pulley_inertias is None:
        raise ValueError(
            "Pulley.inertia: missing for a pulley; vibration needs the inertia of every pulley."
        )
    has_arm = steady.reference.arm_angle is not None
    if has_arm and g.arm_inertia is None:
        raise ValueError("Tensioner.inertia: missing; vibration needs the inertia of the arm.")
    u, z = span.layer_width(h.bending, h.span_ratios, shaped.effective_tensions)
    return VibrationModel(
        eps=g.bending if eps is None else eps,
        s=g.speed,
        tau=g.travel,
        gam=g.stretch,
        k_s=g.spring,
        lam=g.span_ratios,
        rho=g.arm_ratio,
        Q=shaped.effective_tensions,
        kap_s=h.curvature_start,
        kap_e=h.curvature_end,
        u=u,
        z=z,
        drop=h.arm_slope * shaped.arm_rotation,
        a=g.arm_slope,
        w_start=g.arm_lift,
        pull=g.arm_strain,
        r=g.radius_ratios,
        J=g.pulley_inertias,
        J_t=jnp.zeros(()) if g.arm_inertia is None else g.arm_inertia,
    )


def has_inertias(drive: Drive) -> bool:
    """Whether every pulley and the arm have the inertia that vibration needs."""
    arm = drive.tensioner is None or drive.tensioner.inertia is not None
    return arm and all(pulley.inertia is not None for pulley in drive.pulleys)
