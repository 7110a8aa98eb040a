"""Motion of finite amplitude against the drive's energy, which is kept."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import SLIDE, TWO_ARMS, load, swap
from drives import EXAMPLES, at_groups, example, vibrating
from numpy.polynomial import legendre

import beltjax as bj
from beltjax.analysis.motion import (
    layered_shapes,
    motion_model,
    narrowed,
    span_paths,
    widened,
)
from beltjax.compiling.quick import quickly_compiled
from beltjax.physics import motion, vibration
from beltjax.physics.vibration import Motion

NONE = bj.Damping(arm=False)
X, W = legendre.leggauss(80)
X, W = (X + 1) / 2, W / 2

MORE_BODIES = ("clockwise", "two arms", "slide")


@pytest.fixture(scope="module")
def linearized():
    drive, point = at_groups(vibrating("three_pulley"), 0.06, 0.5)
    curved = eqx.tree_at(lambda d: d.model.arm_curvature, drive, jnp.asarray(1.0))
    return bj.linearize(bj.steady_state(curved, point), bj.Legendre(4))


def state(lin, seed, size=0.02):
    return size * np.random.default_rng(seed).normal(size=len(lin.mass))


def test_energy_is_that_of_the_drive_by_quadrature(linearized):
    lin = linearized
    model, basis, steady = lin.model, lin.basis, lin.steady
    slope = jax.vmap(jax.grad(lambda x, i: steady.deflection(i, x)), (0, None))
    slopes = jnp.stack([slope(jnp.asarray(X), i) for i in range(lin.spans)])
    functions = [basis.values(jnp.asarray(X), order) for order in range(3)]
    weights = jnp.broadcast_to(jnp.asarray(W), slopes.shape)

    def moved(z):
        fields, rotations, q = lin.split(z)
        w, w_x, w_xx = (fields @ values.T for values in functions)
        start, slope = (model.W0 @ q)[:, None], (model.a @ q)[:, None]
        return Motion(w + start + slope * X, w_x + slope, w_xx, rotations, q)

    rest = moved(jnp.zeros(len(lin.mass)))
    z = jnp.asarray(state(lin, 0, 0.06))
    potential = -vibration.energy(moved(z), rest, slopes, weights, model)
    kinetic = vibration.energy(rest, moved(z), slopes, weights, model)
    whole = motion_model(lin, NONE)
    for expected, found in (
        (potential, motion.energy(whole, z, 0 * z)),
        (kinetic, motion.energy(whole, 0 * z, z)),
    ):
        assert found == pytest.approx(float(expected), rel=1e-12)
    # Far beyond the linear range.
    assert float(potential) > 1.5 * float(z @ lin.stiffness @ z) / 2


def test_force_is_the_gradient_of_the_energy(linearized):
    drive, point = at_groups(vibrating("three_pulley"), 0.06, 0.5)
    whole = motion_model(linearized, NONE, paths_of(drive, point)[0])
    z = jnp.asarray(state(linearized, 1))
    expected = jax.grad(lambda z: motion.energy(whole, z, 0 * z))(z)
    found = whole.stiffness @ z + motion.stretching(whole, z)
    np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())


def test_energy_is_kept_to_the_order_of_the_integrator(linearized):
    # Gauss's method of two stages: order 4, and of a quartic energy no more.
    whole = motion_model(linearized, NONE)
    size = len(whole.mass)
    A = np.array([[1 / 4, 1 / 4 - np.sqrt(3) / 6], [1 / 4 + np.sqrt(3) / 6, 1 / 4]])
    begin = jnp.zeros(2 * size).at[size - 2].set(0.1).at[size - 1].set(0.05)
    begin = begin.at[0].set(0.03)

    def rate(x):
        z, v = x[:size], x[size:]
        force = whole.damping @ v + whole.stiffness @ z + motion.stretching(whole, z)
        return jnp.concatenate([v, -jnp.linalg.solve(whole.mass, force)])

    def drift(steps):
        h = 2.0 / steps

        def step(x, _):
            def improve(_, k):
                residual = k - jax.vmap(rate)(x + h * A @ k)
                slope = jax.vmap(jax.jacfwd(rate))(x + h * A @ k)
                J = jnp.eye(4 * size) - h * jnp.einsum("ij,iab->iajb", A, slope).reshape(
                    4 * size, 4 * size
                )
                return k - jnp.linalg.solve(J, residual.ravel()).reshape(k.shape)

            k = jax.lax.fori_loop(0, 4, improve, jnp.stack([rate(x)] * 2))
            x = x + h / 2 * jnp.sum(k, axis=0)
            return x, motion.energy(whole, x[:size], x[size:])

        _, energies = jax.lax.scan(step, begin, jnp.arange(steps))
        first = motion.energy(whole, begin[:size], begin[size:])
        return jnp.max(jnp.abs(energies / first - 1))

    drifts = [float(quickly_compiled(drift)(steps)) for steps in (800, 1600)]
    assert drifts[1] < 1e-6
    assert drifts[0] / drifts[1] == pytest.approx(16, rel=0.15)
    # Beyond what the linear drive keeps.
    linear = float(begin[:size] @ whole.stiffness @ begin[:size]) / 2
    assert linear > 1.05 * float(motion.energy(whole, begin[:size], begin[size:]))


def test_layered_functions_are_orthonormal_and_hold_the_layers(linearized):
    lin = bj.linearize(linearized.steady, bj.Legendre(32))
    shapes = layered_shapes(lin, 12)
    products = jnp.einsum("inf,ing->ifg", shapes, shapes)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(12), products.shape), atol=1e-13)
    z = jnp.asarray(state(lin, 2))
    load = jnp.asarray(state(lin, 3))
    narrow = narrowed(shapes, z)
    assert float(narrowed(shapes, load) @ narrow) == pytest.approx(
        float(load @ widened(shapes, narrow)), rel=1e-12
    )
    # The strain's gradient, a pair of exponentials, is one of them.
    d = lin.elongations
    np.testing.assert_allclose(
        widened(shapes, narrowed(shapes, d)), d, atol=1e-12 * np.abs(d).max()
    )


def test_a_string_has_no_layers():
    drive, point = at_groups(vibrating("three_pulley"), 0.0, 0.5)
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(32))
    shapes = layered_shapes(lin, 12)
    expected = np.broadcast_to(np.eye(32)[:, :12], shapes.shape)
    np.testing.assert_allclose(
        np.abs(shapes @ shapes.transpose(0, 2, 1) @ expected), expected, atol=1e-13
    )


def paths_of(drive, point):
    curved = eqx.tree_at(lambda d: d.model.arm_curvature, drive, jnp.asarray(1.0))
    steady = bj.steady_state(curved, point)
    return span_paths(curved, steady), steady


@pytest.mark.parametrize(
    "case", ["three_pulley", *(pytest.param(x, marks=pytest.mark.slow) for x in MORE_BODIES)]
)
def test_exact_strain_of_the_bodies(tmp_path, case):
    texts = {"two arms": TWO_ARMS, "slide": SLIDE}
    drive, point = load(tmp_path, texts[case]) if case in texts else example("three_pulley")
    if case == "clockwise":
        text = (EXAMPLES / "three_pulley.toml").read_text()
        drive, point = load(tmp_path, mirrored(text))
    paths, steady = paths_of(drive, point)
    units, length = steady.groups.units, steady.scales.length
    q = 0.1 * jnp.linspace(0.7, 1.0, len(units))
    none = jnp.zeros(len(q))
    # The derivatives that are taken off are its own.
    first, second = (derived(paths.elongations)(none) for derived in (jax.jacfwd, jax.hessian))
    np.testing.assert_allclose(first, paths.first, atol=1e-13)
    np.testing.assert_allclose(second, paths.second, atol=1e-12)
    # All spans together gain what the path does.
    running = steady.reference.coordinates + steady.coordinate_change
    here, there = bj.layout(drive, running), bj.layout(drive, running + q * units)
    gained = float(jnp.sum(there.path_lengths - here.path_lengths) / length)
    assert float(jnp.sum(paths.elongations(q))) == pytest.approx(gained, abs=1e-14)
    far, near = paths.beyond(q), paths.beyond(q / 2)
    np.testing.assert_allclose(8 * near, far, atol=0.2 * np.abs(far).max())  # of third order


def mirrored(text):
    """A drive in a mirror: y upside down, the list and the arm's angle the other way round."""
    drive = text.replace('listed = "counterclockwise"', 'listed = "clockwise"')
    for old, new in (
        ("[0.5525, 0.0556]", "[0.5525, -0.0556]"),
        ("[0.3477, 0.05715]", "[0.3477, -0.05715]"),
        ("[0.2508, 0.0635]", "[0.2508, -0.0635]"),
    ):
        drive = swap(drive, old, new)
    return drive
