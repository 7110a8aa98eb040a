"""Chapter 2: waves, reflections and frequencies of one moving beam."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import beltjax as bj
from beltjax.physics.moving_beam_expansion import leading_wave_numbers
from beltjax.physics.moving_beam_shapes import reflection
from beltjax.physics.waves import wave_numbers
from beltjax.validation.plates import COLORS, Plate, dataset, named, panels
from beltjax.validation.printed import beam as printed
from beltjax.validation.verdicts import DIFFERS, Line, compared, compared_formula, shown

_SLOW, _OMEGA = 0.4, 2.0  # v and omega of Fig. 2.2, a sketch in the source


def tables() -> list[Line]:
    """Tables 2.1 and 2.2."""
    return [*_table_2_1(), *_table_2_2()]


def exact_roots(eps: float, v: float, omega: float) -> Any:
    """The four wave numbers of (2.4)."""
    numbers = (jnp.asarray(x, dtype=float) for x in (eps**2, 1 - v**2, v, 1.0, omega))
    return wave_numbers(*numbers)


def _table_2_1() -> Iterator[Line]:
    for case in printed.TABLE_2_1:
        numbers = case.eps, case.v, case.omega
        routes = (
            ("exact", case.exact, exact_roots(*numbers)),
            ("approximate", case.leading, leading_wave_numbers(*map(jnp.asarray, numbers))),
        )
        for route, row, r in routes:
            where = f"{route}, eps = {case.eps:g}, v = {case.v:g}, omega = {case.omega:g}"
            names = ("r1", "r2", "Re r3", "Im r3")
            found = (r.r1, r.r2, r.r3.real, r.r3.imag)
            for name, value, root in zip(names, row, found, strict=True):
                yield compared("Table 2.1", f"{name}, {where}", value, root)
            # Printed as the conjugate of r3, digit for digit.
            yield compared("Table 2.1", f"Re r4, {where}", row[2], r.r4.real)
            yield compared("Table 2.1", f"-Im r4, {where}", row[3], -r.r4.imag)


def _table_2_2() -> Iterator[Line]:
    case = printed.TABLE_2_1[1]
    r = np.array(exact_roots(case.eps, case.v, case.omega), dtype=complex)
    for entry in printed.TABLE_2_2:
        found = _supported(entry.support, entry.name, r)
        ours = complex(getattr(reflection(entry.support, exact_roots(*case[:3])), entry.name))
        line = compared_formula(
            "Table 2.2", f"{entry.name}, {entry.support} support", entry.text, entry.formula(*r),
            found,
        )  # fmt: skip
        yield line if abs(ours - found) <= 1e-12 else line._replace(verdict=DIFFERS)


def _supported(support: str, name: str, r: np.ndarray) -> complex:
    """What a support sends back, from its two conditions alone: w = 0, and w'' = 0 or w' = 0."""
    q = 2 if support == "simple" else 1
    arriving, leaving, layer = (1, 0, 2) if name.endswith("A") else (0, 1, 3)
    conditions = np.array([[1, 1], [r[leaving] ** q, r[layer] ** q]])
    sent = np.linalg.solve(conditions, -np.array([1, r[arriving] ** q]))
    return complex(sent[0] if name.startswith("R_") else sent[1])


def plates() -> Iterator[Plate]:
    """Figs. 2.2 and 2.3."""
    yield _figure_2_2()
    yield _figure_2_3()


def _figure_2_2() -> Plate:
    v, omega = _SLOW, _OMEGA
    eps = np.geomspace(1e-3, 0.1, 41)
    parts = {
        "D1": 2 * eps * omega * v / np.sqrt(1 - v**2),
        "D2": (eps * omega) ** 2 * (1 / (1 - v) ** 2 - 1 / (1 + v) ** 2),
        "D3": np.abs(-(1 - v**2) + (eps * omega) ** 2
                     * ((v / (1 - v**2)) ** 2 - 1 / (1 - v) ** 2)),
    }  # fmt: skip
    above, below = (-parts["D3"] + shift + 1j * parts["D1"] for shift in (0.0, parts["D2"]))
    parts["phase of D"] = np.abs(np.angle(above / below))
    r = jax.vmap(lambda e: jnp.stack([*exact_roots(e, v, omega)]))(jnp.asarray(eps))
    sent = np.asarray(jax.vmap(lambda r: reflection("simple", r).R_A)(tuple(r.T)))
    exact = np.abs(np.angle(-sent))
    figure, (plane, orders) = panels(2, 1)
    for number, name, color in ((above[-1], "numerator", 0), (below[-1], "denominator", 1)):
        arrow = {"arrowstyle": "-|>", "color": COLORS[color], "lw": 1.8}
        plane.annotate("", (number.real, number.imag), (0, 0), arrowprops=arrow)
        plane.plot([], [], color=COLORS[color], label=f"{name} of D = -R_A")
    plane.set_xlim(-1.05, 0.1)
    plane.set_ylim(-0.02, 0.25)
    plane.set_title(f"eps = 0.1, v = {v}, ω = {omega:g}")
    named(plane, "real part", "imaginary part")
    for (name, part), color in zip(parts.items(), COLORS, strict=False):
        orders.loglog(eps, part, color=color, label=f"{name}, by (2.15)")
    orders.loglog(eps, exact, "--", color="black", label="phase of D, exact roots")
    named(orders, "bending stiffness, ε", "size")
    lines = [
        compared("Fig. 2.2", f"order in eps of {name}", value,
                 np.log(parts[name][8] / parts[name][0]) / np.log(eps[8] / eps[0]))
        for name, value in printed.FIGURE_2_2.items()
    ]  # fmt: skip
    lines.append(shown("Fig. 2.2", "exact phase of D over that by (2.15), eps = 0.001",
                       exact[0] / parts["phase of D"][0]))  # fmt: skip
    variables = {name.replace(" ", "_"): ("eps", part, "1") for name, part in parts.items()}
    variables["exact_phase"] = ("eps", exact, "rad")
    data = dataset("Parts of D = -R_A of a simple support", {"eps": (eps, "1")}, variables)
    return Plate("2.2", figure, data, tuple(lines))


def _figure_2_3() -> Plate:
    eps, v = np.linspace(0.0, 0.12, 49), np.array(printed.FIGURE_2_3_SPEEDS)

    def first(method: Any) -> Any:
        def of(eps: Array, v: Array) -> Array:
            return bj.moving_beam_modes(eps, v, count=1, method=method, throw=False).frequencies[0]

        return np.asarray(jax.jit(jax.vmap(jax.vmap(of, (0, None)), (None, 0)))(eps, v))

    exact, longer = first("exact"), first("perturbation")
    row = v[:, None]
    # (2.28) as printed; the library's perturbation has one more term.
    two_terms = np.pi * (1 - row**2 + (eps * np.pi) ** 2 * (row**4 + 6 * row**2 + 1) / 2)
    figure, (axes,) = panels(1, 1, 7.2, 5.0)
    for k, (speed, color) in enumerate(zip(v, COLORS, strict=False)):
        axes.plot(eps, exact[k], color=color, label=f"v = {speed:g}")
        axes.plot(eps, two_terms[k], "--", color=color)
        axes.plot(eps, longer[k], ":", color=color)
    for style, label in (("-", "exact"), ("--", "perturbation (2.28)"), (":", "with its ε³ term")):
        axes.plot([], [], style, color="black", label=label)
    axes.set_ylim(0, 4)
    axes.set_xlim(0, 0.12)
    named(axes, "bending stiffness, ε", "fundamental natural frequency, ω", legend=False)
    axes.legend(frameon=False, fontsize=10, ncols=2, loc="upper left")
    lines = [
        shown("Fig. 2.3", f"omega_1, eps = 0.12, v = {speed:g}, {route}", curve[k, -1])
        for route, curve in (("exact", exact), ("perturbation (2.28)", two_terms))
        for k, speed in enumerate(v)
    ]
    axes_of = ("v", "eps")
    data = dataset(
        "Fundamental frequency of a simply supported moving beam",
        {"v": (v, "1"), "eps": (eps, "1")},
        {"exact": (axes_of, exact, "1"), "perturbation": (axes_of, two_terms, "1"),
         "perturbation_with_next_term": (axes_of, longer, "1")},
    )  # fmt: skip
    return Plate("2.3", figure, data, tuple(lines))
