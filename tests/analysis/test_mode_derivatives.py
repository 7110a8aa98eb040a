"""Derivatives of frequencies and shapes: three ways, at repeated frequencies, through veering."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import at_groups, example, flat_numbers, held_by_belt, three_ways, vibrating

import beltjax as bj
from beltjax.analysis.sensitivity import sensitivities
from beltjax.drive.numbers import named_numbers

COUNT = 6
# A coarse basis has exact derivatives too; the exact route needs no fine one.
ROUTES = {"basis": (bj.Legendre(10), False), "exact": (bj.Sine(6), True)}


def frequencies(drive, point, basis, exact):
    lin = bj.linearize(bj.steady_state(drive, point, throw=False), basis, throw=False)
    return bj.modes(lin, COUNT, exact=exact, route="hermitian", throw=False).frequencies


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rule", "route"),
    [
        ("three_pulley", "tension", "basis"),
        pytest.param("three_pulley", "belt", "exact", marks=pytest.mark.slow),
        pytest.param("seven_pulley", "belt", "basis", marks=pytest.mark.slow),
        pytest.param("seven_pulley", "tension", "exact", marks=pytest.mark.slow),
    ],
)
def test_forward_reverse_and_differences_agree(name, rule, route):
    drive, point = example(name)
    if rule == "belt":
        drive = held_by_belt(drive, point)
    names, values, put = flat_numbers(drive, point)

    def at(numbers):
        return frequencies(*put(numbers), *ROUTES[route])

    # Relative to each answer's largest slope, in the steps that were taken.
    forward, reverse, differences, size = three_ways(at, values, 2e-5)
    assert np.all(np.isfinite(forward))
    assert np.max(np.abs(forward - reverse) / np.maximum(np.abs(forward), 1e-6 * size)) < 1e-9
    worst = np.abs(forward - differences) / np.maximum(np.abs(forward), 1e-2 * size)
    where = np.unravel_index(np.argmax(worst), worst.shape)
    assert worst.max() < 1e-6, f"d omega[{where[0]}]/d {names[where[1]]}"


@pytest.mark.slow
def test_the_two_routes_share_their_derivatives():
    drive, point = at_groups(vibrating("three_pulley"), 0.04, 0.5)
    fine = jax.jit(jax.jacrev(lambda d: frequencies(d, point, bj.Legendre(32), False)))(drive)
    exact = jax.jit(jax.jacrev(lambda d: frequencies(d, point, bj.Sine(6), True)))(drive)
    for a, b in zip(jax.tree.leaves(fine), jax.tree.leaves(exact), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8 * np.abs(a).max())


@pytest.mark.slow
def test_sensitivities_of_the_command_line_are_the_gradients():
    drive, point = example("three_pulley")
    basis = bj.Legendre(6)
    found = jax.jit(lambda d, p: sensitivities(d, p, 3, basis))(drive, point)

    def answers(numbers):
        steady = bj.steady_state(*numbers)
        modes = bj.modes(bj.linearize(steady, basis), 3)
        return jnp.append(modes.frequencies, steady.coupling.sum())

    of = drive, point
    direct = named_numbers(*jax.jit(jax.jacrev(answers))(of), of)
    of_modes, of_gamma = (named_numbers(*x, of) for x in (found.frequencies, found.coupling))
    for key, slopes in direct.items():
        np.testing.assert_allclose(of_modes[key], slopes[:3], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(of_gamma[key], slopes[3], rtol=1e-9, atol=1e-12)


def twin_spans():
    """Two equal pulleys, locked, at rest: the spans' even modes are uncoupled and repeat."""
    pulleys = [
        bj.Pulley("a", (0.0, 0.0), 0.05, inertia=1e-3, driver=1.0),
        bj.Pulley("b", (0.4, 0.0), 0.05, inertia=1e-3),
    ]
    belt = bj.Belt(1e5, 0.05, 0.1)
    drive = bj.Drive(belt, pulleys, bj.TensionGiven(300.0))
    return drive, bj.OperatingPoint(belt_speed=0.0)


@pytest.mark.parametrize("route", ["basis", pytest.param("exact", marks=pytest.mark.slow)])
def test_repeated_frequencies(route):
    drive, point = twin_spans()
    basis, exact = ROUTES[route]

    def at(mass, tension):
        changed = eqx.tree_at(
            lambda d: (d.belt.mass_per_length, d.installation.tension), drive, (mass, tension)
        )
        return frequencies(changed, point, basis, exact)

    base = drive.belt.mass_per_length, drive.installation.tension
    found = np.asarray(at(*base))
    gaps = np.diff(found) / found[1:]
    pair = int(np.argmin(gaps))
    assert gaps[pair] < 1e-9
    slopes = jax.jit(jax.jacfwd(at, argnums=(0, 1)))(*base)
    for k in range(2):
        h = 1e-5 * float(base[k])
        sides = [list(base), list(base)]
        sides[0][k], sides[1][k] = base[k] + h, base[k] - h
        differences = (np.asarray(at(*sides[0])) - np.asarray(at(*sides[1]))) / (2 * h)
        assert np.all(np.isfinite(slopes[k]))
        assert slopes[k][pair : pair + 2].sum() == pytest.approx(
            differences[pair : pair + 2].sum(), rel=1e-6
        )


def test_shapes_of_simple_modes():
    drive, point = at_groups(vibrating("three_pulley"), 0.04, 0.5)

    def shapes(radius):
        changed = eqx.tree_at(lambda d: d.pulleys[2].radius, drive, radius)
        lin = bj.linearize(
            bj.steady_state(changed, point, throw=False), bj.Legendre(8), throw=False
        )
        found = bj.modes(lin, 4, route="hermitian", throw=False)
        return jnp.concatenate([found.rotations, found.arm_rotations[:, None]], axis=1)

    radius, h = drive.pulleys[2].radius, 1e-6
    solve = jax.jit(shapes)
    slopes = jax.jit(jax.jacfwd(shapes))(radius)
    differences = (solve(radius + h) - solve(radius - h)) / (2 * h)
    np.testing.assert_allclose(slopes, differences, atol=1e-6 * np.abs(slopes).max())


@pytest.mark.slow
@pytest.mark.parametrize("route", ROUTES)
def test_second_derivatives_are_right_or_nan(route):
    drive, point = at_groups(vibrating("three_pulley"), 0.04, 0.5)
    basis, exact = ROUTES[route]

    def at(radius):
        changed = eqx.tree_at(lambda d: d.pulleys[2].radius, drive, radius)
        return frequencies(changed, point, basis, exact)

    radius, h = drive.pulleys[2].radius, 1e-5
    bent = jax.jit(jax.jacfwd(jax.jacrev(at)))(radius)
    if not exact:
        assert np.all(np.isnan(bent))
        return
    slope = jax.jit(jax.jacfwd(at))
    differences = (slope(radius + h) - slope(radius - h)) / (2 * h)
    np.testing.assert_allclose(bent, differences, rtol=0, atol=1e-5 * np.abs(bent).max())


@pytest.mark.slow
def test_damped_modes():
    drive, point = at_groups(vibrating("three_pulley"), 0.04, 0.5)
    damping = bj.Damping(modal=0.02, stiffness=1e-5)

    def at(stiffness):
        changed = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, stiffness)
        changed = eqx.tree_at(
            lambda d: d.tensioner.damping, changed, jnp.asarray(0.3), is_leaf=lambda x: x is None
        )
        lin = bj.linearize(
            bj.steady_state(changed, point, throw=False), bj.Legendre(6), throw=False
        )
        found = bj.modes(lin, 3, damping=damping, throw=False)
        return jnp.concatenate([found.frequencies, found.growth_rates])

    stiffness, h = drive.tensioner.stiffness, 1e-2
    forward, reverse = jax.jit(jax.jacfwd(at))(stiffness), jax.jit(jax.jacrev(at))(stiffness)
    solve = jax.jit(at)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    differences = (solve(stiffness + h) - solve(stiffness - h)) / (2 * h)
    np.testing.assert_allclose(forward, differences, rtol=1e-6, atol=1e-7)


@pytest.mark.slow
def test_a_bad_lane_leaves_its_neighbors_alone():
    drive, _ = example("three_pulley")

    def at(speed):
        point = bj.OperatingPoint(belt_speed=speed)
        lin = bj.linearize(bj.steady_state(drive, point, throw=False), bj.Sine(6), throw=False)
        found = bj.modes(lin, COUNT, exact=True, route="hermitian", throw=False)
        return found.frequencies.sum(), found.result

    speeds = jnp.array([10.0, 500.0, jnp.nan, 20.0])
    slopes, results = jax.jit(jax.vmap(jax.grad(at, has_aux=True)))(speeds)
    good = np.asarray(results == bj.RESULTS.successful)
    np.testing.assert_array_equal(good, [True, False, False, True])
    np.testing.assert_array_equal(slopes[1:3], 0.0)
    alone = jax.jit(jax.grad(lambda s: at(s)[0]))
    np.testing.assert_allclose(slopes[0], alone(speeds[0]), rtol=1e-9)
    np.testing.assert_allclose(slopes[3], alone(speeds[3]), rtol=1e-9)


def test_fixed_parts_of_the_steady_state():
    # Fig. 4.6's parts: both changes of a small step in eps add up to the whole.
    drive, point = at_groups(vibrating("three_pulley"), 0.02, 0.3)
    stiffer, _ = at_groups(drive, 0.0201, 0.3)
    before, after = bj.steady_state(drive, point), bj.steady_state(stiffer, point)
    basis = bj.Legendre(24)

    def of(lin):
        return np.asarray(bj.modes(lin, COUNT).dimensionless)

    base = of(bj.linearize(before, basis))
    whole = of(bj.linearize(after, basis)) - base
    bending = of(bj.linearize(after, basis, fixed_steady=before)) - base
    moved = of(bj.linearize(after, basis, fixed_bending=before.groups.bending)) - base
    np.testing.assert_allclose(bending + moved, whole, atol=2e-2 * np.abs(whole).max())
    # With the steady state fixed all frequencies rise; with only it moved some fall.
    assert np.all(bending > 0)
    assert np.any(moved < 0)
    with pytest.raises(ValueError, match="exact: applies to undamped modes of one steady state"):
        bj.modes(bj.linearize(after, basis, fixed_steady=before), COUNT, exact=True)
