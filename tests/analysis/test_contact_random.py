"""Random drives in contact: solved to rounding, or shown to have no belt that touches them."""

from collections import Counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contact_drives import equal, random_armed, random_seven, state, unequal, variant

import beltjax as bj
from beltjax.numerics.roots import system_root
from beltjax.physics import contact, contact_search
from beltjax.physics.elastica import span_at, span_start
from beltjax.results import explanation

PLACED = ("successful", "gross_slip", "wrap_vanished", "belt_overstretched")
MISSING = ("contact_pressure_lost", "contact_not_found", "belt_too_stiff")
LEVELS = jnp.linspace(-12.0, 4.0, 400)
TURNS, FEW_LEVELS = jnp.linspace(-0.4, 0.4, 161), jnp.linspace(-6.0, 1.5, 150)


def random_two(count, rules=2, seed=0):
    """Two pulleys up to forty times apart in size, near and far, stiff and slack, slow and fast."""
    rng = np.random.default_rng([seed, 2])
    for k in range(count):
        radii = 10 ** rng.uniform(-2.3, -0.7, 2)
        d = radii.sum() + 10 ** rng.uniform(-2, 0.5) * radii.max()
        T, m0 = 10 ** rng.uniform(1.5, 3.3), 10 ** rng.uniform(-2.5, -0.5)
        stiff = rng.choice([rng.uniform(0, 0.9), 10 ** rng.uniform(-5, -0.05)])
        torque, c = T * radii[1] * rng.uniform(0, 2), np.sqrt(T / m0) * rng.uniform(0, 0.95)
        mass_flow = k % rules  # by turns the rules for the speed
        drive, point = equal(M2=torque) if mass_flow else unequal(M2=torque, c=c)
        new = [*radii, np.array([d, 0.0]), *rng.uniform(0.2, 1.5, 2)]
        places = [lambda d, k=k: d.pulleys[k].radius for k in (0, 1)]
        places += [lambda d: d.pulleys[1].center]
        places += [lambda d, k=k: d.pulleys[k].friction for k in (0, 1)]
        for place, value in zip(places, new, strict=True):
            drive = eqx.tree_at(place, drive, jnp.asarray(value, dtype=float))
        if mass_flow:
            drive, point = variant(drive, point, omega=c / radii[0], G=m0 * c)
        EI, EA = 2 * T * radii.min() ** 2 * stiff, T * 10 ** rng.uniform(1.3, 3.5)
        yield variant(drive, point, EI=EI, EA=EA, tension=T, m0=m0)


def name_of(found):
    text = explanation(found.result)
    names = {"": "successful"} | {bj.RESULTS[getattr(bj.RESULTS, n)]: n for n in PLACED + MISSING}
    return names[text]


@jax.jit
def residual(model, held, unknown):
    """What is left of the equations at the root that was returned."""
    zero, one, free = jnp.zeros(()), jnp.ones(()), jnp.zeros_like(unknown.q)
    task = contact_search.Task(
        zero, zero, zero, one[None], held, model.bodies.locked, free, jnp.zeros_like(model.K)
    )
    packed = contact_search._packed(unknown)
    return jnp.max(jnp.abs(contact_search._met(packed, (model, task))[0]))


def shapes(unknown, model):
    """Each span by itself, at the tension that is asked for."""

    def one(data):
        start, largest = span_start(data), jnp.array([1.5, 0.5])
        return system_root(lambda y: span_at(y, data)[1], start, largest).root

    return jax.vmap(one)(contact._span_data(unknown, 1 / model.rho, model)[0])


def unmet(model, held, level, turn):
    """Belt too long, and moment left on the arm, where level and arm are held."""
    zero, q = jnp.zeros(()), jnp.broadcast_to(turn, (len(model.K),))
    unknown = contact.Unknown(
        jnp.ones_like(model.rho), level[None], q, zero, jnp.zeros((len(model.rho), 2))
    )
    unknown = unknown._replace(shape=shapes(unknown, model))
    first = contact.joined(unknown, model)
    loop = contact.joined(unknown._replace(w=first.wrap), model)
    left = loop.push + held.relaxed - model.K @ q
    return (contact_search._lengths(loop, model) / held.L0 - 1)[0], jnp.sum(left)


@jax.jit
def surplus(model, held):
    """Belt too long for two locked pulleys, at each level of tension: their one true unknown."""
    return jax.lax.map(lambda level: unmet(model, held, level, jnp.zeros(()))[0], LEVELS)


@jax.jit
def surpluses(model, held):
    """`unmet` at each angle of the arm and each level of tension."""
    return jax.lax.map(
        lambda turn: jax.vmap(lambda level: unmet(model, held, level, turn))(FEW_LEVELS), TURNS
    )


def has_no_belt(found):
    """Whether the drive's belt is too long, or too short, at every level of tension."""
    shortage = np.asarray(surplus(found.model, found.solved.held))
    shortage = shortage[np.isfinite(shortage)]  # not so where the belt would be twice as long
    return bool(np.all(shortage > 0) or np.all(shortage < 0))


def has_no_balance(found):
    """Whether the belt, fitted at each angle of the arm, always turns it to the same side."""
    lengths, moments = map(np.asarray, surpluses(found.model, found.solved.held))
    left = []
    for length, moment in zip(lengths, moments, strict=True):
        fits = np.isfinite(length[:-1]) & np.isfinite(length[1:]) & (length[:-1] * length[1:] <= 0)
        for k in np.flatnonzero(fits):
            part = length[k] / (length[k] - length[k + 1])
            left.append(moment[k] + part * (moment[k + 1] - moment[k]))
    return bool(np.all(np.array(left) > 0) or np.all(np.array(left) < 0))


pytestmark = pytest.mark.slow

SIZES, COUNT = (3, 4, 5, 6, 7), 400
COUNTS = [(200, 1), pytest.param(2000, 2, marks=pytest.mark.timeout(900))]


@pytest.mark.parametrize(("count", "rules"), COUNTS)
def test_two_pulleys(count, rules):
    shares, unconfirmed = Counter(), []
    for k, (drive, point) in enumerate(random_two(count, rules)):
        found = state(drive, point)
        name = name_of(found)
        shares[name] += 1
        if name in PLACED:
            solved = found.solved
            assert residual(found.model, solved.held, solved.unknown) < 1e-10
        elif not has_no_belt(found):
            unconfirmed.append((k, name))
    print(dict(shares), unconfirmed)
    assert len(unconfirmed) <= 0.01 * count, unconfirmed


@pytest.mark.parametrize("n", [pytest.param(n, marks=pytest.mark.timeout(900)) for n in SIZES])
def test_pulleys_on_both_faces_with_an_arm(n):
    """A size's 400 drives, the seven-pulley ones in the structure that other tests compile."""
    shares, unconfirmed = Counter(), []
    for k, (drive, point) in enumerate(random_seven(COUNT) if n == 7 else random_armed(n, COUNT)):
        found = state(drive, point)
        name = name_of(found)
        shares[name] += 1
        assert np.all(np.isfinite(found.tensions))
        if name in PLACED:
            solved = found.solved
            assert residual(found.model, solved.held, solved.unknown) < 1e-10
        elif not has_no_balance(found):
            unconfirmed.append((k, name))
    print(dict(shares), unconfirmed)
    assert len(unconfirmed) <= 0.01 * COUNT, unconfirmed
