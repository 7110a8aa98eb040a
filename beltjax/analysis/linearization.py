"""Linearization of a drive about its steady state: mass, gyroscopic and stiffness matrices."""

from typing import overload

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from beltjax.analysis.cushion import CushionState
from beltjax.analysis.cushion_vibration import CushionLinearization, linearize_cushion
from beltjax.analysis.steady import SteadyState
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import as_optional
from beltjax.drive.groups import Groups, Scales
from beltjax.drive.shafts import has_rotor_inertias
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.physics import span
from beltjax.physics.vibration import VibrationModel, assembled, elongations
from beltjax.results import RESULTS, frozen_where_failed, raise_unless_successful, succeeded


class Linearization(eqx.Module):
    """M z'' + G z' + K z = f about a steady state, dimensionless.

    The coordinates are the basis functions of span 1, of span 2, .., the rotations of the rotors
    `rotors` [rad, in the direction of belt travel], and the tensioners' coordinates over their
    `units`. Energies are in `scales.energy`, times in `scales.time`. The driver's hub is held
    unless `free`. The matrices follow from `model` and `elongations`, through which undamped
    frequencies are differentiated: a change to a matrix alone does not enter their derivatives.
    """

    mass: Float[Array, "size size"]
    gyroscopic: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]
    elongations: Float[Array, "spans size"]  # strain of each span per unit of each coordinate
    driving: Float[Array, " spans"]  # and per radian of the driver, where it is held
    twisting: Float[Array, " turning"]  # moment on the other rotors per radian of the driver
    model: VibrationModel
    rotors: Int[Array, " turning"]  # places of the rotors that turn
    driver: Int[Array, ""]  # place of the driver's hub among the rotors
    steady: SteadyState
    result: RESULTS
    basis: AbstractBasis
    free: bool = eqx.field(static=True)
    mixed: bool = eqx.field(static=True)  # parts of it belong to different steady states

    @property
    def scales(self) -> Scales:
        """Units of lengths, tensions and times."""
        return self.steady.scales

    @property
    def units(self) -> Float[Array, " coordinates"]:
        """Units of the tensioners' coordinates: 1 rad, or the mean span length [m]."""
        return self.steady.groups.units

    @property
    def spans(self) -> int:
        """Number of spans."""
        return len(self.model.lam)

    @property
    def bodies(self) -> int:
        """Number of tensioners."""
        return len(self.model.movable)

    def split(self, z: Array) -> tuple[Array, Array, Array]:
        """Parts of coordinates [..., size]: fields, rotations and the tensioners' coordinates.

        Fields are [..., spans, n]. Rotations are [..., rotors] and 0 where a rotor is held. A
        tensioner's coordinate is over its unit, and 0 where it does not move.
        """
        n, turning = self.spans * self.basis.size, len(self.rotors)
        fields = z[..., :n].reshape(*z.shape[:-1], self.spans, self.basis.size)
        rotations = jnp.zeros((*z.shape[:-1], self.model.turns.shape[1]), z.dtype)
        rotations = rotations.at[..., self.rotors].set(z[..., n : n + turning])
        return fields, rotations, z[..., n + turning :] * self.model.movable

    def of_pulleys(self, rotations: Array) -> Array:
        """Rotations [..., pulleys] of the pulleys' hubs, from those of the rotors."""
        return rotations @ self.steady.groups.hubs.T

    def deflection(self, z: Array, i: int | Int[Array, ""], x: Array, order: int = 0) -> Array:
        """w_i at x [...] for coordinates z [size], or its derivative of order 1 or 2.

        Both w and x are over the span's own length; w includes the lift by the tensioners.
        """
        fields, _, moved = self.split(z)
        start, slope = self.model.W0[i] @ moved, self.model.a[i] @ moved
        lift = (start + slope * x, slope, 0.0)[order]
        return self.basis.values(x, order) @ fields[i] + lift


@overload
def linearize(
    steady: SteadyState,
    basis: AbstractBasis | None = None,
    *,
    free: bool = False,
    fixed_steady: SteadyState | None = None,
    fixed_bending: Float[Array, ""] | float | None = None,
    throw: bool = True,
) -> Linearization: ...


@overload
def linearize(
    steady: CushionState, basis: AbstractBasis | None = None, *, throw: bool = True
) -> CushionLinearization: ...


def linearize(
    steady: SteadyState | CushionState,
    basis: AbstractBasis | None = None,
    *,
    free: bool = False,
    fixed_steady: SteadyState | None = None,
    fixed_bending: Float[Array, ""] | float | None = None,
    throw: bool = True,
) -> Linearization | CushionLinearization:
    """Mass, gyroscopic and stiffness matrices of the drive about its steady state.

    They are the second variation of the drive's energy: Kong (2003), chapter 4, for any number of
    pulleys, tensioners, isolators and belts; docs/theory/vibration.md.

    About the state of a belt on a cushion, as `cushion_state` returns it, the cords move on the
    pulleys, too: docs/theory/cushion.md, (U9) to (U12). That model has neither torques nor bending:
    the state is found once more without torques. Its basis is `Legendre(12)` unless given.

    The result is that of the steady states, or `successful`. With `throw=False` read `.result`: the
    matrices of a failed state are placeholders without derivatives.

    Args:
        steady: the steady state, as `steady_state` returns it, or `cushion_state`.
        basis: functions for the deflections of each span, `Legendre(24)` unless given; `Sine(n)`
            is that of the source.
        free: let the driver turn as the other pulleys do, so that the drive has a rigid rotation;
            otherwise its motion is given, and it stands still in a natural mode.
        fixed_steady: another steady state from which deflections and tensions are taken. With
            `fixed_bending` it separates the two effects of bending stiffness, as Fig. 4.6 does.
        fixed_bending: eps of the belt's resistance to bending, where that is not the drive's own.
        throw: raise where the result is a failure.

    Returns:
        The matrices, dimensionless and of shape [size, size], and what they were made from.

    Raises:
        ValueError: a pulley or a tensioner has no inertia, or `basis` is not a basis.
        AnalysisError: a steady state failed, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> linearization = bj.linearize(bj.steady_state(drive, point), bj.Legendre(16))
        >>> bj.modes(linearization, 4).frequencies  # [rad/s]
    """
    if isinstance(steady, CushionState):
        if free or fixed_steady is not None or fixed_bending is not None:
            raise ValueError(
                "linearize: free, fixed_steady and fixed_bending are not for a belt on a cushion; "
                "leave them out."
            )
        about = linearize_cushion(steady, basis)
        return raise_unless_successful(about, about.result, throw)
    basis = Legendre(24) if basis is None else basis
    if not isinstance(basis, AbstractBasis):
        raise ValueError(f"basis: found {basis!r}; give Sine(n) or Legendre(n).")
    bending = as_optional(fixed_bending)
    found = _linearized(strongly_typed(steady), basis, free, strongly_typed(fixed_steady), bending)
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _linearized(
    steady: SteadyState,
    basis: AbstractBasis,
    free: bool,
    fixed_steady: SteadyState | None,
    fixed_bending: Float[Array, ""] | None,
) -> Linearization:
    shaped = steady if fixed_steady is None else fixed_steady
    model = vibration_model(steady, shaped, fixed_bending)
    result = RESULTS.where(succeeded(steady.result), shaped.result, steady.result)
    order = rotors_in_order(steady)
    driver = order[0]
    turning = order if free else order[1:]
    d = elongations(model, basis, turning)
    whole = assembled(model, basis, d, turning)
    good, unit = succeeded(result), jnp.eye(len(whole.mass))
    linearization = Linearization(
        mass=jnp.where(good, whole.mass, unit),
        gyroscopic=jnp.where(good, whole.gyroscopic, 0.0),
        stiffness=jnp.where(good, whole.stiffness, unit),
        elongations=jnp.where(good, d, 0.0),
        driving=jnp.where(good, model.turns[:, driver], 0.0) * (not free),
        twisting=model.K_r[turning, driver] * (not free),
        model=model,
        rotors=turning,
        driver=driver,
        steady=steady,
        result=result,
        basis=basis,
        free=free,
        mixed=fixed_steady is not None or fixed_bending is not None,
    )
    return frozen_where_failed(linearization, result)


def rotors_in_order(steady: SteadyState) -> Int[Array, " rotors"]:
    """Places of the rotors: the driver's hub comes first, the others in their order."""
    return jnp.argsort(-steady.groups.held_rotor, stable=True)


def vibration_model(
    steady: SteadyState, shaped: SteadyState, eps: Float[Array, ""] | None = None
) -> VibrationModel:
    """The drive in the letters of the source, with the deflections and tensions of `shaped`."""
    g, h = steady.groups, shaped.groups
    if g.rotor_inertias is None:
        raise ValueError(
            "Pulley.inertia: missing for a pulley, or for an isolator's rim; vibration needs the "
            "inertia of each."
        )
    if g.arm_inertia is None:
        raise ValueError("Tensioner.inertia: missing; vibration needs it for every tensioner.")
    loops = g.loops
    lam, travel = g.span_ratios, g.travel
    u, z = span.layer_width(loops.spread(h.bendings), h.span_ratios, shaped.effective_tensions)
    moved = shaped.deviation / h.units
    ends = loops.following(jnp.eye(len(lam))) - jnp.eye(len(lam))
    eps = loops.spread(g.bendings) if eps is None else jnp.broadcast_to(eps, lam.shape)
    return VibrationModel(
        eps=eps,
        s=loops.spread(g.speeds),
        tau=travel,
        gam=loops.spread(g.stretches),
        mu=loops.spread(g.masses),
        lam=lam,
        Q=shaped.effective_tensions,
        kap_s=h.curvature_start,
        kap_e=h.curvature_end,
        u=u,
        z=z,
        drop=h.slopes @ moved,
        a=g.slopes,
        W0=g.lifts,
        pull=(g.pulls + g.curvatures @ moved) / lam[:, None],
        H=g.curvatures,
        K=g.springs,
        M=g.arm_inertia,
        movable=g.movable * (shaped.at_stop == 0),
        turns=(travel / lam)[:, None] * (ends * g.radius_ratios) @ g.turning,
        K_r=g.rotor_springs,
        M_r=jnp.diag(g.rotor_inertias) + g.turning.T @ belt_inertia(g) @ g.turning,
    )


def belt_inertia(groups: Groups) -> Float[Array, "pulleys pulleys"]:
    """Inertia of the belt's own motion along its path, for the pulleys' rotations.

    docs/theory/bodies.md, (M14). Spans move as straight lines between the rims that they leave
    and meet, and arcs move with their pulleys. The inertia is zero where the model leaves it out,
    as the source does.
    """
    g, loops = groups, groups.loops
    spans = loops.spread(g.masses) * g.span_ratios
    arcs = loops.spread(g.masses) * g.arc_ratios
    own = jnp.diag(arcs + (spans + loops.preceding(spans)) / 3)
    unit = jnp.eye(len(spans))
    shared = (spans / 6)[:, None] * loops.following(unit)  # between a span's first pulley and next
    r = g.radius_ratios
    return g.belt_inertia * r[:, None] * (own + shared + shared.T) * r


def has_inertias(drive: Drive) -> bool:
    """Whether all rotors and tensioners have the inertia that vibration needs."""
    bodies = all(body.inertia is not None for body in drive.tensioners)
    return bodies and has_rotor_inertias(drive)
