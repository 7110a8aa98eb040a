"""Spectra of signals over time: amplitudes by frequency in windows that slide along."""

from typing import NamedTuple

import numpy as np

_WINDOWS = 200
_PART = 20  # of the signal that a window takes
_FEWEST = 64  # values of a window
_PADDED = 4  # by which its spectrum is interpolated


class Spectrogram(NamedTuple):
    """Amplitudes over something that goes on with time, and over frequency."""

    at: np.ndarray
    hertz: np.ndarray
    amplitudes: np.ndarray  # [frequencies, at], zero to peak, in the signal's unit


def spectrogram(times: np.ndarray, values: np.ndarray, top: float) -> Spectrogram:
    """Amplitudes of a signal at even times, up to `top` [Hz], by the middles of Hann windows.

    The mean of each window is taken off. A harmonic of constant frequency and amplitude has that
    amplitude.
    """
    rate = (len(times) - 1) / (times[-1] - times[0])
    size = min(max(len(values) // _PART, _FEWEST), len(values))
    starts = np.unique(np.linspace(0, len(values) - size, _WINDOWS).astype(int))
    window = np.hanning(size)
    parts = values[starts[:, None] + np.arange(size)]
    parts = (parts - parts.mean(axis=1, keepdims=True)) * window
    count = _PADDED * size
    found = 2 * np.abs(np.fft.rfft(parts, count, axis=1)) / window.sum()
    hertz = np.fft.rfftfreq(count, 1 / rate)
    kept = hertz <= top
    middles = times[np.minimum(starts + size // 2, len(times) - 1)]
    return Spectrogram(middles, hertz[kept], found[:, kept].T)
