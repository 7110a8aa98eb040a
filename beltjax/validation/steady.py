"""Steady states of the prototype over any of its dimensionless numbers, in batches of one shape."""

import inspect
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import beltjax as bj
from beltjax.compiling.quick import in_chunks, quickly_compiled
from beltjax.validation.drives import as_printed, prototype
from beltjax.validation.printed import steady as printed

X = np.linspace(0.0, 1.0, 201)
_CHUNK = 32
# All of them are always given, so that every figure shares one compiled program.
_USUAL = {name: given.default for name, given in inspect.signature(prototype).parameters.items()}


class Sampled(NamedTuple):
    """Steady states along the first axis; nan where a span has gone slack."""

    T: Float[Any, " points"]
    th: Float[Any, " points"]
    coupling: Float[Any, "points spans"]
    deflections: Float[Any, "points spans x"]  # of the spans' own lengths, at X
    effectiveness: Float[Any, " points"]


def sampled(method: Any = None, **numbers: Any) -> Sampled:
    """Steady states of the prototype, batched over those of its numbers that are arrays.

    `P` is one triple, or one for each point.
    """
    full = {name: np.asarray(value, dtype=float) for name, value in {**_USUAL, **numbers}.items()}
    count = max(value.shape[0] if value.ndim > (name == "P") else 1 for name, value in full.items())
    full = {
        name: np.broadcast_to(value, (count, 3) if name == "P" else (count,))
        for name, value in full.items()
    }
    method = bj.Exact() if method is None else method

    def run(places: np.ndarray) -> Sampled:
        rows = {name: jnp.asarray(value[places]) for name, value in full.items()}
        return quickly_compiled(_solutions)(method, rows)

    return in_chunks(run, np.arange(count), _CHUNK, lambda done, total: None)


def _solutions(method: Any, rows: dict[str, Array]) -> Sampled:
    def at(row: dict[str, Array]) -> Sampled:
        steady = bj.steady_state(*prototype(**row), method, throw=False)
        good = steady.result == bj.RESULTS.successful
        w = jnp.stack([steady.deflection(i, jnp.asarray(X)) for i in range(3)])
        found = (steady.tension_change, steady.arm_rotation, steady.coupling, w)
        T, th, coupling, w = (jnp.where(good, x, jnp.nan) for x in found)
        return Sampled(T, th, coupling, w, steady.effectiveness)

    return eqx.filter_vmap(at)(rows)


def loaded_tensions(torques: np.ndarray) -> Float[np.ndarray, "points spans"]:
    """P_i/P0 at rest under these torques of the driver [N m]: belt and arm's spring held."""
    drive, _ = prototype()
    rule = bj.TensionGiven(printed.TENSION)
    drive = eqx.tree_at(lambda d: d.installation, drive, rule)
    ratio = printed.RADII[2] / printed.RADII[0]

    def tensions(torque: Array) -> Array:
        point = bj.OperatingPoint(belt_speed=0.0, torque={"accessory": ratio * torque})
        return bj.reference_state(drive, point).tensions / printed.TENSION

    return np.asarray(eqx.filter_jit(eqx.filter_vmap(tensions))(jnp.asarray(torques)))


def table_lengths() -> tuple[np.ndarray, np.ndarray]:
    """Span lengths [m] and alignment angles [deg] that follow from the centers of Table 3.2."""
    drive = as_printed()
    at = bj.layout(drive, throw=False)
    angles = bj.alignment_angles(drive, at)[0]
    return np.asarray(at.span_lengths), np.degrees(np.asarray(angles))
