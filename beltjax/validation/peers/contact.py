"""Contact mechanics of chapter 5 the source's way: SciPy's `solve_bvp` inside root finders.

The peer of the closed-form elastica, and a second route to its numbers. Each free span is the
free-boundary problem of `span.py`; the tension where the belt enters the driver
is bracketed until the belt has its length (5.26), as the source does with MATLAB; the maximum
moment is bracketed around that. No JAX, no formula of an elastica except in first guesses.

Everything is written along the belt's travel, in SI: pulleys in the order in which the belt meets
them, span i from pulley i to the next, and signed radii, positive where a pulley turns the belt to
the left. P is the tension less the momentum flux, P = T - G V.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq, root

from beltjax.validation.peers.span import PeerSpan, UnsolvedError, bent_span, string_span

COLUMNS = ("length", "compliance", "start", "middle", "end", "angle_start", "angle_end")
ABSCISSAS, WEIGHTS = np.polynomial.legendre.leggauss(24)
NUDGE = 1e-4  # difference for the arm's derivatives, relative
TRIES = 60  # steps of a search for a bracket


@dataclass(frozen=True)
class Arm:
    """The tensioner arm that carries one of the pulleys."""

    pulley: int
    pivot: tuple[float, float]  # [m]
    stiffness: float  # [N m/rad]
    free_angle: float | None = None  # [rad] of arm direction; None: the drawn arm is at rest


@dataclass(frozen=True)
class PeerDrive:
    """A drive and its operation, along the travel.

    Give `tension` or `unstretched_length`, and two of the speeds: mass_per_length and
    belt_speed, mass_flow and driver_speed, or mass_per_length and driver_speed.
    """

    centers: np.ndarray  # [n, 2] [m]
    radii: np.ndarray  # [n] [m], signed
    moments: np.ndarray  # [n] [N m], taken from the belt; the driver's is not read
    friction: np.ndarray  # [n]
    bending_stiffness: float  # [N m^2]
    axial_stiffness: float  # [N]
    driver: int = 0
    tension: float | None = None  # [N], mean over the spans of the middle's, at rest
    unstretched_length: float | None = None  # [m]
    mass_per_length: float | None = None  # [kg/m], unstretched
    belt_speed: float | None = None  # [m/s], unstretched
    mass_flow: float | None = None  # [kg/s]
    driver_speed: float | None = None  # [rad/s], magnitude
    arm: Arm | None = None

    def balanced(self, factor: float = 1.0) -> np.ndarray:
        """All moments times `factor`, with the driver's."""
        moments = factor * np.asarray(self.moments, float)
        moments[self.driver] = 0.0
        radii = np.abs(self.radii)
        moments[self.driver] = -radii[self.driver] * np.sum(moments / radii)
        return moments


@dataclass(frozen=True)
class PeerState:
    """Answer; spans and pulleys in the order of the drive's."""

    lengths: np.ndarray  # [m]
    unstretched_lengths: np.ndarray  # [m]
    tension_start: np.ndarray  # T [N]
    tension_middle: np.ndarray  # T [N] at half the arc length
    tension_end: np.ndarray  # T [N]
    angle_start: np.ndarray  # [rad] from the line between the centers
    angle_end: np.ndarray  # [rad]
    wraps: np.ndarray  # [rad], negative where contact is lost
    slip: np.ndarray  # [rad]
    adhesion: np.ndarray  # [rad]
    moments: np.ndarray  # [N m] taken from the belt, the driver's too
    pulley_speeds: np.ndarray  # [rad/s], magnitudes
    efficiency: float  # power taken over power given
    unstretched_length: float  # [m], of the belt
    factor: float  # on all moments
    mass_flow: float  # G [kg/s]
    reference_speed: float  # V_ref [m/s]
    arm_angle: float | None  # [rad]
    free_angle: float | None  # [rad]
    spans: list[PeerSpan]
    closure: float  # P found back at the driver less P assumed there [N]


# One drive with the tension at its driver given.


@dataclass
class Chain:
    """A drive's spans, solved one after the other along the travel from the driver.

    Remembers them: the next call starts from the last one's.
    """

    drive: PeerDrive
    tol: float
    spans: list[PeerSpan | None] = field(init=False)

    def __post_init__(self):
        self.spans = [None] * len(self.drive.radii)

    def centers(self, arm_angle: float | None) -> np.ndarray:
        """Where the pulleys are [n, 2] [m]."""
        centers, arm = np.array(self.drive.centers, float), self.drive.arm
        if arm is not None and arm_angle is not None:
            reach = np.linalg.norm(centers[arm.pulley] - arm.pivot)
            direction = np.array([np.cos(arm_angle), np.sin(arm_angle)])
            centers[arm.pulley] = arm.pivot + reach * direction
        return centers

    def state(
        self,
        tension: float,
        moments: np.ndarray,
        *,
        flow: Callable[[float], tuple[float, float]] | None = None,
        arm_angle: float | None = None,
    ) -> PeerState:
        """Steady state in which the belt enters the driver with P = `tension`.

        `flow` gives (G, V_ref) from that tension; without it the belt is at rest.
        """
        drive, n = self.drive, len(self.drive.radii)
        centers, radii = self.centers(arm_angle), np.asarray(drive.radii, float)
        lines = np.roll(centers, -1, axis=0) - centers
        distances, spans = np.linalg.norm(lines, axis=1), list(self.spans)
        P = tension
        for k in range(n):
            i = (drive.driver + k) % n
            P = P + moments[i] / abs(radii[i])
            ends = radii[i], radii[(i + 1) % n], distances[i]
            span = spans[i] = self._span(P, ends, spans[i])
            P = span.end
        self.spans = spans
        G, V_ref = (0.0, 0.0) if flow is None else flow(tension)
        found = [span for span in spans if span is not None]
        return _put_together(drive, found, lines, moments, (G, V_ref), arm_angle, P - tension)

    def _span(self, P: float, ends: tuple, near: PeerSpan | None) -> PeerSpan:
        EI, EA = self.drive.bending_stiffness, self.drive.axial_stiffness
        if P <= 0:
            raise UnsolvedError("A span has lost its tension.")
        if EI == 0:
            return string_span(P, ends[0], ends[1], ends[2], EA)
        return bent_span(P, EI, ends[0], ends[1], ends[2], EA=EA, near=near, tol=self.tol)


def string_wraps(drive: PeerDrive, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles of the tangents from the lines between the centers, and wraps.

    These lie in (-90, 270) degrees, but for a large pulley beside a small one: the belt turns once.
    """
    radii = np.asarray(drive.radii, float)
    angles = -np.arcsin((np.roll(radii, -1) - radii) / np.linalg.norm(lines, axis=1))
    directions = np.arctan2(lines[:, 1], lines[:, 0]) + angles
    turns = np.sign(radii) * (directions - np.roll(directions, 1))
    wraps = np.mod(turns + np.pi / 2, 2 * np.pi) - np.pi / 2
    if abs(np.sum(np.sign(radii) * wraps)) < np.pi:
        wraps[np.argmin(wraps)] += 2 * np.pi
    return angles, wraps


def _put_together(
    drive: PeerDrive,
    spans: list[PeerSpan],
    lines: Any,
    moments: np.ndarray,
    flow: tuple[float, float],
    arm_angle: float | None,
    closure: float,
) -> PeerState:
    G, V_ref = flow
    EA, radii = drive.axial_stiffness, np.abs(drive.radii)
    each = {name: np.array([getattr(span, name) for span in spans]) for name in COLUMNS}
    strained = EA - G * V_ref  # 1 + T/EA = (EA + P)/strained
    tangents, wraps = string_wraps(drive, lines)
    leaving, entering = each["angle_start"] - tangents, np.roll(each["angle_end"] - tangents, 1)
    wraps = wraps + np.sign(drive.radii) * (leaving - entering)

    P_in, P_out = np.roll(each["end"], 1), each["start"]
    carries = np.asarray(moments) != 0
    rate = np.where(P_out > P_in, 1, -1) * np.asarray(drive.friction, float)
    slip = np.where(carries, np.log(P_out / P_in) / rate, 0.0)
    adhesion = wraps - slip
    # Over the slip angle P follows (5.10), P' = +-mu P; what it stretches is integrated.
    angles = np.outer(slip, (ABSCISSAS + 1) / 2)
    P_slip = P_in[:, None] * np.exp(rate[:, None] * angles)
    arcs = radii * (adhesion / (EA + P_in) + slip * ((1 / (EA + P_slip)) @ WEIGHTS) / 2)

    stretch_in = (EA + P_in) / strained
    others = np.arange(len(radii)) != drive.driver
    power = moments * stretch_in / radii
    taken = np.sum(power[others])
    return PeerState(
        lengths=each["length"],
        unstretched_lengths=strained * each["compliance"],
        tension_start=EA * ((EA + each["start"]) / strained - 1),
        tension_middle=EA * ((EA + each["middle"]) / strained - 1),
        tension_end=EA * ((EA + each["end"]) / strained - 1),
        angle_start=each["angle_start"],
        angle_end=each["angle_end"],
        wraps=wraps,
        slip=slip,
        adhesion=adhesion,
        moments=moments,
        pulley_speeds=V_ref * stretch_in / radii,
        efficiency=taken / -power[drive.driver] if taken != 0 else np.nan,
        unstretched_length=strained * float(np.sum(each["compliance"]) + np.sum(arcs)),
        factor=1.0,
        mass_flow=G,
        reference_speed=V_ref,
        arm_angle=arm_angle,
        free_angle=None,
        spans=spans,
        closure=closure,
    )


def arm_moment(drive: PeerDrive, state: PeerState, centers: np.ndarray) -> float:
    """Moment of the belt about the arm's pivot [N m]."""
    arm = drive.arm
    assert arm is not None
    before = (arm.pulley - 1) % len(centers)
    lines = np.roll(centers, -1, axis=0) - centers
    pull = []
    for i in (arm.pulley, before):
        ex = lines[i] / np.linalg.norm(lines[i])
        along, across = state.spans[i].force
        pull.append(along * ex + across * np.array([-ex[1], ex[0]]))
    lever, force = centers[arm.pulley] - arm.pivot, pull[0] - pull[1]
    return float(lever[0] * force[1] - lever[1] * force[0])


def flow_rule(drive: PeerDrive) -> Callable[[float], tuple[float, float]]:
    """(G, V_ref) from P where the belt enters the driver, which has that belt's speed."""
    EA, m0, c = drive.axial_stiffness, drive.mass_per_length, drive.belt_speed
    if c is not None:
        assert m0 is not None
        return lambda P: (m0 * c, c)
    assert drive.driver_speed is not None
    V, G = drive.driver_speed * abs(drive.radii[drive.driver]), drive.mass_flow
    if G is not None:  # V = V_ref (1 + T/EA), T = P + G V
        return lambda P: (G, V * EA / (EA + P + G * V))
    assert m0 is not None

    def of_mass(P: Any) -> Any:  # the same with G = m0 V_ref: quadratic in V_ref
        b = EA + P
        V_ref = 2 * V * EA / (b + np.sqrt(b**2 + 4 * m0 * EA * V**2))
        return m0 * V_ref, V_ref

    return of_mass


# One belt.


def bracketed(function: Callable[[float], float], guess: float, slope: float, tol: float) -> float:
    """Root of a monotone function near `guess`; `slope` is about its derivative.

    Where the function cannot be evaluated the search turns back half way.
    """
    a, fa = guess, function(guess)
    least = 4 * tol * abs(a)
    step = -np.sign(fa / slope) * max(abs(fa / slope), least)
    for _ in range(TRIES):
        b = a + step
        try:
            fb = function(b)
        except UnsolvedError:
            step /= 2
            continue
        if fa * fb <= 0:
            return _brent(function, (a, fa), (b, fb), tol)
        secant = (b - a) / (fa - fb) * fb if fa != fb else step
        step = np.sign(secant) * np.clip(1.5 * abs(secant), least, 4 * abs(step))
        a, fa = b, fb
    raise UnsolvedError("No bracket found.")


def _brent(
    function: Callable[[float], float], a: tuple[float, float], b: tuple[float, float], tol: float
) -> float:
    if a[1] == 0 or b[1] == 0:
        return a[0] if a[1] == 0 else b[0]
    known = dict((a, b))  # brentq evaluates both again

    def once(x: float) -> float:
        return known.pop(x) if x in known else function(x)

    size = abs(a[0]) + abs(b[0])
    return brentq(once, a[0], b[0], xtol=tol * size, rtol=max(tol, 1e-15))  # pyright: ignore


def rest_state(drive: PeerDrive, tol: float = 1e-6, root_tol: float = 1e-6) -> PeerState:
    """The drawn drive at rest without moments, under `drive.tension`."""
    assert drive.tension is not None
    chain, none = Chain(drive, tol), np.zeros(len(drive.radii))
    angle = drawn_angle(drive)

    states = {}

    def surplus(P: float) -> float:
        states[P] = chain.state(P, none, arm_angle=angle)
        return np.mean(states[P].tension_middle) - drive.tension

    return states[bracketed(surplus, drive.tension, 1.0, root_tol)]


def drawn_angle(drive: PeerDrive) -> float | None:
    """Direction of the drawn arm [rad]."""
    if drive.arm is None:
        return None
    x, y = np.asarray(drive.centers[drive.arm.pulley]) - drive.arm.pivot
    return float(np.arctan2(y, x))


@dataclass
class PeerBelt:
    """A drive whose belt's unstretched length and arm's free angle are known.

    Remembers its last state: a neighbor starts from it.
    """

    drive: PeerDrive
    tol: float = 1e-6
    root_tol: float = 1e-6
    chain: Chain = field(init=False)
    length: float = field(init=False)
    free_angle: float | None = field(init=False)
    level: float = field(init=False)  # P at the driver, last found, with moments' share taken off
    angle: float | None = field(init=False)

    def __post_init__(self):
        drive = self.drive
        self.chain = Chain(drive, self.tol)
        self.angle = drawn_angle(drive)
        self.free_angle = drive.arm.free_angle if drive.arm else None
        if drive.tension is not None:
            rest = rest_state(drive, self.tol, self.root_tol)
            self.chain.spans = list(rest.spans)
            self.length, self.level = rest.unstretched_length, rest.spans[drive.driver - 1].end
            if drive.arm is not None and self.free_angle is None:
                moment = arm_moment(drive, rest, self.chain.centers(self.angle))
                assert self.angle is not None
                self.free_angle = self.angle - moment / drive.arm.stiffness
        else:
            assert drive.unstretched_length is not None
            self.length = drive.unstretched_length
            self.level = self._first_level()

    def _first_level(self) -> float:
        """A tension to begin with: of a string, or enough to bend the belt round its pulleys."""
        centers = self.chain.centers(self.angle)
        lines = np.roll(centers, -1, axis=0) - centers
        tangents, wraps = string_wraps(self.drive, lines)
        path = np.sum(np.linalg.norm(lines, axis=1) * np.cos(tangents))
        path += np.sum(np.abs(self.drive.radii) * wraps)
        bending = self.drive.bending_stiffness / np.min(np.abs(self.drive.radii)) ** 2
        return max(self.drive.axial_stiffness * (path / self.length - 1), 2 * bending, 1e-3)

    def running(self, factor: float = 1.0) -> PeerState:
        """Steady state with all moments times `factor`."""
        moments = self.drive.balanced(factor)
        solve = self._locked if self.drive.arm is None else self._with_arm
        state = solve(moments, flow_rule(self.drive))
        return replace(state, factor=factor, free_angle=self.free_angle)

    def _span_shares(self, moments: np.ndarray) -> float:
        """Mean over the spans of P less P where the belt enters the driver."""
        along = np.roll(moments / np.abs(self.drive.radii), -self.drive.driver)
        return float(np.mean(np.cumsum(along)))

    def _locked(
        self, moments: np.ndarray, flow: Callable[[float], tuple[float, float]] | None
    ) -> PeerState:
        EA, share = self.drive.axial_stiffness, self._span_shares(moments)
        states = {}

        def shortage(P: float) -> float:
            states[P] = self.chain.state(P, moments, flow=flow)
            return (states[P].unstretched_length / self.length - 1) * EA

        P = bracketed(shortage, self.level - share, -1.0, self.root_tol)
        self.level = P + share
        return states[P]

    def _with_arm(
        self, moments: np.ndarray, flow: Callable[[float], tuple[float, float]] | None
    ) -> PeerState:
        drive, share = self.drive, self._span_shares(moments)
        EA, arm = drive.axial_stiffness, drive.arm
        assert arm is not None
        assert self.free_angle is not None
        assert self.angle is not None
        lever = np.linalg.norm(np.asarray(drive.centers[arm.pulley]) - arm.pivot)
        scale = max(self.level, 1e-3)

        def residual(unknown: np.ndarray) -> list[float]:
            angle, P = unknown[0], scale * unknown[1]
            state = self.chain.state(P, moments, flow=flow, arm_angle=angle)
            moment = arm_moment(drive, state, self.chain.centers(angle))
            turn = moment - arm.stiffness * (angle - self.free_angle)
            return [
                turn / (scale * lever),
                (state.unstretched_length / self.length - 1) * EA / scale,
            ]

        start = [self.angle, (self.level - share) / scale]
        found = root(residual, start, tol=self.root_tol, options={"eps": NUDGE**2})
        if not found.success:
            raise UnsolvedError(f"Arm: {found.message}")
        self.angle, P = float(found.x[0]), float(scale * found.x[1])
        self.level = P + share
        return self.chain.state(P, moments, flow=flow, arm_angle=self.angle)


def contact_state(drive: PeerDrive, tol: float = 1e-6, root_tol: float = 1e-6) -> PeerState:
    """The regular moment problem; `tol` is `solve_bvp`'s, `root_tol` that of what is bracketed.

    Lengths are good to about tol^(4/3), so that a root may be wanted more closely.
    """
    return PeerBelt(drive, tol, root_tol).running()


def maximum_moment(
    drive: PeerDrive, tol: float = 1e-6, root_tol: float = 1e-6, *, first: float = 1.0
) -> PeerState:
    """The state in which all moments are as much larger as the first pulley to slip allows.

    `first` is the factor to begin with.
    """
    belt = PeerBelt(drive, tol, root_tol)
    carries = drive.balanced() != 0

    def margin(factor: float) -> float:
        return float(np.min(belt.running(factor).adhesion[carries]))

    low, high = (0.0, np.nan), (np.nan, np.nan)
    factor = first
    for _ in range(TRIES):
        try:
            value = margin(factor)
        except UnsolvedError:
            high = (factor, np.nan)
        else:
            low, high = ((factor, value), high) if value >= 0 else (low, (factor, value))
        if low[1] >= 0 and high[1] < 0:
            return belt.running(_brent(margin, low, high, root_tol))
        factor = 1.5 * low[0] if np.isnan(high[0]) else (low[0] + high[0]) / 2
    raise UnsolvedError("No factor found at which a pulley slips all round.")
