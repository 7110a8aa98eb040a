"""A thousand random drives with movable bodies: in balance by another route, or truly hopeless."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from random_bodies import Shape, build, random_bodies

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled
from beltjax.results import code, outcomes
from beltjax.validation.peers.bodies import Bending, Statics

COUNT = 84  # drives of each shape: 1008 in all
SHAPES = {
    "fixed centers": Shape((4,), 0, 0, "tension", False),
    "one body": Shape((3,), 1, 0, "tension", False),
    "one body, belt given": Shape((4,), 1, 0, "belt", True),
    "two bodies": Shape((5,), 2, 1, "tension", True, isolators=1),
    "two bodies, belt given": Shape((6,), 2, 1, "belt", False),
    "three bodies": Shape((7,), 3, 1, "tension", False),
    "three bodies, belt given": Shape((5,), 3, 1, "belt", True, isolators=1),
    "adjusted to a tension": Shape((6,), 2, 1, "to tension", True),
    "three, adjusted to a tension": Shape((5,), 3, 1, "to tension", False),
    "adjusted to a mark": Shape((4,), 2, 0, "to mark", False),
    "two belts": Shape((3, 4), 2, 1, "tension", True),
    "two belts, given": Shape((4, 3), 2, 0, "belt", False, shaft=1),
}
# A drive that rests by the second route, but is reported as a failure: the search for which of the
# stops of its three bodies hold does not end.
KNOWN = {"three bodies, belt given": {12}}
NAMES = {number: name for name, (number, _) in outcomes().items()}
VICINITY = 0.6  # of the drawn layout [rad] or [0.1 m], in which a drive is to be solved
JUMP = 0.1  # of a body, where a fortieth of the torques is added
NEAR = 1e-8  # of coordinates, and of forces over tensions


def solve(arrays, shape):
    """Gamma with its derivative by every number that is an argument, and the steady state."""

    def total(arrays):
        steady = bj.steady_state(*build(arrays, shape), throw=False)
        return jnp.sum(steady.coupling), steady

    return jax.value_and_grad(total, has_aux=True)(arrays)


class Plain(Statics):
    """One drive by the second route, which knows its shape."""

    def __init__(self, arrays, shape):
        super().__init__(arrays, shape.loops, shape.shaft)
        self.shape = shape


def resting_states(plain, lengths, free, taken):
    """States of rest near the drawn layout, found from many starts."""
    rng = np.random.default_rng(0)
    guesses = [rng.uniform(-0.3, 0.3, plain.k) * (start > 0) for start in range(12)]
    found = [plain.at_rest(lengths, free, taken, guess) for guess in guesses]
    return [state for state in found if state is not None]


def holds(plain, q, P):
    """Whether the exact stiffness at rest holds the bodies that no bolt and no stop holds."""
    moves = (plain.locked == 0) & ~np.any(at_ends(plain, q), axis=0)
    stiffness = plain.exact_stiffness(q, P)[np.ix_(moves, moves)]
    return not stiffness.size or np.linalg.eigvalsh(stiffness).min() > 0


def followed(plain, lengths, free, q):
    """Whether torques that rise from none take the bodies without a jump to a state that holds."""
    P = np.zeros(plain.n)
    for load in np.linspace(0, 1, 41)[1:]:
        found = plain.at_rest(lengths, free, load * plain.taken, q / plain.unit)
        if found is None or np.any(np.abs(found[0] - q) > JUMP * plain.unit):
            return False
        q, P = found
    near = np.all(np.abs(q) < VICINITY * plain.unit)
    return near and P.min() > 0 and plain.possible(q) and holds(plain, q, P)


def off(found, expected, relative):
    """Whether two positive numbers, or any of several, differ by more than this."""
    return np.any(np.abs(np.asarray(found) / np.asarray(expected) - 1) > relative)


def force_size(plain, tensions):
    return np.max(np.abs(tensions)) * plain.unit


def at_ends(plain, q):
    """Which bodies stand at their least and at their greatest coordinate."""
    free = plain.locked == 0
    return tuple(free & (np.abs(plain.stops[:, end] - q) < NEAR) for end in (0, 1))


def beyond(plain, q):
    free = plain.locked == 0
    return np.any(((q < plain.stops[:, 0] - NEAR) | (q > plain.stops[:, 1] + NEAR))[free])


def unbalanced(plain, q, force, size):
    """Whether a body is neither in balance nor pressed against a stop; a stop only pushes."""
    least, greatest = at_ends(plain, q)
    allowed = NEAR * size
    wrong = (force > allowed) & ~greatest | (force < -allowed) & ~least
    return np.any(wrong & (plain.locked == 0))


def rest_faults(plain, rest):
    """What a reference state gets wrong, by name."""
    q, P = rest.coordinates, rest.tensions
    size, force = force_size(plain, P), plain.forces(q, P, rest.free)
    held = rest.at_stop != 0
    bolted = plain.locked > 0
    return {
        "balance": unbalanced(plain, q, force, size),
        "reaction": np.any(np.abs(force + rest.stop_reactions)[held] > NEAR * size[held]),
        "sign": np.any((rest.stop_reactions * rest.at_stop)[held] > 0),
        "no stop there": np.any(held & ~np.any(at_ends(plain, q), axis=0)),
        "beyond a stop": beyond(plain, q),
        "bolted": np.any(np.abs(q - rest.installed)[bolted] > 1e-12),
        "torque": np.any(np.abs(plain.torques(q, P) - plain.taken) > 1e-9 * np.max(np.abs(P))),
        "length": off(plain.unstretched(q, P), rest.unstretched_lengths, 1e-10),
    }


def installation_faults(plain, rest):
    """What is not as the rule of installation says, by name."""
    a, rule, q = plain.numbers, plain.shape.rule, rest.installed
    P = plain.spread(rest.base_tensions)
    force, size = plain.forces(q, P, rest.free), force_size(plain, P)
    given, adjusted = ~np.isnan(a["free"]), a["adjusted"] * rule.startswith("to ") > 0
    faults = {
        "torque-free balance": unbalanced(plain, q, force, size),
        "installed beyond a stop": beyond(plain, q),
        "torque-free length": off(plain.unstretched(q, P), rest.unstretched_lengths, 1e-10),
        "free position": np.any(np.abs(rest.free - a["free"])[given] > 1e-12),
        "moved though bolted": np.any(np.abs(q)[(plain.locked > 0) & ~adjusted] > 1e-12),
    }
    if rule in ("tension", "to tension"):
        still = (plain.locked == 0) & ~plain.floats()
        faults["tension"] = off(rest.base_tensions, a["tension"], 1e-12)
        faults["not as drawn"] = np.any(np.abs(q[still]) > 1e-12)
    if rule != "tension":
        faults["given length"] = off(rest.unstretched_lengths, a["length"], 1e-10)
    if rule == "to mark":
        faults["mark"] = abs(q[1] - a["mark"]) > 1e-9
    return faults


def running(plain, steady):
    """The equations of the bending belts, where the string stands about which they are taken."""
    rest = steady.reference
    at = rest.coordinates + steady.coordinate_change - steady.deviation
    P = steady.groups.tensions * steady.scales.tension
    lengths, _, wraps, _ = plain.path(at)
    if not plain.shape.arcs:
        P0, give = P - plain.momentum, plain.sums(lengths)
        return at, P, Bending(plain, at, P0, plain.momentum, give, rest.stop_reactions)
    strain = P / plain.spread(plain.EA)
    flux = plain.momentum * (1 + strain)
    arcs = plain.radii * wraps / (1 + (strain + strain[plain.before]) / 2)
    give = plain.sums(lengths / (1 + strain) + arcs)
    carried = np.any(at_ends(plain, at), axis=0)
    rho = np.where(carried, -plain.forces(at, P - flux, rest.free), 0.0)
    return at, P, Bending(plain, at, P - flux, 0.0 * flux, give, rho)


def running_faults(plain, steady):
    """What a running state gets wrong, by name."""
    rest, q = steady.reference, steady.deviation
    at, P, bending = running(plain, steady)
    size, faults = force_size(plain, P), {}
    if plain.shape.arcs:
        force = plain.forces(at, P - plain.momentum * (1 + P / plain.spread(plain.EA)), rest.free)
        taken = plain.torques(at, P * (1 - plain.momentum / plain.spread(plain.EA)))
        faults = {
            "balance of the string": unbalanced(plain, at, force, size),
            "torque of the string": np.any(np.abs(taken - plain.taken) > 1e-9 * np.max(P)),
            "length of the string": off(plain.unstretched(at, P), rest.unstretched_lengths, 1e-10),
        }
    first = np.cumsum([0, *plain.shape.loops])[:-1]
    gained = steady.running_tensions - P
    T = gained[first]
    held, push = steady.at_stop != 0, bending.gradient(q, T)
    # The reaction of a stop that is only touched is 0, and rounding may say that none is.
    least, greatest = np.abs(q - bending.lo) < NEAR, np.abs(q - bending.hi) < NEAR
    allowed = 1e-7 * size
    wrong = (push < -allowed) & ~greatest | (push > allowed) & ~least
    inside = (q >= bending.lo - NEAR) & (q <= bending.hi + NEAR)
    return faults | {
        "one tension for each belt": np.any(np.abs(gained - plain.spread(T)) > 1e-9 * np.max(P)),
        "stationary": np.any(wrong & bending.free),
        "running reaction": np.any(np.abs(push - steady.stop_reactions)[held] > allowed[held]),
        "running sign": np.any((steady.stop_reactions * steady.at_stop)[held] > 0),
        "runs beyond a stop": np.any(bending.free & ~inside),
        "elongation": np.any(np.abs(bending.residual(q, T)) > 1e-9 * plain.sums(bending.lengths)),
        "coupling": off(steady.coupling, bending.gamma(T), 1e-8),
        "tight": np.min(bending.Q0 + plain.spread(T)) <= 0,
        "not held": not bending.holds(T),
    }


def hopeless_at_rest(plain, rest, name):
    """Whether a reference state has failed for the reason that it gives."""
    a, q, P = plain.numbers, rest.coordinates, rest.tensions
    if name in ("contact_lost", "no_tangent", "path_not_simple"):
        return not plain.possible(q) and not np.any(list(rest_faults(plain, rest).values()))
    if name == "span_slack":
        return np.min(P) <= 0 and not np.any(list(rest_faults(plain, rest).values()))
    if name == "tensioner_unstable":
        return not holds(plain, q, P)
    if plain.shape.rule.startswith("to "):
        return True  # what an adjusted body could reach is not searched for here
    if plain.shape.rule == "belt":
        lengths, free = a["length"], np.nan_to_num(a["free"])
        bare = resting_states(plain, lengths, free, 0 * plain.taken)
    else:
        if plain.floats().any() or np.any(a["rates"] > 0):
            return True
        lengths, free = plain.held_as_drawn()
        bare = [(np.zeros(plain.k), plain.spread(a["tension"]))]
    strain = [P / plain.spread(plain.EA) for _, P in bare]
    if name == "belt_too_long":
        return bool(bare) and min(s.min() for s in strain) <= 0
    if name == "belt_too_short":
        return bool(bare) and max(s.max() for s in strain) > 0.1
    if name == "belt_does_not_fit":
        return not any(
            followed(plain, lengths, free, q) for q, P in bare if plain.possible(q) and P.min() > 0
        )
    return False


def hopeless_running(plain, steady, name):
    """Whether a drive that rests has failed to run for the reason that it gives."""
    _, _, bending = running(plain, steady)
    rest = steady.reference
    if name == "tensioner_unstable":
        none = np.zeros(plain.k)
        at_rest = Bending(plain, rest.coordinates, rest.tensions, 0 * rest.tensions, 1.0, none)
        return not at_rest.holds(np.zeros(len(plain.EA)))
    if name == "span_slack" and len(plain.EA) == 1:
        floor = -np.min(bending.Q0) + 1e-6
        for T in np.array([floor])[:, None]:
            if not bending.holds(T):
                return True
            return bool(np.all(bending.residual(bending.settled(T), T) > 0))
    return name == "span_slack"


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("shape", SHAPES)
def test_random_bodies(shape):
    seed, known, shape = list(SHAPES).index(shape), KNOWN.get(shape, set()), SHAPES[shape]
    arrays = random_bodies(shape, COUNT, seed)
    program = quickly_compiled(jax.vmap(lambda arrays: solve(arrays, shape)))
    (coupling, steady), slopes = jax.device_get(program(arrays))
    good = np.asarray(steady.result == bj.RESULTS.successful)
    why, rested = (np.asarray(code(r)) for r in (steady.result, steady.reference.result))
    assert np.all(np.isfinite(coupling))
    for slope in jax.tree.leaves(slopes):
        assert np.all(np.isfinite(slope))
        assert np.all(slope[~good] == 0)
    wrong = []
    for i in range(COUNT):
        lane, one = jax.tree.map(lambda x, i=i: np.asarray(x)[i], (arrays, steady))
        plain, name = Plain(lane, shape), NAMES[int(why[i])]
        if good[i]:
            faults = rest_faults(plain, one.reference) | installation_faults(plain, one.reference)
            faults |= running_faults(plain, one)
            wrong += [(i, fault) for fault, there in faults.items() if there]
        elif rested[i] == why[i]:
            wrong += [(i, name)] * (not hopeless_at_rest(plain, one.reference, name))
        else:
            wrong += [(i, name)] * (not hopeless_running(plain, one, name))
    assert {i for i, _ in wrong} == known, wrong
    assert np.mean(good) > 0.6
