"""The belt of a contact state as a curve, with its zones, tension, speed and curvature."""

from collections.abc import Iterator
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.contact import ContactState
from beltjax.compiling.quick import usual_promotion
from beltjax.physics import contact as physics
from beltjax.physics.elastica import Span, SpanData, curvature_along

POINTS = 241  # on each piece
Zone = Literal["span", "adhesion", "slip"]


class BeltPiece(NamedTuple):
    """One span, or one arc of adhesion or slip on a pulley, in the direction of travel."""

    zone: Zone
    place: int  # of the span, or of the pulley, in the list
    arc_length: np.ndarray  # from where its belt meets the first pulley of its travel [m]
    positions: np.ndarray  # [points, 2] [m]
    tension: np.ndarray  # [N]
    speed: np.ndarray  # [m/s]
    curvature: np.ndarray  # [1/m], positive where the belt turns left


@usual_promotion
def belt_pieces(state: ContactState, points: int = POINTS) -> tuple[BeltPiece, ...]:
    """All of the belts, piece by piece in the direction of travel, from the first listed pulleys.

    Belt follows belt, in listed order. Arcs of no length are left out. The pieces of a state that
    was not found are those of its placeholders; nothing is raised.

    Args:
        state: a contact state of a single drive, not of a batch.
        points: number of points on each piece.

    Returns:
        The pieces, each with arrays of `points` entries in SI units, NumPy's.

    Examples:
        >>> drive, point = bj.load_drive("examples/two_pulley_table_5_1.toml")
        >>> pieces = bj.belt_pieces(bj.contact_state(drive, point))
        >>> max(piece.tension.max() for piece in pieces)  # [N]
    """
    loop, model = jax.device_get((state.solved.loop, state.model))
    curvatures = _span_curvatures(state, points)
    starts, ends = _inclinations(loop, model)
    pulleys, spans = np.asarray(state.order.pulleys), np.asarray(state.order.spans)
    before = np.asarray(model.loops.preceding(jnp.arange(len(pulleys))))
    pieces, run = [], 0.0
    for k in range(len(pulleys)):
        run = 0.0 if k in model.loops.starts else run
        arcs = _arcs(k, float(ends[before[k]]), loop, model, points)
        for piece in (*arcs, _span(k, float(starts[k]), curvatures[k], loop, model)):
            place = int((spans if piece.zone == "span" else pulleys)[k])
            if piece.arc_length[-1] > 0:
                pieces.append(_in_si(piece, place, run, state))
                run += piece.arc_length[-1]
    return tuple(pieces)


def _span_curvatures(state: ContactState, points: int) -> Float[np.ndarray, "spans points"]:
    """Curvature along each span, at points that divide its arc length evenly."""
    loop = state.solved.loop
    along = jnp.linspace(0.0, 1.0, points)
    return np.asarray(_curvatures(loop.spans, loop.data, along))


@jax.jit
def _curvatures(
    spans: Span, data: SpanData, along: Float[Array, " points"]
) -> Float[Array, "spans points"]:
    return jax.vmap(lambda span, of: curvature_along(span, of, along * span.L))(spans, data)


def _inclinations(loop: physics.Loop, model: physics.ContactModel) -> Iterator[np.ndarray]:
    """Inclinations of the belts in the plane of the drive, at the spans' starts and ends."""
    following = model.loops.following
    line = np.arctan2(following(loop.y) - loop.y, following(loop.x) - loop.x)
    return (line + np.asarray(angle) for angle in physics.inclinations(loop.spans, model))


def _contact(
    k: int, inclination: float | np.ndarray, loop: physics.Loop, model: physics.ContactModel
) -> Float[np.ndarray, "*points 2"]:
    """Points of the k-th pulley where a belt of these inclinations touches it."""
    rho = float(model.rho[k])
    x, y = loop.x[k] + rho * np.sin(inclination), loop.y[k] - rho * np.cos(inclination)
    return np.stack([x, y], axis=-1)


def _arcs(
    k: int, entry: float, loop: physics.Loop, model: physics.ContactModel, points: int
) -> Iterator[BeltPiece]:
    """Arcs of adhesion and of slip on the k-th pulley that the belt meets."""
    rho, turn = float(model.rho[k]), np.sign(model.rho[k])
    adhesion, slip = max(float(loop.touching[k] - loop.slip[k]), 0.0), float(loop.slip[k])
    rate = np.sign(loop.P_out[k] - loop.P_in[k]) * model.mu[k]
    bent = loop.data.EI[k] * loop.kap[k] ** 2 / 2
    zones: list[tuple[Zone, float, float]] = [("adhesion", 0.0, adhesion), ("slip", adhesion, slip)]
    for zone, start, length in zones:
        angle = start + np.linspace(0.0, length, points)
        inclination = entry + turn * angle
        P = loop.P_in[k] * np.exp(rate * np.maximum(angle - adhesion, 0.0))
        yield BeltPiece(
            zone,
            k,
            np.abs(rho) * (angle - start),
            _contact(k, inclination, loop, model),
            np.asarray(physics.tension(P, bent, loop, model, k)),
            np.asarray(physics.speed(P, bent, loop, model, k)),
            np.full(points, loop.kap[k]),
        )


def _span(
    k: int, start: float, kap: np.ndarray, loop: physics.Loop, model: physics.ContactModel
) -> BeltPiece:
    """The k-th span, whose curvature is integrated to its inclination and to its path."""
    from scipy.integrate import cumulative_simpson  # takes half a second; only curves need it

    s = np.linspace(0.0, 1.0, len(kap)) * float(loop.spans.L[k])
    inclination = start + cumulative_simpson(kap, x=s, initial=0.0)
    x = cumulative_simpson(np.cos(inclination), x=s, initial=0.0)
    y = cumulative_simpson(np.sin(inclination), x=s, initial=0.0)
    path = _contact(k, start, loop, model) + np.stack([x, y], axis=1)
    bent = loop.data.EI[k] * kap**2 / 2
    P = loop.C[k] - bent
    tension = np.asarray(physics.tension(P, bent, loop, model, k))
    speed = np.asarray(physics.speed(P, bent, loop, model, k))
    return BeltPiece("span", k, s, path, tension, speed, kap)


def _in_si(piece: BeltPiece, place: int, run: float, state: ContactState) -> BeltPiece:
    """A dimensionless piece in SI units, at its listed `place` and after the arc length `run`."""
    length, force, time = map(
        float, (getattr(state.scales, n) for n in ("length", "tension", "time"))
    )
    return piece._replace(
        place=place,
        arc_length=(run + piece.arc_length) * length,
        positions=piece.positions * length,
        tension=piece.tension * force,
        speed=piece.speed * length / time,
        curvature=piece.curvature / length,
    )


def span_deflection(state: ContactState, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Deflection of span i from the straight tangent of its two pulleys.

    The stiff belt leaves its pulleys elsewhere than a string would, so that x begins and ends where
    the belt does.

    Args:
        state: a contact state of a single drive, not of a batch.
        i: place of the span in the list.

    Returns:
        The distance x [m] along the tangent, in listed order from the tangent point of a string,
        and the deflection [m] towards the inside of the loop; both of shape [points].
    """
    piece = next(p for p in belt_pieces(state) if p.zone == "span" and p.place == i)
    loop, model = state.solved.loop, state.model
    k = int(state.order.spans[i])
    after = int(model.loops.following(jnp.arange(len(model.rho)))[k])
    center = np.array([loop.x[k], loop.y[k]])
    line = np.array([loop.x[after], loop.y[after]]) - center
    d = float(np.hypot(*line))
    rise = float(model.rho[k] - model.rho[after]) / d
    run = np.sqrt(1 - rise**2)
    along = np.array([line[0] * run - line[1] * rise, line[0] * rise + line[1] * run]) / d
    left = np.array([-along[1], along[0]])
    length = float(state.scales.length)
    offset = piece.positions - length * (center - float(model.rho[k]) * left)
    x, w = offset @ along, offset @ left
    inward = w if bool(state.inside_left[i]) else -w
    if bool(state.forward[i]):
        return x, inward
    return d * run * length - x[::-1], inward[::-1]
