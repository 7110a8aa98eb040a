"""Chapter 4, mode shapes on the layout, about the steady state: Figs. 4.2 to 4.4 and 4.10."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled
from beltjax.draw.layouts import draw_mode
from beltjax.validation.coupling import captions
from beltjax.validation.drives import WELL, middle_angle, prototype
from beltjax.validation.plates import Plate, dataset, panels
from beltjax.validation.printed import steady, vibration
from beltjax.validation.spectra import Curves
from beltjax.validation.verdicts import compared, shown

_ENLARGED = 2.0  # steady deflections in these pictures
_FIFTH = 4  # place of the mode of Fig. 4.10
_ORIENTATIONS = (steady.BETA_INEFFECTIVE, steady.BETA_HALF, steady.BETA)


def _found(eps: Any, angle: Any) -> list[bj.Modes]:
    """Modes of the prototype at rest, for numbers in a row."""
    batch = quickly_compiled(_modes)(jnp.asarray(eps), jnp.asarray(angle))
    return [jax.tree.map(lambda x, k=k: x[k], batch) for k in range(len(eps))]


def _modes(eps: Array, angle: Array) -> bj.Modes:
    def at(eps: Array, angle: Array) -> bj.Modes:
        found = bj.steady_state(*prototype(eps, angle=angle), throw=False)
        lin = bj.linearize(found, throw=False)
        return bj.modes(lin, 12, route="hermitian", throw=False)

    return eqx.filter_vmap(at)(eps, angle)


def plates(over_eps: Curves) -> Iterator[Plate]:
    """Modes that start as one of the string's, followed along eps; then the fifth over eta."""
    eps = (0.0, *vibration.STIFFNESSES, 0.1, 0.1, 0.1)
    angles = [WELL] * 5 + [middle_angle(beta) for beta in _ORIENTATIONS]
    string, *found = _found(eps, angles)
    for number, (name, caption) in vibration.STRING.items():
        start = _place(string, name)
        places = [_same(over_eps, start, *pair) for pair in
                  zip(vibration.STIFFNESSES, found, strict=False)]  # fmt: skip
        titles = [f"ε = {e:g}" for e in vibration.STIFFNESSES]
        shown_modes = list(zip(found[:4], places, titles, strict=True))
        item = f"Fig. {number}"
        limit = compared(item, f"omega at eps = 0, {name}", caption, string.dimensionless[start])
        yield _plate(number, shown_modes, [WELL] * 4, [limit])
    titles = [f"η = {steady.EFFECTIVENESS[beta].text}" for beta in _ORIENTATIONS]
    shown_modes = [(of, _FIFTH, title) for of, title in zip(found[4:], titles, strict=True)]
    yield _plate("4.10", shown_modes, angles[5:], list(captions("Fig. 4.10", *_ORIENTATIONS)))


def _place(string: bj.Modes, name: str) -> int:
    """The lowest of the string's modes of that name, spans counted from 1 as in the source."""
    label = name if name == "rotational" else f"span {int(name.split()[1]) - 1}"
    return string.labels.index(label)


def _same(over_eps: Curves, start: int, eps: float, of: bj.Modes) -> int:
    """The mode at eps that a followed mode has become."""
    omega = over_eps.omega[np.argmin(np.abs(over_eps.values - eps)), start]
    return int(np.argmin(np.abs(np.asarray(of.dimensionless) - omega)))


def _plate(number: str, chosen: list[tuple[bj.Modes, int, str]], angles: Any, lines: list) -> Plate:
    figure, axes = panels(len(chosen), 1, 6.4, 2.6)
    x = np.linspace(0.0, 1.0, 101)
    shapes, omega = [], []
    for panel, (of, k, title), angle in zip(axes, chosen, angles, strict=True):
        drive, point = prototype(angle=angle)
        draw_mode(panel, drive, float(point.travel), of, k, _ENLARGED)
        omega.append(float(of.dimensionless[k]))
        panel.set_title(f"{title}: ω = {omega[-1]:.4f}", fontsize=11)
        said = f"omega, {title}".replace("ε", "eps").replace("η", "eta")
        lines.append(shown(f"Fig. {number}", said, omega[-1]))
        shapes.append([np.asarray(of.deflection(k, i, jnp.asarray(x))) for i in range(3)])
    said = f"dashed: steady state, deflections times {_ENLARGED:g}; blue: mode about it"
    figure.supxlabel(said, fontsize=10)
    w = np.asarray(shapes, dtype=complex)
    axes_of = ("panel", "span", "x")
    turning = np.real([np.asarray(of.rotations[k]) for of, k, _ in chosen])
    arm = np.real([complex(of.arm_rotations[k]) for of, k, _ in chosen])
    data = dataset(
        "Mode shapes: amplitudes of a motion that stores 1 J; one phase, for the belt at rest",
        {"panel": ([title for _, _, title in chosen], ""), "span": ([1, 2, 3], ""), "x": (x, "1")},
        {"omega": ("panel", omega, "1"), "deflection": (axes_of, np.real(w), "m"),
         "deflection_in_quadrature": (axes_of, np.imag(w), "m"),
         "rotation": (("panel", "pulley"), turning, "rad"),
         "arm_rotation": ("panel", arm, "rad")},
    )  # fmt: skip
    return Plate(number, figure, data, tuple(lines))
