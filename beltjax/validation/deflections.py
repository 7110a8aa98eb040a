"""Chapter 3, Tables 3.2 and 3.3 and the steady deflections of Figs. 3.3 to 3.7, 3.12 and 3.13."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import beltjax as bj
from beltjax.validation.plates import COLORS, Plate, dataset, named, panels, surfaces
from beltjax.validation.printed import steady as printed
from beltjax.validation.steady import Sampled, X, loaded_tensions, sampled, table_lengths
from beltjax.validation.verdicts import Line, compared, shown

METHODS = {"exact": bj.Exact(), "perturbation": bj.Perturbation(), "linear": bj.Linear()}
_COARSE = slice(None, None, 5)  # of X, on surfaces


def tables() -> list[Line]:
    """Tables 3.2 and 3.3."""
    return [*calculated("Table 3.2"), _base_tension(), *_groups(), *_table_3_3()]


def calculated(item: str) -> Iterator[Line]:
    """What Tables 3.2 and 4.1 calculate of the prototype's layout."""
    lengths, angles = table_lengths()
    for i, (value, length) in enumerate(zip(printed.SPAN_LENGTHS, lengths, strict=True), start=1):
        yield compared(item, f"l{i} (m)", value, length)
    yield compared(item, "theta_tr (rad)", printed.WIND_UP, printed.TENSION * _moment_arm())
    for i, (value, angle) in enumerate(zip(printed.ALIGNMENT, angles, strict=True), start=1):
        yield compared(item, f"beta_{i} (deg)", value, angle)


def _moment_arm() -> float:
    """Wind-up of the spring for each newton of tension: r_t D/k_r, of the printed angles."""
    one, two = np.sin(np.radians(printed.BETA))
    return printed.ARM * (one - two) / printed.ARM_STIFFNESS


def _base_tension() -> Line:
    tension = printed.WIND_UP.number / _moment_arm()
    return compared("Table 3.2", "P0 (N), of theta_tr", printed.BASE_TENSION, tension)


def _groups() -> Iterator[Line]:
    spring = printed.ARM_STIFFNESS / (printed.TENSION * printed.ARM)
    stretch = printed.AXIAL_STIFFNESS / printed.TENSION
    for name, number in (("k_s", spring), ("gamma", stretch)):
        yield compared("Captions, chapter 3", name, printed.GROUPS[name], number)


def _table_3_3() -> Iterator[Line]:
    cases = printed.TABLE_3_3
    numbers = {key: [getattr(case, key) for case in cases] for key in ("eps", "s", "P")}
    full, leading = (sampled(METHODS[key], **numbers) for key in ("exact", "perturbation"))
    for k, case in enumerate(cases):
        name = case.id.partition(",")[0]
        for quantity, value, number in (
            ("T exact", case.T, full.T),
            ("T approximate", case.T_leading, leading.T),
            ("theta_t exact", case.th, full.th),
            ("theta_t approximate", case.th_leading, leading.th),
        ):
            yield compared("Table 3.3", f"{quantity}, {name}", value[0], number[k])


class Surface(NamedTuple):
    """A figure of the deflections of spans 1 and 3 over one number."""

    number: str
    over: str  # for people
    key: str  # in the data file
    values: tuple[Any, Any]  # of the number, as spans 1 and 3 are drawn over it
    numbers: dict[str, Any]  # of the prototype


def _surface_figures() -> Iterator[Surface]:
    # From where span 1 reaches the -0.03 that the source's axis ends at.
    inverse = np.linspace(280.0, 4000.0, 32)
    yield Surface("3.3", "1/ε²", "inverse_eps_squared", (inverse, inverse), {"eps": inverse**-0.5})
    P = loaded_tensions(np.linspace(0.0, printed.LARGEST_TORQUE, 32))
    yield Surface("3.4", "P", "tension", (P[:, 0], P[:, 2]), {"eps": 0.05, "P": P})
    for number, over, key, values in (
        ("3.5", "s", "s", np.linspace(0.0, 0.8, 32)),
        ("3.6", "k_s", "k_s", np.linspace(0.5, 60.0, 32)),
        ("3.7", "γ", "gam", np.linspace(25.0, 2000.0, 32)),
    ):
        yield Surface(number, over, key, (values, values), {"eps": 0.05, key: values})


def plates() -> Iterator[Plate]:
    """Figs. 3.3 to 3.7, 3.12 and 3.13."""
    for surface in _surface_figures():
        yield _surface_plate(surface, sampled(**surface.numbers))
    for number, case in zip(("3.12", "3.13"), printed.TABLE_3_3, strict=True):
        yield _lines_plate(number, case)


def _surface_plate(of: Surface, found: Sampled) -> Plate:
    w = found.deflections[:, :, _COARSE]
    x = X[_COARSE]
    grids = [(x, values, w[:, i]) for i, values in zip((0, 2), of.values, strict=True)]
    which = {"P": ("P₁", "P₃")}.get(of.over, (of.over, of.over))
    labels = [
        (f"x{i}", over, f"span {i} deflection, w{i}") for i, over in zip((1, 3), which, strict=True)
    ]
    points = np.arange(len(w))
    data = dataset(
        f"Steady deflections of spans 1 and 3 over {of.over}",
        {"x": (X, "1"), "point": (points, "1")},
        {
            f"{of.key}_span_{i}": ("point", values, "1")
            for i, values in zip((1, 3), of.values, strict=True)
        }
        | {f"w{i}": (("point", "x"), found.deflections[:, i - 1], "1") for i in (1, 3)}
        | {"tension_change": ("point", found.T, "1"), "arm_rotation": ("point", found.th, "rad")},
    )
    lines = [
        shown(f"Fig. {of.number}", f"largest |w{i}|, {over} = {values[end]:.6g}",
              np.abs(found.deflections[end, i - 1]).max())
        for i, over, values in zip((1, 3), which, of.values, strict=True)
        for end in (0, -1)
    ]  # fmt: skip
    if of.number == "3.4":
        smallest = compared("Figs. 3.4, 3.9", "P1 at the largest torque",
                            printed.LEAST_TENSION, of.values[0][-1])  # fmt: skip
        lines.insert(0, smallest)
    return Plate(of.number, surfaces(grids, labels), data, tuple(lines))


def _lines_plate(number: str, case: printed.Case) -> Plate:
    found = {
        name: sampled(method, eps=case.eps, s=case.s, P=case.P) for name, method in METHODS.items()
    }
    figure, axes = panels(2, 1)
    styles = {"exact": "-", "perturbation": "--", "linear": ":"}
    lines = []
    for i, panel, factor, power in ((0, axes[0], 1e3, "10⁻³"), (2, axes[1], 1e4, "10⁻⁴")):
        for (name, of), color in zip(found.items(), COLORS, strict=False):
            w = of.deflections[0, i]
            panel.plot(X, factor * w, styles[name], color=color, label=name)
            peak = w[np.argmax(np.abs(w))]
            lines.append(shown(f"Fig. {number}", f"peak of w{i + 1}, {name}", peak))
        named(panel, f"x{i + 1}", f"span {i + 1} deflection, w{i + 1} ({power})")
    w = np.stack([of.deflections[0] for of in found.values()])
    data = dataset(
        f"Steady deflections, eps = {case.eps}, s = {case.s}",
        {"method": (list(found), ""), "span": ([1, 2, 3], ""), "x": (X, "1")},
        {"w": (("method", "span", "x"), w, "1")},
    )
    return Plate(number, figure, data, tuple(lines))
