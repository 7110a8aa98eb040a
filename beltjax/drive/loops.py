"""Which pulleys and spans form the loop of each belt."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Loops:
    """Which pulleys and spans form each belt's loop, from the loops' sizes."""

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
        """What belongs to the next pulley or span of the same belt."""
        return self._rolled(values, -1)

    def preceding(self, values: Float[Array, "n *rest"]) -> Float[Array, "n *rest"]:
        """What belongs to the pulley or span before, of the same belt."""
        return self._rolled(values, 1)

    def sums(self, values: Float[Array, "n *rest"]) -> Float[Array, "belts *rest"]:
        """Sums over the pulleys or spans of each belt."""
        if len(self.sizes) == 1:
            return jnp.sum(values, axis=0)[None]
        return jnp.tensordot(jnp.asarray(self.of_belt), values, 1)

    def spread(self, values: Float[Array, " belts"]) -> Float[Array, " n"]:
        """To every pulley or span what belongs to its belt."""
        if len(self.sizes) == 1:
            return jnp.broadcast_to(values, (self.sizes[0],))
        return jnp.repeat(values, np.array(self.sizes), total_repeat_length=sum(self.sizes))
