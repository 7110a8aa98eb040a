"""Conservation laws of a whole belt: an answer's residuals by dense quadrature of its shape.

Knows the balance laws of chapter 5 and a stretching law, not how anybody solves them. Everything
is along the belt's travel and in SI, in one fixed frame: span i runs from pulley i to pulley
i + 1, signed radii are positive where a pulley turns the belt left, and P = T - G V.

A free span is (P' = -EI kappa kappa', P kappa = EI kappa''). Its solutions grow and decay as
e^{lambda s}, lambda = sqrt(P/EI), so that neither integration from one end nor from both ends to
the middle keeps a digit beyond lambda L = 35 or 70. Here P and kappa at the start and kappa at
the end are imposed, as the pulleys impose them, and the span is cut into pieces of lambda h <= 1/2
that are matched by Newton's method (multiple shooting): errors then neither grow nor hide, and the
slope of the curvature at the start, which is what a solver knows best, becomes a residual.
Each piece is a Taylor series of order 30, whose nearest pole lies about pi/(2 lambda) away or more;
what follows from it is a Gauss quadrature.
"""

from typing import NamedTuple

import numpy as np

ORDER = 30
ABSCISSAS, WEIGHTS = np.polynomial.legendre.leggauss(24)
FRACTIONS, WEIGHTS = (ABSCISSAS + 1) / 2, WEIGHTS / 2


class BeltData(NamedTuple):
    """What the laws need to know of the belt and its motion."""

    EI: float  # [N m^2]
    EA: float  # [N]
    V_ref: float = 0.0  # [m/s], speed of the unstretched belt
    G: float = 0.0  # [kg/s]
    unstretched_length: float = np.nan  # [m]
    hyperelastic: bool = False  # EA e = T + EI kappa^2/2 rather than the source's EA e = T


class PulleyData(NamedTuple):
    """The pulleys [n] and the answer's contact with them."""

    centers: np.ndarray  # [n, 2] [m]
    rho: np.ndarray  # [m], signed radii
    moments: np.ndarray  # [N m], taken from the belt; the driver's is negative
    friction: np.ndarray
    adhesion: np.ndarray  # [rad], from the entry
    slip: np.ndarray  # [rad], up to the exit


class SpanData(NamedTuple):
    """The answer's state at the start of each span [n]."""

    position: np.ndarray  # [n, 2] [m]
    inclination: np.ndarray  # [rad]
    curvature: np.ndarray  # [1/m]
    curvature_slope: np.ndarray  # d kappa/ds [1/m^2]
    P: np.ndarray  # [N]
    length: np.ndarray  # [m]


class Balances(NamedTuple):
    """Residuals, zero for a correct answer, and below them what they were made of."""

    curvature: np.ndarray  # [n] [1/m]: given at the start, less the most that the pulley allows
    curvature_slope: np.ndarray  # [n] [1/m^2]: given at the start, less what the span needs
    start: np.ndarray  # [n, 2] [m]: given start, less the pulley's point of that inclination
    end: np.ndarray  # [n, 2] [m]: end found, less the next pulley's point of that inclination
    gap: np.ndarray  # [2] [m]: once round, spans and arcs laid end to end
    inclination: np.ndarray  # [n] [rad]: turned through span and pulley, less the next's given
    turning: float  # [rad]: once round, less one turn
    P: np.ndarray  # [n] [N]: carried through span and pulley, less the next span's given
    moments: np.ndarray  # [n] [N m]: of the spans' forces and bending on the pulley, less M
    friction_moments: np.ndarray  # [n] [N m]: friction times radius, integrated, less M
    pulley_forces: np.ndarray  # [n, 2] [N]: spans' forces, less pressure and friction integrated
    span_forces: np.ndarray  # [n, 2] [N]: momentum flux included, at the end less at the start
    span_moments: np.ndarray  # [n] [N m]: the same about the start of the span
    unstretched_length: float  # [m]: integrated, less the belt's
    power: float  # [W]: given by the driver, less taken by the others, less friction's

    friction_loss: float  # [W]: friction times slip speed, integrated
    pulley_speeds: np.ndarray  # [n] [rad/s]: V/R where the belt enters, magnitudes
    axle_forces: np.ndarray  # [n, 2] [N]: of the belt on each pulley


class Shape(NamedTuple):
    """A span, integrated; or all of them, stacked."""

    slope_start: np.ndarray  # d kappa/ds [1/m^2]
    slope_end: np.ndarray
    P_end: np.ndarray
    turn: np.ndarray  # inclination at the end, less that at the start [rad]
    end: np.ndarray  # [2] from the start [m]
    unstretched: np.ndarray  # [m]


class Arcs(NamedTuple):
    """The belt on the pulleys [n], integrated."""

    P_out: np.ndarray
    friction_moment: np.ndarray  # [N m]
    force: np.ndarray  # [n, 2] pressure and friction on the pulley [N]
    displacement: np.ndarray  # [n, 2] [m]
    unstretched: np.ndarray  # [m]
    loss: np.ndarray  # [W]


def strain(belt: BeltData, P, kappa):
    """Stretch e of the belt whose speed is V = V_ref (1 + e) and whose T is P + G V."""
    bending = belt.EI * kappa**2 / 2 if belt.hyperelastic else 0.0
    return (P + bending + belt.G * belt.V_ref) / (belt.EA - belt.G * belt.V_ref)


def unit(angle):
    """Directions [..., 2] along an inclination."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def normal(angle):
    """Directions [..., 2] to the left of an inclination."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def cross(a, b):
    """The component of a x b that is out of the plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


# A span.


def series(state, step: float, bend: float):
    """Taylor coefficients [ORDER + 1, 3, pieces] in s/h of (p, k, q), from their values at 0.

    p' = -H b k q, k' = H q, q' = H p k, with H = lambda h, in units in which all are of order one.
    """
    c = np.zeros((ORDER + 1, *state.shape), state.dtype)
    c[0] = state
    for m in range(ORDER):
        p, k, q = c[: m + 1, 0], c[: m + 1, 1], c[: m + 1, 2]
        kq, pk = np.sum(k * q[::-1], axis=0), np.sum(p * k[::-1], axis=0)
        c[m + 1] = step / (m + 1) * np.array([-bend * kq, c[m, 2], pk])
    return c


def matched_pieces(step: float, bend: float, pieces: int, ends: tuple[float, float, float]):
    """States at the starts of the pieces [3, pieces] for p and k at the start and k at the end."""
    p0, k0, k1 = ends
    s = step * np.arange(pieces)
    near, far = k0 * np.exp(-s), k1 * np.exp(s - step * pieces)
    y = np.array([p0 + bend * (k0**2 - (near + far) ** 2) / 2, near + far, far - near])
    eye, size = np.eye(3), 3 * pieces
    for _ in range(60):
        stepped = series(y, step, bend).sum(axis=0)
        # A complex step gives derivatives to rounding.
        slopes = [
            series(y + 1e-30j * eye[j][:, None], step, bend).sum(axis=0).imag / 1e-30
            for j in range(3)
        ]
        A, r = np.zeros((size, size)), np.zeros(size)
        for i in range(pieces - 1):
            A[3 * i + 2 : 3 * i + 5, 3 * i : 3 * i + 3] = -np.array(slopes)[:, :, i].T
            A[3 * i + 2 : 3 * i + 5, 3 * i + 3 : 3 * i + 6] = eye
            r[3 * i + 2 : 3 * i + 5] = y[:, i + 1] - stepped[:, i]
        A[0, 0], A[1, 1] = 1.0, 1.0
        r[0], r[1] = y[0, 0] - p0, y[1, 0] - k0
        A[-1, -3:], r[-1] = np.array(slopes)[:, 1, -1], stepped[1, -1] - k1
        change = -np.linalg.solve(A, r).reshape(pieces, 3).T
        y = y + change * min(1.0, 0.5 / np.max(np.abs(change)))
        if np.max(np.abs(change)) < 1e-14:
            break
    return y


def integrated_span(belt: BeltData, P: float, kappa_start, kappa_end, inclination, L) -> Shape:
    """The span of length L from P and the curvatures at its ends, laid out from its start."""
    size = P + belt.EI * kappa_start**2 / 2
    rate, kappa_m = np.sqrt(size / belt.EI), max(abs(kappa_start), abs(kappa_end))
    bend, pieces = belt.EI * kappa_m**2 / size, int(np.ceil(2 * rate * L)) + 1
    h = L / pieces
    ends = P / size, kappa_start / kappa_m, kappa_end / kappa_m
    y = matched_pieces(rate * h, bend, pieces, ends)
    c = series(y, rate * h, bend)

    powers = FRACTIONS ** np.arange(ORDER + 2)[:, None]  # [order, point]
    p, k = (np.einsum("mi,mj->ij", c[:, j], powers[:-1]) for j in (0, 1))
    turned = kappa_m * h * c[:, 1] / np.arange(1, ORDER + 2)[:, None]  # theta's coefficients
    at_start = inclination + np.concatenate([[0.0], np.cumsum(turned.sum(axis=0))])
    theta = at_start[:-1, None] + np.einsum("mi,mj->ij", turned, powers[1:])
    end = h * np.einsum("ijx,j->x", unit(theta), WEIGHTS)
    unstretched = h * np.sum((1 / (1 + strain(belt, size * p, kappa_m * k))) @ WEIGHTS)
    last = c[:, :, -1].sum(axis=0)
    return Shape(
        slope_start=y[2, 0] * rate * kappa_m,
        slope_end=last[2] * rate * kappa_m,
        P_end=last[0] * size,
        turn=at_start[-1] - inclination,
        end=end,
        unstretched=unstretched,
    )


# The pulleys.


def integrated_arcs(belt: BeltData, pulleys: PulleyData, P_in, inclination) -> Arcs:
    """Adhesion from the entry, slip to the exit, (5.10), from P and inclination at the entry."""
    radius, sense = np.abs(pulleys.rho), np.sign(pulleys.rho)
    rate = np.sign(pulleys.moments) * pulleys.friction
    curvature = 1 / pulleys.rho
    speed_in = belt.V_ref * (1 + strain(belt, P_in, curvature))

    def sums(first, angle, rate):
        turned = angle[:, None] * FRACTIONS
        P = P_in[:, None] * np.exp(rate[:, None] * turned)
        theta = (inclination + sense * first)[:, None] + sense[:, None] * turned
        weights = (radius * angle)[:, None] * WEIGHTS  # of ds
        e = strain(belt, P, curvature[:, None])
        friction, pressure = rate[:, None] * P / radius[:, None], P * curvature[:, None]
        force = friction[..., None] * unit(theta) + pressure[..., None] * normal(theta)
        slipping = belt.V_ref * (1 + e) - speed_in[:, None]
        return (
            np.sum(weights * friction, axis=1) * radius,
            np.sum(weights[..., None] * force, axis=1),
            np.sum(weights[..., None] * unit(theta), axis=1),
            np.sum(weights / (1 + e), axis=1),
            np.sum(weights * friction * slipping, axis=1),
        )

    still = sums(np.zeros_like(P_in), pulleys.adhesion, np.zeros_like(P_in))
    sliding = sums(pulleys.adhesion, pulleys.slip, rate)
    P_out = P_in * np.exp(rate * pulleys.slip)
    return Arcs(P_out, *(a + b for a, b in zip(still, sliding, strict=True)))


# All of it.


def balances(belt: BeltData, pulleys: PulleyData, spans: SpanData) -> Balances:
    """Residuals of every balance the answer should satisfy."""
    after, before = (lambda a: np.roll(a, -1, axis=0)), (lambda a: np.roll(a, 1, axis=0))
    rho, sense = pulleys.rho, np.sign(pulleys.rho)
    # A pulley without an arc touches at one point, where it only bounds the belt's curvature.
    wraps = pulleys.adhesion + pulleys.slip
    kappa = np.where(wraps > 0, 1 / rho, np.clip(rho * spans.curvature, 0.0, 1.0) / rho)
    given = spans.P, kappa, after(kappa), spans.inclination, spans.length
    shapes = [integrated_span(belt, *one) for one in zip(*given, strict=True)]
    found = Shape(*(np.array(column) for column in zip(*shapes, strict=True)))
    end_inclination = spans.inclination + found.turn
    P_in, entering = before(found.P_end), before(end_inclination)
    arcs = integrated_arcs(belt, pulleys, P_in, entering)

    # What the belt ahead of a section exerts, on the free span's side of the contact.
    shear_start, shear_end = -belt.EI * spans.curvature_slope, -belt.EI * found.slope_end
    force_start = spans.P[:, None] * unit(spans.inclination)
    force_end = found.P_end[:, None] * unit(end_inclination)
    sheared_start = shear_start[:, None] * normal(spans.inclination)
    sheared_end = shear_end[:, None] * normal(end_inclination)
    at_start, at_end = force_start + sheared_start, force_end + sheared_end
    axle = at_start - before(at_end)

    # The belt touches a pulley first and last with its shear: two forces through the center.
    edges = sheared_start - before(sheared_end)
    arm_out, arm_in = spans.position - pulleys.centers, before(spans.position + found.end)
    arm_in = arm_in - pulleys.centers
    moments = cross(arm_out, at_start) - cross(arm_in, before(at_end))
    moments = moments + belt.EI * (spans.curvature - kappa)

    foot = pulleys.centers - rho[:, None] * normal(spans.inclination)
    next_foot = after(pulleys.centers) - after(rho)[:, None] * normal(end_inclination)
    speeds = belt.V_ref * (1 + strain(belt, P_in, kappa)) / np.abs(rho)
    turning = np.sum(sense * wraps) + np.sum(found.turn)
    mismatch = entering + sense * wraps - spans.inclination
    return Balances(
        curvature=spans.curvature - kappa,
        curvature_slope=spans.curvature_slope - found.slope_start,
        start=spans.position - foot,
        end=spans.position + found.end - next_foot,
        gap=np.sum(found.end, axis=0) + np.sum(arcs.displacement, axis=0),
        inclination=(mismatch + np.pi) % (2 * np.pi) - np.pi,
        turning=abs(turning) - 2 * np.pi,
        P=arcs.P_out - spans.P,
        moments=sense * moments - pulleys.moments,
        friction_moments=arcs.friction_moment - pulleys.moments,
        pulley_forces=axle - edges - arcs.force,
        span_forces=at_end - at_start,
        span_moments=cross(found.end, at_end) + belt.EI * (after(kappa) - spans.curvature),
        unstretched_length=float(
            np.sum(found.unstretched) + np.sum(arcs.unstretched) - belt.unstretched_length
        ),
        power=float(-np.sum(pulleys.moments * speeds) - np.sum(arcs.loss)),
        friction_loss=float(np.sum(arcs.loss)),
        pulley_speeds=speeds,
        axle_forces=axle,
    )
