"""Chapter 5, the pictures: belts on their pulleys, tensions, speeds, largest moments."""

from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np

import beltjax as bj
from beltjax.analysis.contact import ContactState
from beltjax.analysis.contact_path import BeltPiece, belt_pieces
from beltjax.draw.contact import draw_contact
from beltjax.validation.contact import (
    HALF,
    LOADED,
    SLACK,
    SPEEDS,
    TIGHT,
    SolvedDrives,
    departures,
    fixed_boundaries,
)
from beltjax.validation.plates import (
    COLORS,
    Plate,
    dataset,
    legend_above,
    named,
    panels,
)
from beltjax.validation.printed import contact as printed
from beltjax.validation.verdicts import Line, compared, shown

_SPANS = (("tight", TIGHT, 1.0), ("slack", SLACK, -1.0))  # and the side of the drive they are on
_LABELS = [f"EI = {EI:g} N m²" for EI in printed.STIFFNESSES]


def plates(regular: SolvedDrives, largest: SolvedDrives) -> Iterator[Plate]:
    """Figs. 5.4 to 5.8."""
    yield _on_pulleys("5.4", regular, 0, _arcs)
    yield _along_spans(regular)
    yield _two_models(regular)
    plate = _on_pulleys("5.7", largest, HALF, _departures)
    yield plate._replace(lines=(*_departure_lines(largest), *plate.lines))
    yield _over_speed(largest)


def _arcs(state: ContactState) -> str:
    slip, adhesion = np.degrees(state.slips[0]), np.degrees(state.adhesions[0])
    return f"slip {slip:.1f}°, adhesion {adhesion:.1f}°"


def _departures(state: ContactState) -> str:
    at = [f"{angle:.2f}°" for angle in departures(state)]
    return f"tight span {at[0]} and {at[1]}, slack span {at[2]} and {at[3]}"


def _on_pulleys(
    number: str, solved: SolvedDrives, column: int, said: Callable[[ContactState], str]
) -> Plate:
    """Where the belt runs free, adheres and slips."""
    figure, axes = panels(len(LOADED), 1, 7.6, 3.6)
    points, zones, stiffnesses, lines = [], [], [], []
    for panel, EI in zip(axes, LOADED, strict=True):
        k = printed.STIFFNESSES.index(EI)
        drive, state = solved.drives[k], solved.states[k][column]
        pieces = belt_pieces(state)
        draw_contact(panel, drive, state, pieces)
        panel.set_title(f"{_LABELS[k]}: {said(state)}", fontsize=11)
        for piece in pieces:
            points.append(piece.positions)
            zones += [piece.zone] * len(piece.positions)
            stiffnesses += [EI] * len(piece.positions)
        for i, name in enumerate(drive.pulley_names):
            quantity = f"adhesion of the {name} (deg), EI = {EI:g}"
            lines.append(shown(f"Fig. {number}", quantity, np.degrees(state.adhesions[i])))
    path = np.concatenate(points)
    data = dataset(
        "The belt's path, in the direction of travel",
        {"point": (np.arange(len(path)), "")},
        {"x": ("point", path[:, 0], "m"), "y": ("point", path[:, 1], "m"),
         "EI": ("point", stiffnesses, "N m2"), "zone": ("point", np.array(zones), "")},
    )  # fmt: skip
    return Plate(number, figure, data, tuple(lines))


def _departure_lines(largest: SolvedDrives) -> Iterator[Line]:
    names = ("theta_1(0)", "theta_1(L1)", "-theta_2(0)", "-theta_2(L2)")
    for EI, known in printed.FIGURE_5_7.items():
        found = departures(largest.states[printed.STIFFNESSES.index(EI)][HALF])
        for name, value, angle in zip(names, known, found, strict=True):
            yield compared("Fig. 5.7", f"{name} (deg), EI = {EI:g}", value[0], angle)


def _span(solved: SolvedDrives, k: int, place: int) -> BeltPiece:
    pieces = belt_pieces(solved.states[k][0])
    return next(piece for piece in pieces if piece.zone == "span" and piece.place == place)


def _along_spans(solved: SolvedDrives) -> Plate:
    """Tension and speed of the free spans over x, the driver's center at x = 0."""
    figure, axes = panels(4, 1, 6.6, 3.6)
    lines, kept = [], []
    for row, (name, place, _) in enumerate(_SPANS):
        for k, (label, color) in enumerate(zip(_LABELS, COLORS, strict=False)):
            piece = _span(solved, k, place)
            x = piece.positions[:, 0]
            axes[2 * row].plot(x, piece.tension, color=color, label=label)
            axes[2 * row + 1].plot(x, piece.speed, color=color, label=label)
            kept.append((x, piece.tension, piece.speed))
            said = f"of the {name} span at its start, EI = {printed.STIFFNESSES[k]:g}"
            lines.append(shown("Fig. 5.5", f"tension (N) {said}", piece.tension[0]))
            lines.append(shown("Fig. 5.5", f"speed (m/s) {said}", piece.speed[0]))
        named(axes[2 * row], f"x of the free {name} span (m)", "tension (N)", legend=False)
        named(axes[2 * row + 1], f"x of the free {name} span (m)", "speed (m/s)", legend=False)
        axes[2 * row + 1].ticklabel_format(useOffset=False)
    legend_above(axes[0])
    table = np.array(kept).reshape(2, len(_LABELS), 3, -1)
    axes_of = ("span", "EI", "point")
    data = dataset(
        "Tension and speed of the free spans",
        {"span": (["tight", "slack"], ""), "EI": (list(printed.STIFFNESSES), "N m2")},
        {"x": (axes_of, table[:, :, 0], "m"), "tension": (axes_of, table[:, :, 1], "N"),
         "speed": (axes_of, table[:, :, 2], "m/s")},
    )  # fmt: skip
    return Plate("5.5", figure, data, tuple(lines))


def _two_models(solved: SolvedDrives) -> Plate:
    """Free spans with their contact points free, and by chapter 3 with those of a string."""
    figure, axes = panels(4, 1, 6.6, 3.4)
    steady = [fixed_boundaries(drive) for drive in solved.drives]
    radius, distance = printed.EQUAL["R"], printed.EQUAL["L"]
    fraction = np.linspace(0.0, 1.0, 241)
    kept, lines = [], []
    for row, (name, place, side) in enumerate(_SPANS):
        free, fixed = axes[row], axes[2 + row]
        for k, (label, color) in enumerate(zip(_LABELS, COLORS, strict=False)):
            x, y = _span(solved, k, place).positions.T
            free.plot(x, y, color=color, label=label)
            free.plot(x[[0, -1]], y[[0, -1]], "o", color=color, markersize=4)
            w = distance * np.asarray(steady[k].deflection(place, jnp.asarray(fraction)))
            held = side * (radius - w)  # w is positive inwards
            along = distance * (fraction if side < 0 else 1 - fraction)
            fixed.plot(along, held, color=color, label=label)
            kept.append((x, y, along, held))
            for model, offset in (("moving", y), ("fixed", held)):
                said = f"largest |y| (m), {name} span, {model} boundaries"
                text = f"{said}, EI = {printed.STIFFNESSES[k]:g}"
                lines.append(shown("Fig. 5.6", text, np.abs(offset).max()))
        for panel, model in ((free, "moving"), (fixed, "fixed")):
            panel.set_ylim(*((0.042, 0.064) if side > 0 else (-0.075, -0.035)))
            panel.set_xlim(-0.05, 0.2)
            named(panel, f"x of the {name} span (m), {model} boundaries", "y (m)", legend=False)
    legend_above(axes[0])
    table = np.array(kept).reshape(2, len(_LABELS), 4, -1)
    axes_of = ("span", "EI", "point")
    names = ("x_moving", "y_moving", "x_fixed", "y_fixed")
    data = dataset(
        "Free spans by two models",
        {"span": (["tight", "slack"], ""), "EI": (list(printed.STIFFNESSES), "N m2")},
        {key: (axes_of, table[:, :, j], "m") for j, key in enumerate(names)},
    )
    return Plate("5.6", figure, data, tuple(lines))


def _over_speed(solved: SolvedDrives) -> Plate:
    """Largest moment, efficiency and the spans' tensions over speed."""
    tension, radius = printed.UNEQUAL["tension"], printed.UNEQUAL["R2"]
    rows = {name: np.full((len(_LABELS), len(SPEEDS)), np.nan) for name in _OVER_SPEED}
    for k, states in enumerate(solved.states):
        for j, state in enumerate(states):
            if bool(state.result == bj.RESULTS.successful):
                rows["moment"][k, j] = float(state.moments[1]) / (radius * tension)
                rows["efficiency"][k, j] = float(state.efficiency)
                rows["tight"][k, j] = float(state.tensions[TIGHT, 1]) / tension
                rows["slack"][k, j] = float(state.tensions[SLACK, 1]) / tension
    figure, axes = panels(4, 1, 6.6, 3.6)
    lines = []
    for panel, (name, label) in zip(axes, _OVER_SPEED.items(), strict=True):
        for k, (curve, color) in enumerate(zip(rows[name], COLORS, strict=False)):
            panel.plot(SPEEDS, curve, color=color, label=_LABELS[k])
            for j in (0, HALF, -1):
                said = f"{name}, EI = {printed.STIFFNESSES[k]:g}, C = {SPEEDS[j]:.6g}"
                lines.append(shown("Fig. 5.8", said, curve[j]))
        named(panel, "dimensionless speed, C = c/c_cr", label, legend=False)
    legend_above(axes[0])
    data = dataset(
        "Largest moment over speed",
        {"EI": (list(printed.STIFFNESSES), "N m2"), "C": (SPEEDS, "1")},
        {name: (("EI", "C"), values, "1") for name, values in rows.items()},
    )
    return Plate("5.8", figure, data, tuple(lines))


_OVER_SPEED = {
    "moment": "largest moment, M₂/(R₂ T_ini)",
    "efficiency": "power efficiency, η",
    "slack": "T_s at midspan / T_ini",
    "tight": "T_t at midspan / T_ini",
}
