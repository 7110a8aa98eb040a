"""Spectra of signals that sweep through frequencies."""

import numpy as np
import pytest

from beltjax.draw.spectra import spectrogram


def test_a_sweep_has_its_amplitude_at_its_frequency():
    # 20 Hz to 120 Hz in 4 s, on a mean that drifts.
    t = np.linspace(0.0, 4.0, 8193)
    values = 3.0 * np.cos(2 * np.pi * (20 * t + 12.5 * t**2)) + 50 + 2 * t
    found = spectrogram(t, values, 200.0)
    assert found.amplitudes.shape == (len(found.hertz), len(found.at))
    assert found.hertz[-1] <= 200
    for k in range(0, len(found.at), 20):
        column = found.amplitudes[:, k]
        peak = np.argmax(column)
        assert found.hertz[peak] == pytest.approx(20 + 25 * found.at[k], abs=2.0)
        assert column[peak] == pytest.approx(3.0, rel=0.1)


def test_a_steady_tone_has_its_amplitude():
    t = np.linspace(0.0, 2.0, 4097)
    found = spectrogram(t, 0.7 * np.sin(2 * np.pi * 80 * t), 300.0)
    np.testing.assert_allclose(found.amplitudes.max(axis=0), 0.7, rtol=1e-3)
