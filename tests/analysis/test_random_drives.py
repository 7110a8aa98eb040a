"""A thousand random drives of 3 to 8 pulleys: solved to rounding, or shown to be hopeless."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import build, random_drives
from scipy.optimize import brentq

import beltjax as bj
from beltjax.analysis.steady import steady_model
from beltjax.compiling.quick import quickly_compiled
from beltjax.physics.steady import belt_length_residual

COUNT = 167  # drives of each number of pulleys: 1002 in all
# All six sizes make the thousand; the largest runs every time.
SIZES = [*(pytest.param(n, marks=pytest.mark.slow) for n in (3, 4, 5, 6, 7)), 8]


def solved(arrays):
    """Gamma, the evidence, and the derivative with respect to every number that is an argument."""

    def total(arrays):
        steady = bj.steady_state(*build(*arrays), throw=False)
        model = steady_model(steady.groups)
        residual = belt_length_residual(steady.tension_change[None], model)
        return jnp.sum(steady.coupling), (steady, jax.lax.stop_gradient(residual))

    return jax.value_and_grad(total, has_aux=True)(arrays)


class Plain:
    """The string at rest in NumPy, written apart from the library: complex numbers, one drive."""

    def __init__(self, arrays):
        centers, radii, faces, carried, pivot, self.stiffness, self.P0, torques, rest = arrays
        self.z = centers[:, 0] + 1j * centers[:, 1]
        self.pivot = pivot[0] + 1j * pivot[1]
        self.signed, self.radii, self.EA = faces * radii, radii, rest["EA"]
        self.faces, self.j = faces, int(np.argmax(carried))
        rises = np.where(np.arange(len(radii)) == 0, 0.0, torques / radii)
        rises[0] = -rises.sum()
        offsets = np.cumsum(rises)
        self.offsets = offsets - offsets[self.j]
        lengths, arcs, moment = self.path(0.0)
        self.L0 = (lengths.sum() + arcs.sum()) / (1 + self.P0 / self.EA)
        self.wind_up = -self.P0 * moment.sum() / self.stiffness

    def path(self, turn):
        """Span lengths, arcs, and d(span length)/d(arm angle)."""
        z = self.z.copy()
        arm = (z[self.j] - self.pivot) * np.exp(1j * turn)
        z[self.j] = self.pivot + arm
        apart, rise = np.roll(z, -1) - z, np.roll(self.signed, -1) - self.signed
        lengths = np.sqrt(np.abs(apart) ** 2 - rise**2)
        e = apart * (lengths - 1j * rise) / np.abs(apart) ** 2
        wraps = self.faces * np.angle(e / np.roll(e, 1))
        wraps = np.where(wraps < -np.pi / 2, wraps + 2 * np.pi, wraps)
        if self.faces @ wraps < np.pi:  # a closed belt turns once: one of its own side has over 270
            wraps[np.argmin(np.where(self.faces > 0, wraps, np.inf))] += 2 * np.pi
        grows = np.zeros(len(z))
        grows[self.j - 1] += (np.conj(e[self.j - 1]) * 1j * arm).real
        grows[self.j] -= (np.conj(e[self.j]) * 1j * arm).real
        return lengths, self.radii * wraps, grows

    def level(self, turn):
        """Tensions that fit the belt on the path, and the moment that is then left on the arm."""
        lengths, arcs, grows = self.path(turn)

        def excess(level):
            P = level + self.offsets
            arc_P = (P + np.roll(P, 1)) / 2
            return (
                np.sum(lengths / (1 + P / self.EA)) + np.sum(arcs / (1 + arc_P / self.EA)) - self.L0
            )

        P = brentq(excess, -0.5 * self.EA, 2.0 * self.EA, xtol=1e-10) + self.offsets
        return P, P @ grows + self.stiffness * (self.wind_up + turn)

    def residuals(self, turn, P):
        """Moment on the arm over its spring's, and length over the path, at a given state."""
        lengths, arcs, grows = self.path(turn)
        arc_P = (P + np.roll(P, 1)) / 2
        length = np.sum(lengths / (1 + P / self.EA)) + np.sum(arcs / (1 + arc_P / self.EA))
        moment = P @ grows + self.stiffness * (self.wind_up + turn)
        return abs(moment) / (self.P0 * abs(self.z[self.j] - self.pivot)), abs(length / self.L0 - 1)

    def hopeless(self):
        """Whether no arm angle near the drawn one balances with all spans tight and wrapped."""
        turns = np.linspace(-0.6, 0.6, 1201)
        states = [self._state(turn) for turn in turns]
        for (a, one), (b, two) in zip(
            zip(turns, states, strict=True), zip(turns[1:], states[1:], strict=True), strict=False
        ):
            if one is None or two is None or one[1] * two[1] > 0:
                continue
            root = brentq(lambda turn: self.level(turn)[1], a, b)
            P, _ = self.level(root)
            if P.min() > 0 and self.path(root)[1].min() > 0:
                return False
        return True

    def _state(self, turn):
        with np.errstate(invalid="ignore"):
            lengths, _, _ = self.path(turn)
        return None if np.isnan(lengths).any() else self.level(turn)


@pytest.fixture(scope="module")
def compiled():
    return quickly_compiled(jax.vmap(solved))


@pytest.mark.parametrize("n", SIZES)
def test_random_drives(n, compiled):
    arrays = random_drives(n, COUNT)
    (coupling, (steady, residual)), slopes = jax.device_get(compiled(arrays))
    good = np.asarray(steady.result == bj.RESULTS.successful)

    assert np.all(np.isfinite(coupling))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))
    assert np.max(np.abs(residual[good])) < 1e-10
    assert np.all(coupling[good] > 0)
    assert np.all(steady.effective_tensions[good] > 0)

    host = jax.device_get(arrays)
    turns = steady.reference.layout.arm_angle
    for i in range(COUNT):
        plain = Plain(jax.tree.map(lambda x, i=i: x[i], host))
        if good[i]:
            drawn = np.angle(plain.z[plain.j] - plain.pivot)
            turn = np.angle(np.exp(1j * (turns[i] - drawn)))
            assert max(plain.residuals(turn, steady.reference.tensions[i])) < 1e-10
        else:
            rested = steady.reference.result != bj.RESULTS.successful
            assert np.asarray(rested)[i], "every drive that rests runs at these speeds"
            assert plain.hopeless()
            assert coupling[i] == 0.0
            assert all(np.all(leaf[i] == 0) for leaf in jax.tree.leaves(slopes))
    # Of 1002 drives at most 5 may fail; each size has its share.
    assert np.sum(~good) <= 1
