"""Moving beams that several tests share, solved in one batch for each pair of supports."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import beltjax as bj

COUNT = 10
SPEEDS = (0.0, 0.3, 0.6, 0.9, 0.95)  # the first four are those of Fig. 2.3
BENDINGS = (1e-4, 0.01, 0.05, 0.12, 0.2)
GRID = [(eps, v) for eps in BENDINGS for v in SPEEDS]
SMALL = (0.001, 0.002)
SERIES = [(eps, v) for eps in SMALL for v in (0.0, 0.6)]  # for orders of the error
LIMITS = [
    (0.03, 0.3),
    (0.0, 0.0),
    (0.0, 0.6),
    (0.0, -0.6),
    (1e-9, 0.6),
    (1e3, 0.0),
    (0.05, -0.6),
    (0.05, 0.6),
]
# Squared wavenumber of buckling under compression, first roots of sin b = 0 and tan b = b.
BUCKLING = {0: np.pi**2, 1: 4.493409457909064**2, 2: 4 * np.pi**2}
SHARES = (0.0, 0.5, 0.99)  # of the way from the string's critical speed to the beam's


def speed_between(eps, share, ends):
    return float(np.sqrt(1 + share * BUCKLING[ends.count("fixed")] * eps**2))


def fast(ends):
    return [(eps, speed_between(eps, share, ends)) for eps in (0.03, 0.2) for share in SHARES]


@functools.cache
def solved(ends):
    """Modes of all beams above, by (bending, speed)."""
    beams = [*GRID, *SERIES, *LIMITS, *fast(ends)]
    eps, v = (jnp.array(numbers) for numbers in zip(*beams, strict=True))
    modes = jax.jit(
        jax.vmap(lambda eps, v: bj.moving_beam_modes(eps, v, ends, COUNT, throw=False))
    )(eps, v)
    assert np.all(modes.result == bj.RESULTS.successful)
    return {beam: jax.tree.map(lambda x, k=k: x[k], modes) for k, beam in enumerate(beams)}
