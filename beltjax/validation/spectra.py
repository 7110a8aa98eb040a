"""Chapter 4, natural frequency spectra, each mode followed by its shape: Figs. 4.5 to 4.9."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import beltjax as bj
from beltjax.analysis.sweep import Sweep
from beltjax.analysis.tracking import ModeShapes, linked, tracks
from beltjax.compiling.quick import in_chunks, quickly_compiled
from beltjax.validation.coupling import captions
from beltjax.validation.deflections import calculated
from beltjax.validation.drives import (
    WELL,
    middle_angle,
    prototype,
    speed_of,
    stiffness_of,
)
from beltjax.validation.plates import (
    COLORS,
    Plate,
    dataset,
    legend_above,
    named,
    panels,
)
from beltjax.validation.printed import steady, vibration
from beltjax.validation.steady import sampled
from beltjax.validation.verdicts import Line, compared, shown

COUNT = 20  # of the modes followed; the figures show those below omega = 10 to 14
_POOR = middle_angle(steady.BETA_INEFFECTIVE)
# Where the belt's stiffness, or its steady state, is held in Fig. 4.6; the source does not say.
_HELD = 0.05
_OMEGA = "natural frequency, ω"
_TOP = 10.5  # of the axes of most figures


def tables() -> list[Line]:
    """Table 4.1."""
    return list(calculated("Table 4.1"))


class Curves(NamedTuple):
    """Frequencies of modes along a number; nan where a mode is not followed."""

    values: Float[np.ndarray, " points"]
    omega: Float[np.ndarray, "points modes"]  # dimensionless


def over_stiffness() -> Curves:
    """Fig. 4.5: the belt at rest, eps from 0 to 0.2."""
    eps = np.linspace(0.0, 0.2, 41)
    found = _swept(*prototype(), "belt.bending_stiffness", np.asarray(stiffness_of(eps)))
    return Curves(np.sqrt(found.values / float(stiffness_of(1.0))), found.dimensionless)


def over_speed(eps: float, angle: float) -> Curves:
    """Figs. 4.7 and 4.8: s from 0 to 1."""
    s = np.linspace(0.0, 1.0, 33)
    found = _swept(*prototype(eps, angle=angle), "operation.belt_speed", speed_of(s))
    return Curves(found.values / speed_of(1.0), found.dimensionless)


def over_effectiveness(eps: float) -> Curves:
    """Fig. 4.9: the arm turned from eta = 0 to that of Table 3.2, at rest."""
    turn = np.linspace(0.0, WELL - _POOR, 33)
    found = _swept(*prototype(eps, angle=_POOR), "tensioner.angle", turn)
    eta = sampled(angle=_POOR + found.values).effectiveness
    return Curves(eta, found.dimensionless)


def _swept(drive: bj.Drive, point: bj.OperatingPoint, name: str, values: np.ndarray) -> Sweep:
    return bj.sweep(drive, point, name, values, count=COUNT, depth=3)


def with_one_held() -> tuple[Curves, Curves]:
    """Fig. 4.6: over the belt's resistance alone, and over its steady state alone."""
    eps = np.linspace(0.005, 0.2, 40)
    held = np.full_like(eps, _HELD)
    return tuple(
        Curves(eps, _followed(shaped, resisting))
        for shaped, resisting in ((held, eps), (eps, held))
    )  # pyright: ignore[reportReturnType]


def _followed(shaped: np.ndarray, resisting: np.ndarray) -> Float[np.ndarray, "points modes"]:
    """Frequencies with the steady state of one eps and the resistance to bending of another."""

    def run(places: np.ndarray) -> Any:
        pair = jnp.asarray(shaped[places]), jnp.asarray(resisting[places])
        return quickly_compiled(_held_modes)(*pair)

    omega, *rest = in_chunks(run, np.arange(len(shaped)), 16, lambda done, total: None)
    links, _ = linked([ModeShapes(*row) for row in zip(omega, *rest, strict=True)], COUNT)
    places = tracks(links, COUNT)
    return np.where(places >= 0, np.take_along_axis(omega, np.maximum(places, 0), 1), np.nan)


def _held_modes(shaped: Any, resisting: Any) -> Any:
    def at(shaped: Any, resisting: Any) -> Any:
        found = bj.steady_state(*prototype(shaped), throw=False)
        lin = bj.linearize(found, fixed_bending=resisting, throw=False)
        of = bj.modes(lin, COUNT + 4, route="hermitian", throw=False)
        return of.dimensionless, of.coordinates, lin.mass, lin.stiffness

    return eqx.filter_vmap(at)(shaped, resisting)


def plates(over_eps: Curves) -> Iterator[Plate]:
    """Figs. 4.5 to 4.9, of which the first is given."""
    bending, speed = "bending stiffness, ε", "speed, s"
    yield _spectrum("4.5", bending, "eps", {"": over_eps}, _TOP)
    resisting, shaped = with_one_held()
    both = {f"steady state of ε = {_HELD}": resisting, f"resistance of ε = {_HELD}": shaped}
    plate = _spectrum("4.6", bending, "eps", both, _TOP)
    yield plate._replace(lines=tuple(_opposite_trends(resisting, shaped)))
    curves = {f"ε = {eps:g}": over_speed(eps, WELL) for eps in vibration.COUNTS}
    plate = _spectrum("4.7", speed, "s", curves, 11.0)
    counted = [
        compared("Text on Fig. 4.7", f"frequencies below 11 at s = 1, {name.replace('ε', 'eps')}",
                 value, np.sum(curve.omega[-1] < vibration.COUNTED_BELOW))
        for (name, curve), value in zip(curves.items(), vibration.COUNTS.values(), strict=True)
    ]  # fmt: skip
    yield plate._replace(lines=(*counted, *plate.lines))
    curves = {"η = 0": over_speed(0.04, _POOR), "η = 0.785": over_speed(0.04, WELL)}
    plate = _spectrum("4.8", speed, "s", curves, _TOP)
    caption = captions("Fig. 4.8", steady.BETA_INEFFECTIVE, steady.BETA)
    yield plate._replace(lines=(*caption, *plate.lines))
    curves = {f"ε = {eps:g}": over_effectiveness(eps) for eps in (0.1, 0.01)}
    yield _spectrum("4.9", "tensioner effectiveness, η", "eta", curves, 14.0)


def _opposite_trends(resisting: Curves, shaped: Curves) -> Iterator[Line]:
    """What the text says of Fig. 4.6: all rise with the one, some fall with the other."""
    for name, curves in (("resistance", resisting), ("steady state", shaped)):
        slopes = np.diff(curves.omega, axis=0) / np.diff(curves.values)[:, None]
        slopes = slopes[curves.omega[1:] < _TOP]  # those the figure shows
        said = f"least slope of a frequency over eps, by {name} alone"
        yield shown("Fig. 4.6", said, np.nanmin(slopes))


def _spectrum(number: str, over: str, key: str, families: dict[str, Curves], top: float) -> Plate:
    """Tracked frequencies; families of curves solid and dashed, one color per mode in each."""
    figure, (axes,) = panels(1, 1, 7.2, 6.0)
    lines, variables, coordinates = [], {}, {}
    for place, ((name, of), style) in enumerate(zip(families.items(), ("-", "--"), strict=False)):
        for k, omega in enumerate(of.omega.T):
            axes.plot(of.values, omega, style, color=COLORS[k % len(COLORS)], linewidth=1.4)
        axes.plot([], [], style, color="black", label=name)
        axis = f"{key}_{place + 1}" if name else key
        coordinates[axis] = of.values, "1"
        variables[f"omega_{place + 1}"] = ((axis, f"mode_{place + 1}"), of.omega, "1")
        for end in (0, -1):
            said = f"lowest frequency, {name}, {key} = {round(of.values[end], 9):.6g}"
            said = said.replace(", ,", ",").replace("ε", "eps").replace("η", "eta")
            lines.append(shown(f"Fig. {number}", said, np.nanmin(of.omega[end])))
    axes.set_ylim(0 if top > 11 else 1, top)
    axes.set_xlim(0, None)
    axes.margins(x=0)
    named(axes, over, _OMEGA, legend=False)
    if len(families) > 1:
        legend_above(axes)
    kinds: dict[str, Any] = {f"family_{k + 1}": name for k, name in enumerate(families)}
    data = dataset(f"Natural frequencies over {over}", coordinates, variables)
    return Plate(number, figure, data.assign_attrs(kinds), tuple(lines))
