"""Natural modes of a drive whose cords ride on a cushion, and their derivatives."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from beltjax.analysis.cushion import CushionState, cushion_state
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.assembly import assembled
from beltjax.drive.bodies import mass_matrix
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.contact_groups import TravelOrder
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.numerics.gyroscopic import eigenvalues, hermitian_modes
from beltjax.physics import cushion
from beltjax.physics import cushion_vibration as physics
from beltjax.physics.cushion_vibration import Mesh, Vibrating
from beltjax.physics.inclined_arcs import ArcEnds
from beltjax.results import RESULTS, first_failure, frozen_where_failed, succeeded

ELEMENTS = 6  # on each arc


class CushionLinearization(eqx.Module):
    """M z'' + G z' + K z = 0 about the state without torques, in SI units.

    The coordinates are those of the cords along and across the belt, on arcs and free spans in the
    order of travel, then the rotations of the pulleys [rad, in the direction of travel] and the
    tensioners' coordinates. The driver is held.
    """

    mass: Float[Array, "size size"]
    gyroscopic: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]
    model: Vibrating
    order: TravelOrder
    state: CushionState  # without torques
    result: RESULTS
    mesh: Mesh = eqx.field(static=True)


class CushionModes(Readable):
    """Natural modes z = Re(shape e^{i frequency t}), with the lowest frequency first.

    Shapes store 1 joule; in each the coordinate of the largest kinetic energy is real and positive.
    """

    frequencies: Float[Array, " count"]  # [rad/s]
    rotations: Complex[Array, "count pulleys"]  # [rad], in the direction of travel
    tensioner_motions: Complex[Array, "count tensioners"]  # [rad] or [m]
    coordinates: Complex[Array, "count size"]  # of the linearization
    rigid_shares: Float[Array, " count"]  # of the kinetic energy, in pulleys and tensioners
    linearization: CushionLinearization
    result: RESULTS


def linearize_cushion(state: CushionState, basis: AbstractBasis | None) -> CushionLinearization:
    """Matrices of the drive about its state without torques; see `linearize`."""
    basis = Legendre(12) if basis is None else basis
    if not isinstance(basis, Legendre):
        raise ValueError(
            f"basis: found {basis!r}; on a cushion give Legendre(n): n functions for the cords of "
            "each free span and 2 n/3 on each of the six elements of an arc."
        )
    drive, point = state.drive, state.point
    _require_inertias(drive)
    if point.torque or point.load:
        point = dataclasses.replace(point, torque={}, load={})
        state = cushion_state(drive, point, state.method, throw=False)
    return _linearized(strongly_typed(state), max(2, 2 * basis.size // 3), basis.size + 1)


def _require_inertias(drive: Drive) -> None:
    """Raise `ValueError` for what the vibration needs and the drive lacks, or has and it lacks."""
    bare = next((pulley.name for pulley in drive.pulleys if pulley.inertia is None), None)
    if bare is not None:
        raise ValueError(f"pulley.{bare}.inertia: missing; vibration needs it for every pulley.")
    if any(body.inertia is None for body in drive.tensioners):
        raise ValueError("tensioner.inertia: missing; vibration needs it for every tensioner.")
    if drive.isolators:
        raise ValueError(
            "isolator: found one; vibration on a cushion has rigid pulleys. Remove it, and give "
            "the pulley the inertia of rim and hub."
        )


def has_all_for_vibration(drive: Drive) -> bool:
    """Whether a drive has the inertias that modes on a cushion need, and nothing they cannot."""
    try:
        _require_inertias(drive)
    except ValueError:
        return False
    return True


@boundary_jit
def _linearized(state: CushionState, degree: int, span_degree: int) -> CushionLinearization:
    mesh = Mesh(ELEMENTS, degree, span_degree)
    model = _vibrating(state)
    matrices = physics.assembled(model, mesh)
    good, unit = succeeded(state.result), jnp.eye(len(matrices.mass))
    found = CushionLinearization(
        mass=jnp.where(good, matrices.mass, unit),
        gyroscopic=jnp.where(good, matrices.gyroscopic, 0.0),
        stiffness=jnp.where(good, matrices.stiffness, unit),
        model=model,
        order=state.order,
        state=state,
        result=state.result,
        mesh=mesh,
    )
    return frozen_where_failed(found, state.result)


def _vibrating(state: CushionState) -> Vibrating:
    """The drive in the letters of the theory, in SI units and the order of travel."""
    drive, scales, model = state.drive, state.scales, state.model
    made = assembled(drive, state.point)
    running, length, force = state.found.running, scales.length, scales.tension
    place = state.order.pulleys
    P = jnp.mean(running.P)
    spread = jnp.full_like(running.P, P)
    pull = ArcEnds(spread, spread, running.spans.turns, 0 * spread)
    layers = jax.vmap(cushion.lent)(pull, model.layers)
    arcs = jax.vmap(cushion.contact_length)(pull, layers)[0]
    soft = model.layers.soft
    arcs = jnp.where(soft > 0, arcs, layers.R * running.spans.turns)
    along_x, along_y = running.spans.along_x, running.spans.along_y
    before = model.frame.loops.preceding(jnp.arctan2(along_y, along_x))
    there = running.spans.there
    of = made.bodies
    units = jnp.where(of.rotary > 0, 1.0, length)
    mass = mass_matrix(drive, of, state.coordinates)
    assert mass is not None  # as `_require_inertias` holds
    stiffness = made.springs.matrix + made.outside.stiffness(of, state.coordinates)
    counted = jnp.maximum(
        jax.lax.stop_gradient(drive.model.arm_curvature),
        jnp.maximum(made.springs.floating[:, None], made.springs.floating),
    )
    # Pulleys on curved paths are held by the pull of the belt on them.
    pull_x, pull_y = (x - model.frame.loops.preceding(x) for x in (along_x, along_y))
    bent = jnp.tensordot(pull_x, there.twice_x, 1) + jnp.tensordot(pull_y, there.twice_y, 1)
    bent = -P * bent * force * length / (units[:, None] * units)
    return Vibrating(
        P=P * force,
        m=drive.belt.mass_per_length,
        c=state.unstretched_speed,
        EA=drive.belt.axial_stiffness,
        k_r=layers.k_r * force / length**2,
        k_s=layers.k_s * force / length**2,
        R=layers.R * length,
        side=jnp.sign(model.frame.rho),
        arcs=arcs * length,
        spans=running.spans.lengths * length,
        lam=cushion.decay(spread, layers) / length,
        start=before,
        soft=soft,
        J=jnp.stack([jnp.asarray(p.inertia) for p in drive.pulleys])[place],
        turning=1 - jax.lax.stop_gradient(model.driving),
        by_x=there.by_x * length / units,
        by_y=there.by_y * length / units,
        M_q=mass,
        K_q=stiffness + counted * bent,
        movable=(1.0 - of.locked) * (state.at_stop == 0),
    )


def cushion_modes(linearization: CushionLinearization, count: int) -> CushionModes:
    """The `count` natural modes of lowest frequency; see `modes`."""
    size = len(linearization.mass)
    if not 1 <= count <= size:
        raise ValueError(f"count: found {count}; give 1 to {size}, or a larger basis.")
    return _modes(strongly_typed(linearization), count)


@boundary_jit
def _modes(lin: CushionLinearization, count: int) -> CushionModes:
    held = jax.lax.stop_gradient(lin)
    eigen, definite = hermitian_modes(held.mass, held.gyroscopic, held.stiffness, count)
    forms = physics.forms_of(lin.model, lin.mesh, eigen.vectors)
    values = eigenvalues(eigen.values, forms)
    n, m = lin.model.by_x.shape
    first = len(lin.mass) - n - m
    rigid = eigen.vectors[:, first:]
    inertia = lin.mass[first:, first:]
    whole = jnp.einsum("ca,ab,cb->c", jnp.conj(eigen.vectors), lin.mass, eigen.vectors).real
    own = jnp.einsum("ca,ab,cb->c", jnp.conj(rigid), inertia, rigid).real
    result = first_failure(
        (~succeeded(lin.result), lin.result), (~definite, RESULTS.drive_diverges)
    )
    found = CushionModes(
        frequencies=values.imag,
        rotations=rigid[:, :n][:, lin.order.pulleys] * lin.model.turning[lin.order.pulleys],
        tensioner_motions=rigid[:, n:] * lin.model.movable,
        coordinates=eigen.vectors,
        rigid_shares=own / jnp.where(whole > 0, whole, 1.0),
        linearization=lin,
        result=result,
    )
    return frozen_where_failed(found, result)
