"""The belts' lengths and the springs' relaxed positions, which an installation fixes."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.drive.assembly import Assembly
from beltjax.drive.groups import ways
from beltjax.drive.installation import (
    AdjustedToMark,
    AdjustedToTension,
    BeltGiven,
    Preloaded,
    TensionGiven,
)
from beltjax.drive.layout import Layout, Outline, Path, belt_path, unstretched_lengths
from beltjax.drive.preloaded import balancing_tensions
from beltjax.numerics.definite import definite_solve
from beltjax.numerics.rigid_bodies import Bodies, OutsideForces
from beltjax.numerics.roots import implicit_root, system_root

LARGEST_MOVE = 0.2  # of a body, in one Newton step [rad], or in mean span lengths


class Held(NamedTuple):
    """The belts, and the springs as forces on the bodies: `stiffness` @ q - `relaxed`."""

    lengths: Float[Array, " belts"]  # L0 [m]
    free: Float[Array, " springs"]  # where each spring is relaxed, from the drawn positions
    stiffness: Float[Array, "coordinates coordinates"]
    relaxed: Float[Array, " coordinates"]


class Installed(NamedTuple):
    """Where the bodies stand without torques, under given tensions."""

    coordinates: Float[Array, " coordinates"]
    tensions: Float[Array, " belts"]  # [N]
    held: Held
    converged: Bool[Array, ""]


def belt_pull(at: Layout | Path, tensions: Float[Array, " spans"]) -> Float[Array, " coordinates"]:
    """Force by which the belts resist the bodies: the sum of P_i S_i [N m] or [N]."""
    return jnp.sum(tensions[:, None] * at.span_pulls, axis=0)


def resistance(
    made: Assembly,
    at: Layout | Path,
    tensions: Float[Array, " spans"],
    coordinates: Float[Array, " coordinates"],
) -> Float[Array, " coordinates"]:
    """What the springs must hold: the belts' resistance less the outside forces [N m] or [N]."""
    return belt_pull(at, tensions) - made.outside.push(made.bodies, coordinates)


def search_units(of: Bodies, length: Float[Array, ""]) -> Float[Array, " coordinates"]:
    """Units of the coordinates in a search: 1 rad, or the mean span length."""
    return jax.lax.stop_gradient(jnp.where(of.rotary > 0, 1.0, length))


def held(made: Assembly, lengths: Float[Array, " belts"], free: Float[Array, " springs"]) -> Held:
    """The `Held` of belts with these lengths and springs relaxed at these positions."""
    of = made.springs
    relaxed = jnp.sum((of.stiffness * free)[:, None] * of.rows, axis=0)
    return Held(lengths, free, of.matrix, relaxed)


def held_by_tensions(
    made: Assembly,
    at: Layout | Path,
    tensions: Float[Array, " spans"],
    coordinates: Float[Array, " coordinates"],
) -> Held:
    """Belts and springs for which this layout, of these coordinates, is at rest."""
    free = _relaxed_by(made, resistance(made, at, tensions, coordinates), coordinates)
    return held(made, unstretched_lengths(made.EA, at, tensions, made.loops), free)


def _relaxed_by(
    made: Assembly, pull: Float[Array, " coordinates"], coordinates: Float[Array, " coordinates"]
) -> Float[Array, " springs"]:
    """Relaxed positions of springs that hold the bodies against this pull of the belts.

    Where there are more springs than the pull determines, those whose free position is given keep
    it.
    """
    of, locked = made.springs, made.bodies.locked
    if not len(locked):
        return jnp.zeros(0)
    given = getattr(made.rule, "free", None)
    known = jnp.zeros(len(of.stiffness)) if given is None else jnp.where(jnp.isnan(given), 0, 1)
    set_free = jnp.zeros_like(of.stiffness) if given is None else jnp.where(known > 0, given, 0.0)
    fixed = jax.lax.stop_gradient
    sought = fixed(jnp.where((of.stiffness > 0) & (known == 0), 1.0, 0.0))
    rates = jnp.where(of.stiffness > 0, of.stiffness, 1.0)
    stretch = jnp.sum(of.rows * coordinates, axis=1)
    carried = known * of.stiffness * (stretch - set_free)
    left = -pull - jnp.sum(carried[:, None] * of.rows, axis=0)
    # One of the bodies that float together is taken as the ground: the belts balance on them, or
    # the stop that one of them touches carries the rest.
    stopped = of.floating * _touching(made.bodies.stops, coordinates)
    earlier = jnp.tril(of.together, -1) @ stopped
    ground = jnp.where(of.together @ stopped > 0, stopped * (earlier == 0), of.first)
    square = jnp.einsum("s,sa,sb->ab", sought, of.rows, of.rows) + jnp.diag(ground)
    moves = definite_solve(square, left, 1.0 - locked).solution
    force = sought * jnp.sum(of.rows * moves, axis=1)
    return jnp.where(sought > 0, stretch - force / rates, set_free)


def _touching(
    stops: Float[Array, "coordinates 2"], coordinates: Float[Array, " coordinates"]
) -> Float[Array, " coordinates"]:
    """1 where a body stands at one of its stops, to rounding."""
    near = 1e-9 * (1.0 + jnp.abs(coordinates[:, None]))
    there = jnp.any(jnp.abs(stops - coordinates[:, None]) <= near, axis=1)
    return jnp.where(there, 1.0, 0.0)


def _balanced(
    of: Bodies,
    pull: Float[Array, " coordinates"],
    coordinates: Float[Array, " coordinates"],
    holding: Held,
    size: Float[Array, " coordinates"],
) -> Bool[Array, ""]:
    """Whether the springs hold every body that is neither locked nor at a stop against this pull.

    Where the positions of springs are given that the tensions determine, they may not.
    """
    push = pull + holding.stiffness @ coordinates - holding.relaxed
    carried = jnp.maximum(of.locked, _touching(of.stops, coordinates))
    return jnp.all((jnp.abs(push) <= 1e-7 * size) | (carried > 0))


def free_positions(made: Assembly, rule: BeltGiven | AdjustedToMark) -> Float[Array, " springs"]:
    """Positions at which the rule says that the springs are relaxed, from the drawn positions."""
    angle = getattr(rule, "free_angle", None)
    if angle is not None:
        # Whole turns are kept: a soft spring is wound by more than half a turn.
        return (angle - made.drawn.arm_angle)[None]
    if rule.free is None:
        return jnp.zeros(0)
    return jnp.where(jnp.isnan(rule.free), 0.0, rule.free)


def _installed_by_preloads(made: Assembly, rule: Preloaded) -> Installed:
    """The drawn state, whose tensions balance what is known of springs and outside forces."""
    found = balancing_tensions(made, rule)
    good = found.definite & jnp.all(found.solution > 0)
    tensions = jnp.where(good, found.solution, jax.lax.stop_gradient(made.EA) * 1e-3)
    of_span, still = made.loops.spread(tensions), made.still
    holding = held_by_tensions(made, made.drawn, of_span, still)
    size = of_span[0] * made.mean_length / search_units(made.bodies, made.mean_length)
    pull = resistance(made, made.drawn, of_span, still)
    good = good & _balanced(made.bodies, pull, still, holding, size)
    return Installed(still, tensions, holding, good)


def installed_by_tension(made: Assembly) -> Installed:
    """The torque-free state for given tensions, with floating and adjusted bodies in place.

    Sprung bodies stand as drawn. Those that no spring holds stand where the belts balance on them,
    or at the stop that they meet before. An adjusted body stands where the belt of the given length
    has its tension.
    """
    rule, loops, of, found, still = made.rule, made.loops, made.outline, made.springs, made.still
    if isinstance(rule, Preloaded):
        return _installed_by_preloads(made, rule)
    assert isinstance(rule, TensionGiven | AdjustedToTension)
    tensions = jnp.broadcast_to(rule.tension, (len(loops.sizes),))
    of_span, length, count = loops.spread(tensions), made.mean_length, len(still)
    units = search_units(of.bodies, length)

    def installed(
        at: Float[Array, " coordinates"], path: Layout | Path, good: Bool[Array, ""]
    ) -> Installed:
        holding = held_by_tensions(made, path, of_span, at)
        if rule.free is not None:
            size, pull = of_span[0] * length / units, resistance(made, path, of_span, at)
            good = good & _balanced(of.bodies, pull, at, holding, size)
        return Installed(at, tensions, holding, good)

    if not count or (isinstance(rule, TensionGiven) and rule.as_drawn):
        return installed(still, made.drawn, jnp.sum(found.floating) == 0)
    adjusted, wanted = still, jnp.zeros(len(loops.sizes))
    if isinstance(rule, AdjustedToTension):
        adjusted = jax.lax.stop_gradient(rule.adjusted)
        wanted = jnp.broadcast_to(rule.belt_length, wanted.shape)
    # The belts that the adjusted body moves.
    moved = jnp.minimum(loops.sums(of.bodies.carried @ adjusted), 1.0)

    def residual(
        unknown: Float[Array, " coordinates"],
        args: tuple[
            Outline,
            Float[Array, " belts"],
            Float[Array, " belts"],
            Float[Array, " spans"],
            OutsideForces,
        ],
    ) -> Float[Array, " coordinates"]:
        of, EA, wanted, of_span, outside = args
        at = unknown * units
        path = belt_path(of, loops, at)
        pull = belt_pull(path, of_span) - outside.push(of.bodies, at)
        pull = pull * units / (of_span[0] * length)
        # Bodies that float together move alike, until the first of them meets a stop.
        ends = ways(of.bodies.stops, still, units)
        least = jnp.max(jnp.where(found.together > 0, ends[:, 0], -jnp.inf), axis=1)
        greatest = jnp.min(jnp.where(found.together > 0, ends[:, 1], jnp.inf), axis=1)
        balance = unknown - jnp.clip(unknown - found.together @ pull, least, greatest)
        first_of = found.together.T @ (found.first * unknown)
        short = jnp.sum(moved * (unstretched_lengths(EA, path, of_span, loops) - wanted)) / length
        rest = jnp.where(found.first > 0, balance, unknown - found.floating * first_of)
        return jnp.where(adjusted > 0, short, rest)

    args = of, made.EA, wanted, of_span, made.outside
    fixed = jax.lax.stop_gradient(args)
    needed = jnp.any(found.floating + adjusted > 0)
    search = system_root(
        lambda x: residual(x, fixed), still, jnp.full(count, LARGEST_MOVE), wanted=needed
    )
    good = (search.converged & jnp.all(jnp.isfinite(search.root))) | ~needed
    root = jnp.where(needed & good, search.root, 0.0)
    # Where nothing floats the residual is not solved: it is held at the drawn position.
    safe = jax.tree.map(lambda x: jnp.where(needed & good, x, jax.lax.stop_gradient(x)), args)
    at = jnp.where(needed & good, implicit_root(residual, safe, root), 0.0) * units
    return installed(at, belt_path(of, loops, at), good)
