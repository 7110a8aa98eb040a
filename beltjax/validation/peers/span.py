"""One free span of chapter 5 by SciPy: the free-boundary problem (5.16)-(5.21) in standard form.

In SI, in the frame of its pulleys, x from center to center; signed radii are positive where a
pulley turns the belt to the left, and P is the tension less the momentum flux, T - G V. No JAX,
and no formula of an elastica except in first guesses.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_bvp

MAX_NODES = 20_000
START = 120  # nodes of a first mesh, about


class UnsolvedError(RuntimeError):
    """A span, a bracket or an arm angle was not found."""


class PeerSpan(NamedTuple):
    """A free span in the frame of its pulleys: x from center to center."""

    length: float  # [m]
    compliance: float  # integral of ds/(EA + P) [m/N]
    start: float  # P where it begins [N]
    middle: float  # P at half the arc length [N]
    end: float  # P where it ends [N]
    angle_start: float  # [rad]
    angle_end: float  # [rad]
    force: np.ndarray  # [2] [N], what the belt ahead exerts, momentum flux included
    mesh: np.ndarray | None = None  # what a neighbor may start from: `solve_bvp`'s x and y
    states: np.ndarray | None = None


def string_span(tension: float, rho_start: float, rho_end: float, d: float, EA: float) -> PeerSpan:
    """A span without bending stiffness."""
    angle = -np.arcsin((rho_end - rho_start) / d)
    length = d * np.cos(angle)
    force = tension * np.array([np.cos(angle), np.sin(angle)])
    compliance = length / (EA + tension)
    return PeerSpan(length, compliance, tension, tension, tension, angle, angle, force)


def first_shape(
    tension: float, EI: float, rho_start: float, rho_end: float, d: float
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and states of a tangent bent at its ends: layers of thickness sqrt(EI/C)."""
    C = tension + EI / (2 * rho_start**2)
    rate = np.sqrt(C / EI)
    turn = [2 * np.arcsin(min(0.7, 1 / (2 * rate * abs(rho)))) for rho in (rho_start, rho_end)]
    angle = -np.arcsin((rho_end - rho_start) / d)
    bulge = sum(abs(rho) * np.sin(t) for rho, t in zip((rho_start, rho_end), turn, strict=True))
    length = d * np.cos(angle) + bulge
    rate = rate * length
    layer = np.linspace(0, 1, 30) ** 2 * min(0.5, 6 / rate)
    x = np.unique(np.concatenate([layer, 1 - layer, np.linspace(0, 1, 31)]))

    near, far = (np.sinh(np.minimum(rate, 300) * t) / np.sinh(min(rate, 300)) for t in (1 - x, x))
    kappa = length * (near / rho_start + far / rho_end)
    theta = cumulative_trapezoid(kappa, x, initial=0)
    # Turned so that the inclinations at the two ends miss the tangent's by like amounts.
    theta += angle - (theta[0] * abs(rho_end) + theta[-1] * abs(rho_start)) / (
        abs(rho_start) + abs(rho_end)
    )
    along, across = (
        cumulative_trapezoid(f(theta), x, initial=0) + rho_start * s / length
        for f, s in ((np.cos, np.sin(theta[0])), (np.sin, -np.cos(theta[0])))
    )
    pull = np.full_like(x, tension * length**2 / EI) + (kappa[0] ** 2 - kappa**2) / 2
    states = [pull, kappa, np.gradient(kappa, x), theta, along, across, np.full_like(x, length), x]
    return x, np.array(states)


class StandardForm(NamedTuple):
    """(5.16)-(5.21) on [0, 1] for the states p, k, k', theta, x, y, L and the elongation.

    The elongation, the integral of P/(1 + P/EA) in units of the tension given, is integrated
    rather than the unstretched length: a tolerance on it is one on the strain. The solver sees
    all of it in `units`, which halves the nodes: its tolerance is absolute for what is small.
    """

    tension: float
    EI: float
    rho_start: float
    rho_end: float
    d: float
    EA: float

    @property
    def units(self) -> np.ndarray:
        """Sizes of the states [8]."""
        stiff = self.tension * self.d**2 / self.EI + (self.d / self.rho_start) ** 2 / 2
        bend = self.d / min(abs(self.rho_start), abs(self.rho_end))
        return np.array([stiff, bend, bend * np.sqrt(stiff), 1.0, 1.0, 1.0, self.d, 1.0])

    def solve(
        self, x: np.ndarray, y: np.ndarray, tol: float
    ) -> tuple[bool, np.ndarray, np.ndarray, Any]:
        """SciPy's solution from the states y at x, with the states' units taken back."""
        S = self.units
        ends = np.array([S[0], S[1], S[1], 1.0, 1.0, 1.0, 1.0, 1.0])
        found = solve_bvp(
            lambda x, y: self.rhs(x, S[:, None] * y) / S[:, None],
            lambda a, b: self.bc(S * a, S * b) / ends,
            x,
            y / S[:, None],
            fun_jac=lambda x, y: self.rhs_slope(x, S[:, None] * y) * (S / S[:, None])[:, :, None],
            bc_jac=lambda a, b: (A * S / ends[:, None] for A in self.bc_slope(S * a, S * b)),
            tol=tol,
            max_nodes=MAX_NODES,
        )
        middle = S * found.sol(0.5)
        return found.success and found.y[6, 0] > 0, found.x, S[:, None] * found.y, middle

    def rhs(self, _: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(5.16), (5.18), (5.19) and the elongation."""
        p, k, q, th, _, _, L, _ = y
        strain = p * self.EI / L**2 / self.EA
        slope = strain / (1 + strain) * self.EA / self.tension
        return np.array([-k * q, q, p * k, k, np.cos(th), np.sin(th), 0 * L, slope])

    def rhs_slope(self, _: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Derivative of `rhs` [8, 8, m]."""
        p, k, q, th, _, _, L, _ = y
        strain = p * self.EI / L**2 / self.EA
        steep = self.EA / self.tension / (1 + strain) ** 2
        A = np.zeros((8, 8, p.size))
        A[0, 1], A[0, 2] = -q, -k
        A[1, 2] = 1.0
        A[2, 0], A[2, 1] = k, p
        A[3, 1] = 1.0
        A[4, 3], A[5, 3] = -np.sin(th), np.cos(th)
        A[7, 0], A[7, 6] = steep * strain / p, -2 * steep * strain / L
        return A

    def bc(self, ya: np.ndarray, yb: np.ndarray) -> np.ndarray:
        """(5.17), (5.20) and, as a vector, (5.21)."""
        La, Lb = ya[6] / self.d, yb[6] / self.d
        a, b = self.rho_start / self.d, self.rho_end / self.d
        return np.array(
            [
                ya[0] - self.tension * ya[6] ** 2 / self.EI,
                ya[1] - La / a,
                yb[1] - Lb / b,
                La * ya[4] - a * np.sin(ya[3]),
                La * ya[5] + a * np.cos(ya[3]),
                Lb * yb[4] - 1.0 - b * np.sin(yb[3]),
                Lb * yb[5] + b * np.cos(yb[3]),
                ya[7],
            ]
        )

    def bc_slope(self, ya: np.ndarray, yb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `bc` with respect to both ends."""
        La, Lb = ya[6] / self.d, yb[6] / self.d
        a, b = self.rho_start / self.d, self.rho_end / self.d
        A, B = np.zeros((8, 8)), np.zeros((8, 8))
        A[0, 0], A[0, 6] = 1.0, -2 * self.tension * ya[6] / self.EI
        A[1, 1], A[1, 6] = 1.0, -1 / self.rho_start
        B[2, 1], B[2, 6] = 1.0, -1 / self.rho_end
        A[3, 4], A[3, 3], A[3, 6] = La, -a * np.cos(ya[3]), ya[4] / self.d
        A[4, 5], A[4, 3], A[4, 6] = La, -a * np.sin(ya[3]), ya[5] / self.d
        B[5, 4], B[5, 3], B[5, 6] = Lb, -b * np.cos(yb[3]), yb[4] / self.d
        B[6, 5], B[6, 3], B[6, 6] = Lb, -b * np.sin(yb[3]), yb[5] / self.d
        A[7, 7] = 1.0
        return A, B


def bent_span(
    tension: float,
    EI: float,
    rho_start: float,
    rho_end: float,
    d: float,
    *,
    EA: float = np.inf,
    near: PeerSpan | None = None,
    tol: float = 1e-6,
) -> PeerSpan:
    """The span that begins with P = `tension`, from a span `near` it where there is one."""
    form = StandardForm(tension, EI, rho_start, rho_end, d, EA if np.isfinite(EA) else 1e300)
    starts = [first_shape(tension, EI, rho_start, rho_end, d)]
    if near is not None and near.mesh is not None and near.states is not None:
        every = -(-near.mesh.size // START)  # thinned: SciPy only ever adds nodes
        keep = np.unique(np.append(np.arange(0, near.mesh.size, every), near.mesh.size - 1))
        starts.insert(0, (near.mesh[keep], near.states[:, keep]))
    for x, y in starts:
        success, x, y, middle = form.solve(x, y, tol)
        if success:
            return _as_span(form, x, y, middle)
    raise UnsolvedError(f"No span that begins with a tension of {tension} N found.")


def _as_span(form: StandardForm, x: np.ndarray, y: np.ndarray, middle: Any) -> PeerSpan:
    start, end = y[:, 0], y[:, -1]
    L = start[6]
    P = [form.EI * y[0] / L**2 for y in (start, middle, end)]
    shear = -form.EI * start[2] / L**2
    c, s = np.cos(start[3]), np.sin(start[3])
    force = np.array([P[0] * c - shear * s, P[0] * s + shear * c])
    compliance = L / form.EA * (1 - form.tension / form.EA * end[7])
    return PeerSpan(L, compliance, P[0], P[1], P[2], start[3], end[3], force, x, y)
