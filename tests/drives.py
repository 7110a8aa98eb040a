"""Drives that several tests share."""

from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.buildable import clearances
from beltjax.drive.numbers import named_numbers

EXAMPLES = Path(__file__).parents[1] / "examples"


def example(name):
    return bj.load_drive(EXAMPLES / f"{name}.toml")


def held_by_belt(drive, point):
    """The same drive, given by its belt and its spring instead of its tension."""
    state = bj.reference_state(drive, point)
    rule = bj.BeltGiven(state.unstretched_length, state.free_angle)
    return eqx.tree_at(lambda d: d.installation, drive, rule)


def build(centers, radii, faces, carried, pivot, stiffness, tension, torques, rest):
    """A drive and its operating point from arrays; all choices are data, so it may be batched."""
    n = len(radii)
    pulleys = [
        bj.Pulley(
            name=f"p{i}",
            center=centers[i],
            radius=radii[i],
            face=faces[i],
            driver=float(i == 0),
            on=carried[i][None],
        )
        for i in range(n)
    ]
    drive = bj.Drive(
        belt=bj.Belt(rest["EA"], rest["EI"], 0.1),
        pulleys=tuple(pulleys),
        installation=bj.TensionGiven(tension),
        tensioner=bj.Tensioner(pivot, stiffness),
    )
    torque = {f"p{i}": torques[i] for i in range(1, n)}
    return drive, bj.OperatingPoint(belt_speed=rest["speed"], torque=torque)


def random_arrays(rng, n, count):
    """Arguments of `build` for `count` random layouts of n pulleys, most of them impossible."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, (count, n)), axis=1)
    faces = np.where(rng.uniform(size=(count, n)) < 0.3, -1.0, 1.0)
    faces[:, 0] = 1.0
    reach = np.where(
        faces > 0, rng.uniform(0.15, 0.35, (count, n)), rng.uniform(0.02, 0.2, (count, n))
    )
    centers = reach[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    radii = rng.uniform(0.025, 0.08, (count, n))
    # The tensioner carries an idler with a real wrap, so that it has something to do.
    carried = np.eye(n)[rng.integers(1, n, count)]
    towards, arm = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.06, 0.12, count)
    pivot = np.einsum("bn,bnx->bx", carried, centers)
    pivot = pivot - arm[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
    tension = rng.uniform(250, 800, count)
    share = rng.dirichlet(np.ones(n), count) * (1 - carried)
    torques = share * radii * 0.25 * tension[:, None]
    rest = {
        "EA": rng.uniform(5e4, 2e5, count),
        "EI": 10 ** rng.uniform(-3.5, -1.3, count),
        "speed": rng.uniform(0.0, 40.0, count),
    }
    stiffness = rng.uniform(30, 150, count)
    return centers, radii, faces, carried, pivot, stiffness, tension, torques, rest


def _screen(arrays):
    drive, _ = build(*arrays)
    at = bj.layout(drive, throw=False)
    gaps = clearances(drive, at)
    parts = jnp.concatenate([gaps.rims, gaps.belt.ravel()])
    possible = (at.result == bj.RESULTS.successful) & jnp.all(parts > 0)
    return possible & ~_crossing(at) & (jnp.max(arrays[3] * at.wraps) > 0.2)


def _crossing(at):
    a, b = at.starts, at.ends

    def side(p, q, r):
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (
            r[..., 0] - p[..., 0]
        )

    p, q, r, s = a[:, None], b[:, None], a[None], b[None]
    return jnp.any((side(p, q, r) * side(p, q, s) < 0) & (side(r, s, p) * side(r, s, q) < 0))


def random_drives(n, count, seed=0):
    """`count` possible drives of n pulleys, as one batch of `build`'s arguments."""
    rng, kept, have = np.random.default_rng([seed, n]), [], 0
    screen = quickly_compiled(jax.vmap(_screen))
    while have < count:
        arrays = random_arrays(rng, n, 4096)
        good = np.asarray(screen(arrays))
        kept.append(jax.tree.map(lambda x, good=good: x[good], arrays))
        have += int(good.sum())
    return jax.tree.map(lambda *parts: jnp.asarray(np.concatenate(parts)[:count]), *kept)


def flat_numbers(drive, point):
    """Names of all scalar numbers, their values, and a function that puts new values back."""
    names, places = [], []
    for name, value in named_numbers(drive, point).items():
        for k in range(value.size):
            names.append(f"{name}[{k}]" if value.ndim else name)
            places.append((name, k))
    values = jnp.concatenate([jnp.ravel(v) for v in named_numbers(drive, point).values()])

    def put(new):
        parts, start = [], 0
        for value in named_numbers(drive, point).values():
            parts.append(new[start : start + value.size].reshape(value.shape))
            start += value.size
        return eqx.tree_at(
            lambda dp: list(named_numbers(*dp, (drive, point)).values()), (drive, point), parts
        )

    return names, values, put


class Slopes(NamedTuple):
    """Derivatives [answers, numbers] three ways, and each answer's largest in the steps taken."""

    forward: np.ndarray
    reverse: np.ndarray
    differences: np.ndarray
    size: np.ndarray


def three_ways(at, values, step):
    """Slopes of `at` by `values`; differences over five points, `step` relative (0.05 at least)."""
    forward = np.asarray(jax.jit(jax.jacfwd(at))(values))
    reverse = np.asarray(jax.jit(jax.jacrev(at))(values))
    h = step * np.maximum(np.abs(values), 0.05)
    offsets = np.concatenate([c * np.diag(h) for c in (-2, -1, 1, 2)])
    m2, m1, p1, p2 = np.split(np.asarray(jax.jit(jax.vmap(at))(values + offsets)), 4)
    # Five points: the error of the differences is of fourth order in the step.
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    size = np.max(np.abs(forward) * h, axis=1, keepdims=True) / h
    return Slopes(forward, reverse, differences, size)


def with_inertias(drive, pulley=3e-4, arm=1.2e-3):
    """The same drive with an inertia for every pulley and for the arm."""
    drive = eqx.tree_at(
        lambda d: [p.inertia for p in d.pulleys],
        drive,
        [jnp.asarray(pulley * (1 + i)) for i in range(len(drive.pulleys))],
        is_leaf=lambda leaf: leaf is None,
    )
    return eqx.tree_at(
        lambda d: d.tensioner.inertia, drive, jnp.asarray(arm), is_leaf=lambda leaf: leaf is None
    )


def four_pulleys():
    """A random drive of four pulleys that vibrates, and its operating point."""
    arrays = jax.tree.map(lambda x: x[0], random_drives(4, 1))
    drive, point = build(*arrays)
    return with_inertias(drive), point


def at_groups(drive, eps, s):
    """The drive with the bending stiffness of that eps, torque-free, running at that s."""
    length = jnp.mean(bj.layout(drive, throw=False).span_lengths)
    tension = drive.installation.tension
    stiffness = jnp.asarray(eps**2) * tension * length**2
    drive = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, stiffness)
    speed = s * jnp.sqrt(tension / drive.belt.mass_per_length)
    return drive, bj.OperatingPoint(belt_speed=speed)


def vibrating(name):
    """A drive of 3, 4 or 7 pulleys with inertias."""
    return four_pulleys()[0] if name == "four_pulley" else example(name)[0]
