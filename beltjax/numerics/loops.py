"""Closed loops listed one after another: neighbors, sums and values of each."""

import dataclasses
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Loops:
    """The places in a list that form each loop, from the loops' sizes."""

    sizes: tuple[int, ...]

    @cached_property
    def members(self) -> Float[np.ndarray, "loops n"]:
        """1 where the place belongs to the loop."""
        return np.repeat(np.eye(len(self.sizes)), self.sizes, axis=1)

    @cached_property
    def starts(self) -> Int[np.ndarray, " loops"]:
        """First place of each loop."""
        return np.cumsum([0, *self.sizes[:-1]])

    @cached_property
    def counts(self) -> Float[np.ndarray, " loops"]:
        """Number of places of each loop."""
        return np.array(self.sizes, float)

    @cached_property
    def loop_of(self) -> Int[np.ndarray, " n"]:
        """Number of the loop of each place."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    def _parts(self, values: Array) -> list[Array]:
        ends = zip(self.starts, self.sizes, strict=True)
        return [values[start : start + size] for start, size in ends]

    def _rolled(self, values: Array, step: int) -> Array:
        if len(self.sizes) == 1:
            return jnp.roll(values, step, axis=0)
        parts = [jnp.roll(part, step, axis=0) for part in self._parts(values)]
        return jnp.concatenate(parts)

    def following(self, values: Float[Array, "n *rest"]) -> Float[Array, "n *rest"]:
        """The value of the next place of the same loop."""
        return self._rolled(values, -1)

    def preceding(self, values: Float[Array, "n *rest"]) -> Float[Array, "n *rest"]:
        """The value of the place before, in the same loop."""
        return self._rolled(values, 1)

    def sums(self, values: Float[Array, "n *rest"]) -> Float[Array, "loops *rest"]:
        """The sum over each loop."""
        if len(self.sizes) == 1:
            return jnp.sum(values, axis=0)[None]
        return jnp.tensordot(jnp.asarray(self.members), values, 1)

    def means(self, values: Float[Array, " n"]) -> Float[Array, " loops"]:
        """The mean over each loop."""
        return self.sums(values) / self.counts

    def largest(self, values: Float[Array, " n"]) -> Float[Array, " loops"]:
        """The largest value of each loop."""
        return jnp.stack([jnp.max(part) for part in self._parts(values)])

    def at_smallest(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """1 at the place of each loop's smallest value, 0 elsewhere."""
        parts = [jnp.arange(len(part)) == jnp.argmin(part) for part in self._parts(values)]
        return jnp.concatenate(parts).astype(float)

    def spread(self, values: Float[Array, " loops"]) -> Float[Array, " n"]:
        """The value of its loop for every place."""
        if len(self.sizes) == 1:
            return jnp.broadcast_to(values, (self.sizes[0],))
        return jnp.repeat(values, np.array(self.sizes), total_repeat_length=sum(self.sizes))

    def crossed(self, sides: Float[Array, " n"]) -> Float[Array, " loops"]:
        """1 for a loop of two pulleys on different sides of the belt, which crosses between them.

        `sides` are +1 or -1 for each pulley.
        """
        if 2 not in self.sizes:
            return jnp.zeros(len(self.sizes))
        two = np.array(self.sizes) == 2
        return jnp.where(two & (self.sums(sides) == 0), 1.0, 0.0)
