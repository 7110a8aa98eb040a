"""Signs of the trends of Figs. 4.5-4.10, for the source's own numbers."""

import numpy as np
import scipy.linalg
from published import BETA, BETA_INEFFECTIVE
from vibration import held, matrices, source_frequencies, source_model

import beltjax as bj

BASIS = bj.Legendre(32)


def test_some_frequencies_fall_with_a_little_bending_stiffness():
    # Fig. 4.5: the moved steady state couples before bending stiffens.
    string, _ = source_frequencies(0.0, 0.0, BASIS)
    stiff, _ = source_frequencies(0.01, 0.0, BASIS)
    change = stiff[:6] - string[:6]
    assert change.min() < -1e-3
    assert change.max() > 1e-3


def test_speed_matters_less_to_a_stiff_belt():
    def spread(eps):
        rest, _ = source_frequencies(eps, 0.0, BASIS)
        fast, _ = source_frequencies(eps, 0.8, BASIS)
        return np.abs(fast[:4] / rest[:4] - 1).max()

    assert spread(0.1) < 0.8 * spread(0.01)


def rotational_frequency(beta):
    """Frequency of the string's mode in which pulleys and arm move most."""
    model = source_model(0.005, 0.0, beta=beta)
    M, _, K = held(matrices(model, BASIS), 3)
    squares, shapes = scipy.linalg.eigh(K, M)
    turning = slice(3 * BASIS.size, None)
    share = np.einsum("ak,ab,bk->k", shapes[turning], M[turning, turning], shapes[turning])
    return np.sqrt(squares[:8])[np.argmax(share[:8])]


def test_an_effective_tensioner_lifts_the_rotational_mode():
    # Fig. 4.10, eta = 0.785 against 0.
    assert rotational_frequency(BETA) > rotational_frequency(BETA_INEFFECTIVE) + 0.1
