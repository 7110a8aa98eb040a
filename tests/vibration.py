"""What several tests of vibration share: the source's own model, and modes by SciPy."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from drives import at_groups, vibrating
from published import BETA, RADII, SPANS, printed, prototype

import beltjax as bj
from beltjax.physics import span
from beltjax.physics.steady import exact
from beltjax.physics.vibration import VibrationModel, assembled, elongations

MASS = 0.1029  # [kg/m], Table 3.2
INERTIAS = np.array([0.07248, 0.000293, 0.000293])  # [kg m^2], Table 4.1
ARM_INERTIA = 0.001165


def source_model(eps, s, beta=BETA) -> VibrationModel:
    """The source's prototype with its own rounded numbers; the belt runs against x."""
    steady = prototype(eps, s, beta=beta)
    found = exact(steady)
    mean = SPANS.mean()
    u, z = span.layer_width(steady.eps, steady.lam, found.Q)
    one, lam = jnp.ones(3), steady.lam
    ends = np.roll(np.eye(3), -1, axis=0) - np.eye(3)
    return VibrationModel(
        eps=steady.eps, s=s * one, tau=-one, gam=printed.STRETCH * one, mu=one,
        lam=lam, Q=found.Q, kap_s=steady.kap_s, kap_e=steady.kap_e, u=u, z=z,
        drop=steady.a @ found.q, a=steady.a, W0=steady.W0, pull=steady.S / lam[:, None],
        H=steady.H, K=steady.K, M=jnp.array([[ARM_INERTIA / (MASS * mean**3)]]),
        movable=steady.movable, turns=-ends * (RADII / mean) / lam[:, None],
        K_r=jnp.zeros((3, 3)), M_r=jnp.diag(INERTIAS / (MASS * mean**3)),
    )  # fmt: skip


def matrices(model, basis):
    rotors = jnp.arange(len(model.M_r))
    d = elongations(model, basis, rotors)
    return assembled(model, basis, d, rotors)


def held(whole, spans, driver=0):
    """NumPy copies of M, G, K with the driver's row and column taken out."""
    place = len(whole[0]) - 1 - spans + driver
    return [np.delete(np.delete(np.asarray(m), place, 0), place, 1) for m in whole]


def frequencies_at_rest(M, K):
    """All frequencies of K x = omega^2 M x by SciPy, the lowest to rounding.

    A fine basis has stiffnesses up to 1e9 times that of the lowest modes, of which rounding leaves
    eight digits. Scaled to a unit diagonal K is well conditioned, and the lowest modes are those of
    the largest flexibility.
    """
    unit = 1 / np.sqrt(np.diag(K))
    scaled = [matrix * unit[:, None] * unit for matrix in (M, K)]
    return 1 / np.sqrt(scipy.linalg.eigh(*scaled, eigvals_only=True)[::-1])


def companion_frequencies(M, G, K):
    """Positive imaginary parts of all eigenvalues by SciPy's general `eig`; the worst growth.

    They are found as the inverses of the eigenvalues of mu^2 K + mu G + M, for the reason given
    above, unless the drive has a rigid motion.
    """
    unit = 1 / np.sqrt(np.abs(np.diag(K)))
    M, G, K = (matrix * unit[:, None] * unit for matrix in (M, G, K))
    rigid = np.linalg.cond(K) > 1e12
    last, first = (M, K) if rigid else (K, M)
    lower = -np.linalg.solve(last, np.hstack([first, G]))
    size = len(M)
    A = np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), lower])
    values = scipy.linalg.eigvals(A) if rigid else 1 / scipy.linalg.eigvals(A)
    return np.sort(values.imag[values.imag > 1e-9]), values.real.max()


def source_frequencies(eps, s, basis):
    return companion_frequencies(*held(matrices(source_model(eps, s), basis), 3))


@functools.cache
def solver(basis, count, exact_route=False):
    """Steady state, linearization and modes in one compiled function."""

    @eqx.filter_jit
    def solve(drive, point):
        lin = bj.linearize(bj.steady_state(drive, point, throw=False), basis, throw=False)
        return bj.modes(lin, count, exact=exact_route, route="hermitian", throw=False)

    return solve


def linearized(name, eps, s, basis, **options):
    drive, point = at_groups(vibrating(name), eps, s)
    return bj.linearize(bj.steady_state(drive, point), basis, **options)
