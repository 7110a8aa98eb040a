"""What several tests of vibration share: the source's own model, and modes by SciPy."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from drives import at_groups, vibrating
from published import ARM, BETA, RADII, SPANS, prototype

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
    mean, (beta_in, beta_out) = SPANS.mean(), np.radians(beta)
    u, z = span.layer_width(steady.eps, steady.lam, found.Q)
    arm_strain = ARM / SPANS * np.array([-np.sin(beta_in), np.sin(beta_out), 0.0])
    return VibrationModel(
        eps=steady.eps, s=steady.s, tau=jnp.array(-1.0), gam=steady.gam, k_s=steady.k_s,
        lam=steady.lam, rho=steady.rho, Q=found.Q, kap_s=steady.kap_s, kap_e=steady.kap_e,
        u=u, z=z, drop=steady.a * found.th, a=steady.a, w_start=steady.w_start,
        pull=jnp.asarray(arm_strain), r=jnp.asarray(RADII / mean),
        J=jnp.asarray(INERTIAS / (MASS * ARM * mean**2)),
        J_t=jnp.asarray(ARM_INERTIA / (MASS * ARM * mean**2)),
    )  # fmt: skip


def matrices(model, basis):
    pulleys = jnp.arange(len(model.r))
    d = elongations(model, basis, pulleys, arm=True)
    return assembled(model, basis, d, pulleys, arm=True)


def held(whole, spans, driver=0):
    """NumPy copies of M, G, K with the driver's row and column taken out."""
    place = len(whole[0]) - 1 - spans + driver
    return [np.delete(np.delete(np.asarray(m), place, 0), place, 1) for m in whole]


def companion_frequencies(M, G, K):
    """Positive imaginary parts of all eigenvalues by SciPy's general `eig`; the worst growth."""
    size = len(M)
    lower = -np.linalg.solve(M, np.hstack([K, G]))
    A = np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), lower])
    values = scipy.linalg.eigvals(A)
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
