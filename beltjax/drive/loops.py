"""The loops of the belts: which pulleys and spans belong to each."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Loops:
    """The pulleys and spans that form each belt's loop, from the loops' sizes."""

    def __init__(self, sizes: tuple[int, ...]):
        self.sizes = sizes
        self.of_belt = np.repeat(np.eye(len(sizes)), sizes, axis=1)  # [belts, spans]
        self.starts = np.cumsum([0, *sizes[:-1]])

    def _rolled(self, values: Array, step: int) -> Array:
        if len(self.sizes) == 1:
            return jnp.roll(values, step, axis=0)
        parts = [
            jnp.roll(values[s : s + size], step, axis=0)
            for s, size in zip(self.starts, self.sizes, strict=True)
        ]
        return jnp.concatenate(parts)

    def following(self, values: Float[Array, "n *rest"]) -> Float[Array, "n *rest"]:
        """The values of the next pulley or span of the same belt."""
        return self._rolled(values, -1)

    def preceding(self, values: Float[Array, "n *rest"]) -> Float[Array, "n *rest"]:
        """The values of the pulley or span before, on the same belt."""
        return self._rolled(values, 1)

    def sums(self, values: Float[Array, "n *rest"]) -> Float[Array, "belts *rest"]:
        """Sums over the pulleys or spans of each belt."""
        if len(self.sizes) == 1:
            return jnp.sum(values, axis=0)[None]
        return jnp.tensordot(jnp.asarray(self.of_belt), values, 1)

    def spread(self, values: Float[Array, " belts"]) -> Float[Array, " n"]:
        """The value of its belt for every pulley or span."""
        if len(self.sizes) == 1:
            return jnp.broadcast_to(values, (self.sizes[0],))
        return jnp.repeat(values, np.array(self.sizes), total_repeat_length=sum(self.sizes))
