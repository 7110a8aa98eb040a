"""The string models that the source starts from, as limits EI = 0 of this one.

R. S. Beikmann et al. (1996) for the drive with a tensioner, S. E. Bechtel et al. (2000) and
M. D. Rubin (2000) for slip on two pulleys.
"""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import beltjax as bj
from beltjax.analysis.contact import ContactState
from beltjax.physics.string_contact import string_drive
from beltjax.validation.contact import HALF, SolvedDrives
from beltjax.validation.drives import prototype
from beltjax.validation.printed import steady as given
from beltjax.validation.spectra import Curves
from beltjax.validation.steady import sampled
from beltjax.validation.verdicts import Line, compared_formula

_SLOW = 1e-3  # s, at which T/s^2 differs from its limit by less than 1e-6
_SOLVED = 1e-9  # what iterations leave


def lines(over_eps: Curves, regular: SolvedDrives, largest: SolvedDrives) -> list[Line]:
    """The string's own formulas beside this model at EI = 0."""
    return [
        *_beikmann(over_eps),
        *_slip("Limit, Rubin", regular.states[0][0], maximum=False),
        *_slip("Limit, Bechtel", largest.states[0][HALF], maximum=True),
    ]


def _beikmann(over_eps: Curves) -> Iterator[Line]:
    item = "Limit, Beikmann"
    drive, _ = prototype()
    at = bj.layout(drive, throw=False)
    D, k_r = -jnp.sum(at.span_pulls) / at.arm_length, given.ARM_STIFFNESS
    P0 = given.TENSION
    gam = drive.belt.axial_stiffness / P0
    springs = jnp.sum(at.span_turns[:, 0] ** 2 / at.span_lengths) / at.arm_length**2
    springs = springs + k_r / (P0 * at.arm_length**2)
    eta = gam * D**2 / (gam * D**2 + jnp.sum(at.span_lengths) * springs)
    slow = sampled(s=_SLOW).T[0] / _SLOW**2
    text = "eta by (3.95), k_s/r_t for its k_s"
    yield compared_formula(item, "T/s^2, s = 0.001", text, float(eta), float(slow), 1e-6)
    lengths = np.asarray(at.span_lengths)
    for n in (1, 2, 3):
        wave = n * np.pi * lengths.mean() / lengths[2]
        nearest = over_eps.omega[0, np.argmin(np.abs(over_eps.omega[0] - wave))]
        name = f"omega of span 3, mode {n}, at rest"
        yield compared_formula(item, name, f"{n} pi l/l3", float(wave), float(nearest), _SOLVED)


def _slip(item: str, state: ContactState, maximum: bool) -> Iterator[Line]:
    """A string on straight spans, found by a search of its own for one unknown."""
    string = string_drive(state.model, jnp.ones(()), state.solved.loop.g, maximum)
    # Both drives list their pulleys, driver first, in the order of travel.
    force = float(state.scales.tension)
    radius = float(np.abs(state.model.rho[1]) * state.scales.length)
    for name, ours, theirs in (
        ("wrap of the driver (rad)", state.wraps[0], string.wrap[0]),
        ("slip of the driver (rad)", state.slips[0], string.slip[0]),
        ("M2/(R2 T_ini)", state.moments[1] / (radius * force), string.pull[1]),
    ):
        yield compared_formula(item, name, "the string alone", float(theirs), float(ours), _SOLVED)
