"""Systems whose right side changes by events, and mechanical ones with set-valued elements.

An element acts with a reaction R on its own rate g = rows z' + what is given, in

    M z'' + force(z, z', t) + rows^T R = 0,      low <= R <= high

R is high while g > 0 and low while g < 0; where g = 0 it is what keeps g at 0, as long as the
bounds allow that. Dry friction has low = -high; a rigid one-way clutch has low = 0 and no other
bound. A spring before the slider makes the element compliant: R = k s + c s' between the bounds,
with its wind-up s' = g, and at a bound the slider gives way. A decoupler is that with low = 0.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.roots import solve_dense

Scalar = Float[Array, ""]
State = Float[Array, " states"]  # positions, their rates, then what else has a rate
Mode = Int[Array, " elements"]

ENGAGED, ABOVE, BELOW, ABSENT = 0, 1, -1, 2  # g = 0 or s' = g; R = high; R = low; R = 0
STILL = 1e-12  # rate below which an element may hold


class HybridSystem(NamedTuple):
    """A system of first order in time whose right side depends on a mode.

    A guard is positive while the mode lasts; where one falls through 0 the mode changes.
    """

    rate: Callable[[State, Scalar, Mode], State]
    guards: Callable[[State, Scalar, Mode], Float[Array, " guards"]]
    # State and mode after the guard of that number fell through 0.
    switched: Callable[[State, Scalar, Mode, Int[Array, ""]], tuple[State, Mode]]
    started: Callable[[State, Scalar], Mode]  # the mode in which a state begins
    # State and mode from which a motion goes on that was in this mode at a nearby state.
    resumed: Callable[[State, Scalar, Mode], tuple[State, Mode]]
    positions: int  # the first of the states; as many rates follow


class Elements(NamedTuple):
    """Set-valued elements of a mechanical system."""

    rows: Float[Array, "elements size"]
    driven: Callable[[Scalar], Float[Array, " elements"]]  # what a given motion adds to g, in time
    # Least and greatest R, which may be infinite, of z, z' and t.
    bounds: Callable[
        [Array, Array, Scalar], tuple[Float[Array, " elements"], Float[Array, " elements"]]
    ]
    present: Bool[Array, " elements"]
    stiffness: Float[Array, " elements"]  # k; 0 where rigid
    damping: Float[Array, " elements"]  # c
    # What a spring has beyond k s, by the wind-ups; 0 where the element may give way.
    beyond: Callable[[Float[Array, " elements"]], Float[Array, " elements"]]
    springs: int  # the last of the elements, which have a wind-up s


class _At(NamedTuple):
    """The elements at one moment."""

    free: Float[Array, " size"]  # z'' without reactions
    wanted: Float[Array, " elements"]  # g' without reactions
    g: Float[Array, " elements"]
    low: Float[Array, " elements"]
    high: Float[Array, " elements"]
    pull: Float[Array, " elements"]  # k s + c g
    s: Float[Array, " elements"]  # 0 of those without a wind-up


_FORGETS = 1e6  # rate at which a wind-up that is none vanishes


def mechanical_system(
    inverse_mass: Float[Array, "size size"],
    force: Callable[[Array, Array, Scalar], Float[Array, " size"]],
    elements: Elements,
) -> HybridSystem:
    """M z'' + force(z, z', t) + rows^T R = 0 with set-valued elements.

    States are (z, z', s). The guards are two of each element: of `ABOVE`, then of `BELOW`.
    """
    by_reaction = inverse_mass @ elements.rows.T
    of = _Mechanics(inverse_mass, force, elements, by_reaction, elements.rows @ by_reaction)
    return HybridSystem(of.rate, of.guards, of.switched, of.started, of.resumed, len(inverse_mass))


class _Mechanics(NamedTuple):
    """A mechanical system with set-valued elements."""

    inverse_mass: Float[Array, "size size"]
    force: Callable[[Array, Array, Scalar], Float[Array, " size"]]
    elements: Elements
    by_reaction: Float[Array, "size elements"]  # what each reaction takes from z''
    answers: Float[Array, "elements elements"]  # and from each g'

    @property
    def rigid(self) -> Bool[Array, " elements"]:
        return self.elements.stiffness == 0

    def parts(self, x: State) -> tuple[Array, Array, Array]:
        """z, z' and the wind-up of each element."""
        size, e = len(self.inverse_mass), self.elements
        none = jnp.zeros(len(e.rows) - e.springs)
        return x[:size], x[size : 2 * size], jnp.concatenate([none, x[2 * size :]])

    def solved(
        self, mode: Mode, held: Float[Array, " elements"], other: Float[Array, " elements"]
    ) -> Float[Array, " elements"]:
        """Reactions that take `held` from g' of the rigid elements that hold; of others `other`."""
        holds = (mode == ENGAGED) & self.rigid
        matrix = jnp.where(holds[:, None], self.answers, jnp.eye(len(mode)))
        return solve_dense(matrix, jnp.where(holds, held, other))

    def reactions(self, at: _At, mode: Mode) -> Float[Array, " elements"]:
        value = jnp.where(mode == ENGAGED, at.pull, 0.0)
        value = jnp.where(mode == ABOVE, at.high, jnp.where(mode == BELOW, at.low, value))
        return self.solved(mode, at.wanted, value)

    def at(self, x: State, t: Scalar) -> _At:
        e, (z, rate, s) = self.elements, self.parts(x)
        given, gaining = jax.jvp(e.driven, (t,), (jnp.ones_like(t),))
        free = -self.inverse_mass @ self.force(z, rate, t)
        g = e.rows @ rate + given
        low, high = e.bounds(z, rate, t)
        pull = e.stiffness * s + e.beyond(s) + e.damping * g
        return _At(free, e.rows @ free + gaining, g, low, high, pull, s)

    def winding(self, at: _At, mode: Mode) -> Float[Array, " elements"]:
        """The rate of each wind-up, as if all elements had one."""
        e = self.elements
        # At a bound the spring relaxes against its damper; without one it stays as it is.
        relaxes = ((mode == ABOVE) | (mode == BELOW)) & (e.damping > 0) & ~self.rigid
        limit = jnp.where(relaxes, jnp.where(mode == ABOVE, at.high, at.low), 0.0)
        relaxing = (limit - e.stiffness * at.s - e.beyond(at.s)) / jnp.where(
            relaxes, e.damping, 1.0
        )
        return jnp.where(mode == ENGAGED, at.g, jnp.where(relaxes, relaxing, 0.0))

    def rate(self, x: State, t: Scalar, mode: Mode) -> State:
        at, (_, rate, s) = self.at(x, t), self.parts(x)
        if not len(s):
            return jnp.concatenate([rate, at.free])
        gains = at.free - self.by_reaction @ self.reactions(at, mode)
        used = (mode != ABSENT) & ~self.rigid
        wound = jnp.where(used, self.winding(at, mode), -_FORGETS * s)
        return jnp.concatenate([rate, gains, wound[len(s) - self.elements.springs :]])

    def guards(self, x: State, t: Scalar, mode: Mode) -> Float[Array, " guards"]:
        if not len(mode):
            return jnp.ones(1)
        at = self.at(x, t)
        R = self.reactions(at, mode)
        slip = at.g - jnp.where(self.rigid, 0.0, self.winding(at, mode))
        above = jnp.where(jnp.isfinite(at.high), at.high - R, 1.0)
        below = jnp.where(jnp.isfinite(at.low), R - at.low, 1.0)
        first = jnp.where(mode == ABOVE, slip, jnp.where(mode == ENGAGED, above, 1.0))
        second = jnp.where(mode == BELOW, -slip, jnp.where(mode == ENGAGED, below, 1.0))
        return jnp.concatenate([first, second])

    def settled(self, x: State, t: Scalar, mode: Mode, still: Bool[Array, " elements"]) -> Mode:
        """The mode in which the rigid elements that are `still` go on, by principal pivoting.

        Their rates and reactions are the solution of one convex problem, so that changing the
        first that is wrong comes to an end (K. G. Murty, 1974).
        """
        at, count = self.at(x, t), len(mode)
        still = still & self.rigid & self.elements.present

        def judged(mode: Mode) -> Mode:
            found = self.reactions(at, mode)
            gains = at.wanted - self.answers @ found
            holds = mode == ENGAGED
            leaves = jnp.where(found > at.high, ABOVE, jnp.where(found < at.low, BELOW, ENGAGED))
            back = jnp.where(mode == ABOVE, gains < -STILL, gains > STILL)
            better = jnp.where(holds, leaves, jnp.where(back, ENGAGED, mode))
            return jnp.where(still, better, mode)

        def change(state: tuple[Mode, Array]) -> tuple[Mode, Array]:
            mode, turn = state
            better = judged(mode)
            first = jnp.arange(count) == jnp.argmax(better != mode)
            return jnp.where(first, better, mode), turn + 1

        def wrong(state: tuple[Mode, Array]) -> Bool[Array, ""]:
            mode, turn = state
            return jnp.any(judged(mode) != mode) & (turn < 4 * 2**count)

        begin = jnp.where(still, ENGAGED, mode), jnp.array(0)
        return jax.lax.while_loop(wrong, change, in_lanes_of(x, begin))[0]

    def held(self, x: State, t: Scalar, mode: Mode) -> State:
        """The state with g = 0 exactly where a rigid element holds, and wind-ups at their bound."""
        e, at, size = self.elements, self.at(x, t), len(self.inverse_mass)
        impulse = self.solved(mode, at.g, jnp.zeros(len(mode)))
        rate = x[size : 2 * size] - self.by_reaction @ impulse
        bound = ((mode == ABOVE) | (mode == BELOW)) & (e.damping == 0) & ~self.rigid
        limit = jnp.where(bound, jnp.where(mode == ABOVE, at.high, at.low), 0.0)
        s = jnp.where(bound, limit / jnp.where(self.rigid, 1.0, e.stiffness), at.s)
        return jnp.concatenate([x[:size], rate, s[len(mode) - e.springs :]])

    def switched(
        self, x: State, t: Scalar, mode: Mode, which: Int[Array, ""]
    ) -> tuple[State, Mode]:
        count = len(mode)
        if not count:
            return x, mode
        mine = jnp.arange(count) == which % count
        leaves = mine & (mode == ENGAGED)
        side = jnp.where(which < count, ABOVE, BELOW)
        mode = jnp.where(leaves, side, jnp.where(mine, ENGAGED, mode))
        mode = self.settled(x, t, mode, (mode == ENGAGED) & ~leaves)
        return self.held(x, t, mode), mode

    def started(self, x: State, t: Scalar) -> Mode:
        e = self.elements
        if not len(e.rows):
            return jnp.zeros(0, int)
        at = self.at(x, t)
        slips = jnp.where(at.g > STILL, ABOVE, jnp.where(at.g < -STILL, BELOW, ENGAGED))
        loose = (at.pull < at.low) | ((at.pull <= at.low) & (at.g < 0))
        pulled = jnp.where(loose, BELOW, jnp.where(at.pull > at.high, ABOVE, ENGAGED))
        mode = jnp.where(e.present, jnp.where(self.rigid, slips, pulled), ABSENT)
        return self.settled(x, t, mode, mode == ENGAGED)

    def resumed(self, x: State, t: Scalar, mode: Mode) -> tuple[State, Mode]:
        mode = jnp.where(mode == ENGAGED, mode, self.started(x, t))
        return (self.held(x, t, mode) if len(mode) else x), mode
