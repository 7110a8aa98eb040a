"""Chapter 3, the coupling indicator and the tension: Figs. 3.8 to 3.11."""

from collections.abc import Iterator
from typing import Any

import numpy as np

import beltjax as bj
from beltjax.validation.drives import WELL, middle_angle
from beltjax.validation.plates import COLORS, Plate, dataset, named, panels, surfaces
from beltjax.validation.printed import steady as printed
from beltjax.validation.steady import loaded_tensions, sampled
from beltjax.validation.verdicts import Line, compared, shown

_GAMMA = "coupling indicator, Γ"
ORIENTATIONS = {"well": (printed.BETA, WELL), "poor": (
    printed.BETA_INEFFECTIVE, middle_angle(printed.BETA_INEFFECTIVE))}  # fmt: skip


def captions(item: str, *orientations: tuple[float, float]) -> Iterator[Line]:
    """The effectiveness that a caption prints beside alignment angles."""
    for beta in orientations:
        found = sampled(angle=middle_angle(beta)).effectiveness[0]
        name = f"eta, beta = {beta[0]}, {beta[1]} deg"
        yield compared(item, name, printed.EFFECTIVENESS[beta], found)


def plates() -> Iterator[Plate]:
    """Figs. 3.8 to 3.11."""
    eps = np.linspace(0.001, 0.05, 64)
    yield _curves("3.8", "bending stiffness, ε", "eps", eps, {"": {"eps": eps}}, (0, 15))
    P = loaded_tensions(np.linspace(0.0, printed.LARGEST_TORQUE, 32))
    yield _curves("3.9", "P₃ (while P₁ falls)", "P3", P[:, 2], {"": {"eps": 0.015, "P": P}},
                  (3.4, 4.2))  # fmt: skip
    s = np.linspace(0.0, 0.8, 32)
    curves = {
        f"η = {printed.EFFECTIVENESS[beta].text}": {"eps": 0.015, "s": s, "angle": angle}
        for beta, angle in ORIENTATIONS.values()
    }
    both = (printed.BETA, printed.BETA_INEFFECTIVE)
    plate = _curves("3.10", "speed, s", "s", s, curves, (3.5, 7.5))
    yield plate._replace(lines=(*captions("Fig. 3.10", *both), *plate.lines))
    yield _figure_3_11()


def _curves(
    number: str,
    over: str,
    key: str,
    x: np.ndarray,
    curves: dict[str, dict[str, Any]],
    limits: tuple[float, float],
) -> Plate:
    """Gamma by (3.92) and exactly, over one number."""
    figure, (axes,) = panels(1, 1, 7.2, 5.0)
    lines, kept = [], {}
    for (name, numbers), color in zip(curves.items(), COLORS, strict=False):
        routes = (("exact", bj.Exact(), "-"), ("perturbation", bj.Perturbation(), "--"))
        for route, method, style in routes:
            total = sampled(method, **numbers).coupling.sum(axis=1)
            label = f"{route}, {name}" if name else route
            axes.plot(x, total, style, color=color if style == "-" else "black", label=label)
            kept[label.replace("η = ", "eta_").replace(", ", "_")] = (key, total, "1")
            for end in (0, -1):
                said = f"Gamma, {label.replace('η', 'eta')}, {key} = {x[end]:.6g}"
                lines.append(shown(f"Fig. {number}", said, total[end]))
    axes.set_ylim(*limits)
    named(axes, over, _GAMMA)
    data = dataset(f"Coupling indicator over {over}", {key: (x, "1")}, kept)
    return Plate(number, figure, data, tuple(lines))


def _figure_3_11() -> Plate:
    eps, squares = np.linspace(0.0, 0.015, 16), np.linspace(0.0, 0.8, 24)
    grid_eps, grid_s = (x.ravel() for x in np.meshgrid(eps, np.sqrt(squares)))
    item, tensions = "Fig. 3.11", {}
    lines = list(captions(item, printed.BETA, printed.BETA_INEFFECTIVE))
    for name, (_, angle) in ORIENTATIONS.items():
        found = sampled(eps=grid_eps, s=grid_s, angle=angle)
        tensions[name] = found.T.reshape(len(squares), len(eps))
        corner = f"T, {name} oriented, s^2 = 0.8, eps"
        for k, e in ((0, "0"), (-1, "0.015")):
            lines.append(shown(item, f"{corner} = {e}", tensions[name][-1, k]))
    figure = surfaces(
        [(eps, squares, T) for T in tensions.values()],
        [("ε", "s²", "tension, T (η = 0.785)"), ("ε", "s²", "tension, T (η = 0)")],
    )
    variables = {
        f"T_{name}_oriented": (("s_squared", "eps"), T, "1") for name, T in tensions.items()
    }
    data = dataset("Tension change over speed and bending stiffness",
                   {"s_squared": (squares, "1"), "eps": (eps, "1")}, variables)  # fmt: skip
    return Plate("3.11", figure, data, tuple(lines))
