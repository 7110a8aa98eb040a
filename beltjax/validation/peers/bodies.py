"""Statics of a drive with movable bodies in NumPy and SciPy, one drive at a time.

Points are complex numbers. Bodies are posed one after the other, forces stand at the points where
the belts touch, what the bodies change is found by differences of positions, and the running state
by differences of a potential.
"""

import itertools
from collections.abc import Mapping

import numpy as np
from scipy.optimize import root

Array = np.ndarray
Complex = np.ndarray
STEP = 1e-3  # of differences by a coordinate, in rad or in 0.1 m
# Twelve-point Gauss rule on panels that get smaller towards the ends of a span.
_X, _W = np.polynomial.legendre.leggauss(12)
_EDGES = np.unique(np.concatenate([0.5 ** np.arange(1, 14), 1 - 0.5 ** np.arange(1, 14), [0, 1]]))
_HALF = np.diff(_EDGES) / 2
POINTS = ((_EDGES[1:] + _EDGES[:-1])[:, None] / 2 + _HALF[:, None] * _X).ravel()
WEIGHTS = (_HALF[:, None] * _W).ravel()


def cross(a: Complex, b: Complex) -> Array:
    """The component of a x b along the axis of rotation."""
    return np.imag(np.conj(a) * b)


class Statics:
    """One drive: its geometry, the forces on its parts, and the potential of its running state."""

    def __init__(self, numbers: Mapping[str, Array], loops: tuple[int, ...], shaft: int = 0):
        a = self.numbers = {name: np.asarray(value, float) for name, value in numbers.items()}
        self.z, self.pivots, self.along = (
            a[key][:, 0] + 1j * a[key][:, 1] for key in ("centers", "pivots", "directions")
        )
        self.radii, self.faces, self.kind = a["radii"], a["faces"], a["kind"]
        self.on, self.seat, self.locked = a["on"], a["seat"], a["locked"]
        self.stops = a["stops"]
        self.k, self.n = len(self.kind), len(self.radii)
        self.belt = np.repeat(np.arange(len(loops)), loops)
        self.sense = a["sense"][self.belt]
        starts = np.cumsum([0, *loops])
        self.next = np.arange(self.n) + 1
        self.next[starts[1:] - 1] = starts[:-1]
        self.before = np.argsort(self.next)
        self.EA, self.EI = a["EA"], a["EI"]
        self.rows = np.concatenate([np.eye(self.k), a["between"]])
        self.rates = np.concatenate([a["stiffness"], a["rates"]])
        self.spring = np.einsum("s,sa,sb->ab", self.rates, self.rows, self.rows)
        self.unit = np.where(self.kind > 0, 1.0, 0.1)
        # Bodies above each body, itself among them.
        self.above = np.linalg.inv(np.eye(self.k) - self.seat.T) > 0.5
        self.carried = (self.on @ self.above.T) > 0.5
        self._load(loops, shaft)

    def _load(self, loops: tuple[int, ...], shaft: int) -> None:
        a = self.numbers
        self.housed = a["housed"]
        # All pulleys of a shaft turn alike; the belt of the second follows.
        speeds, travels = [a["speed"]], [a["travel"]]
        if len(loops) > 1:
            first, second = shaft, loops[0]
            turn = a["travel"] * self.faces[first] * self.sense[first]
            travels.append(turn * self.faces[second] * self.sense[second])
            speeds.append(a["speed"] * self.radii[second] / self.radii[first])
        self.speeds, self.travel = np.array(speeds), np.array(travels)[self.belt]
        self.momentum = (a["mass"] * self.speeds**2)[self.belt]
        # On each belt one pulley gives what the others take, and a shaft passes it on.
        taken = a["torques"].copy()
        for b in reversed(range(len(self.EA))):
            gives = int(np.argmax(self.belt == b))
            others = (self.belt == b) & (np.arange(self.n) != gives)
            taken[gives] = -self.radii[gives] * np.sum((taken / self.radii)[others])
            if b > 0 and shaft > 0:
                taken[shaft] -= taken[gives]
        self.taken = taken

    def spread(self, of_belts: Array) -> Array:
        """To every span what belongs to its belt."""
        return np.asarray(of_belts)[self.belt]

    def sums(self, of_spans: Array) -> Array:
        """Sums over the spans of each belt."""
        return np.array([of_spans[self.belt == b].sum(axis=0) for b in range(len(self.EA))])

    def pose(self, q: Array) -> tuple[Complex, Complex, Complex]:
        """Centers of the pulleys, pivots and directions of the bodies, at coordinates q."""
        z, pivots, along = self.z.copy(), self.pivots.copy(), self.along.copy()
        # The uppermost body first, as drawn; then what it sits on takes it along.
        for b in reversed(range(self.k)):
            rides = self.above[b].copy()
            rides[b] = False
            if self.kind[b]:
                turn, center = np.exp(1j * q[b]), self.pivots[b]
                z = np.where(self.carried[:, b], center + (z - center) * turn, z)
                pivots = np.where(rides, center + (pivots - center) * turn, pivots)
                along = np.where(rides, along * turn, along)
            else:
                z = z + self.carried[:, b] * q[b] * self.along[b]
                pivots = pivots + rides * q[b] * self.along[b]
        return z, pivots, along

    def path(self, q: Array) -> tuple[Array, Complex, Array, Complex]:
        """Lengths and directions of the spans, wraps, and centers of the pulleys."""
        z, _, _ = self.pose(q)
        signed = self.faces * self.radii * self.sense
        apart, rise = z[self.next] - z, signed[self.next] - signed
        with np.errstate(invalid="ignore", divide="ignore"):  # where there is no tangent
            lengths = np.sqrt(np.abs(apart) ** 2 - rise**2)
            e = apart * (lengths - 1j * rise) / np.abs(apart) ** 2
            wraps = self.faces * self.sense * np.angle(e / e[self.before])
        wraps = np.where(wraps < -np.pi / 2, wraps + 2 * np.pi, wraps)
        for b in range(len(self.EA)):
            own = np.flatnonzero(self.belt == b)
            if abs(self.faces[own] @ wraps[own]) < 1.0:
                least = own[np.argmin(wraps[own])]
                wraps[least] += 2 * np.pi * (self.faces[least] > 0)
        return lengths, e, wraps, z

    def possible(self, q: Array) -> bool:
        """Whether the belts lie on all their pulleys and go round once."""
        lengths, e, wraps, z = self.path(q)
        if not np.all(np.isfinite(lengths)) or wraps.min() <= 0:
            return False
        if np.any(np.abs(self.sums(self.faces * wraps) - 2 * np.pi) > 1e-6):
            return False
        start = z - self.faces * self.radii * 1j * self.sense * e
        along = lengths * e
        for i, j in itertools.combinations(range(self.n), 2):
            if self.belt[i] == self.belt[j]:
                apart = start[j] - start[i]
                ends = [cross(along[i], apart), cross(along[i], apart + along[j])]
                others = [cross(along[j], -apart), cross(along[j], along[i] - apart)]
                if np.prod(ends) < 0 and np.prod(others) < 0:
                    return False
        return True

    def unstretched(self, q: Array, P: Array) -> Array:
        """Unstretched length of each belt on the path at tensions P."""
        lengths, _, wraps, _ = self.path(q)
        strain = P / self.spread(self.EA)
        arcs = self.radii * wraps / (1 + (strain + strain[self.before]) / 2)
        return self.sums(lengths / (1 + strain) + arcs)

    def _on_pulleys(self, q: Array, P: Array) -> tuple[Complex, Complex, Array]:
        """Centers, forces of the belts where they touch, and their moments about the centers."""
        _, e, _, z = self.path(q)
        arm, pulled = -self.faces * self.radii * 1j * self.sense, P * e
        leaves, meets = arm * e, arm * e[self.before]
        back = -pulled[self.before]
        return z, pulled + back, cross(leaves, pulled) + cross(meets, back)

    def torques(self, q: Array, P: Array) -> Array:
        """Torque by which the belts turn the rotors, in their direction of rotation."""
        _, _, moment = self._on_pulleys(q, P)
        return moment * self.travel * self.faces * self.sense

    def forces(self, q: Array, P: Array, free: Array) -> Array:
        """What belts, housings and springs do to each body [N m] or [N]: 0 where it is free."""
        z, force, on_rotor = self._on_pulleys(q, P)
        _, pivots, along = self.pose(q)
        # A bearing passes the force on, a housing that is bolted to the body the moment as well.
        found = np.zeros(self.k)
        for b in range(self.k):
            on = self.carried[:, b]
            if self.kind[b]:
                found[b] = np.sum(on * (cross(z - pivots[b], force) + self.housed * on_rotor))
            else:
                found[b] = np.sum(on * np.real(np.conj(along[b]) * force))
        return found - self.rows.T @ (self.rates * (self.rows @ q - free))

    def _positions(self, q: Array, a: int | None = None, b: int | None = None) -> Complex:
        """Centers, or their differences by one or two coordinates, to sixth order."""
        if a is None:
            return self.pose(q)[0]
        total = 0.0
        for by, weight in ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60)):
            step = np.zeros(self.k)
            step[a] = by * 10 * STEP * self.unit[a]
            up, down = (self._positions(q + sign * step, b) for sign in (1, -1))
            total = total + weight * (up - down)
        return total / (10 * STEP * self.unit[a])

    def pulls(self, q: Array, P: Array) -> Array:
        """By which each span resists each body: tension times elongation by the coordinate."""
        _, e, _, _ = self.path(q)
        moved = np.array([self._positions(q, a) for a in range(self.k)]).reshape(self.k, self.n)
        apart = moved[:, self.next] - moved
        return (P * np.real(np.conj(e) * apart)).T

    def motion(self, q: Array) -> tuple[Array, Array, Array, Array]:
        """S, turn of the chord, and H of each span, by differences of positions."""
        lengths, e, _, _ = self.path(q)
        k, n = self.k, self.n
        once = np.array([self._positions(q, a) for a in range(k)]).reshape(k, n)
        pairs = [[self._positions(q, a, b) for b in range(k)] for a in range(k)]
        twice = np.array(pairs).reshape(k, k, n)
        apart, bent = once[:, self.next] - once, twice[..., self.next] - twice
        S = np.real(np.conj(e) * apart).T
        a = (self.sense * cross(e, apart) / lengths).T
        H = np.moveaxis(np.real(np.conj(e) * bent), -1, 0)
        return lengths, S, a, H

    def exact_stiffness(self, q: Array, P: Array) -> Array:
        """Hessian of the potential of springs and strings at rest, by the coordinates."""
        lengths, S, a, H = self.motion(q)
        whole = lengths[:, None, None] * a[:, :, None] * a[:, None, :] + H
        _, _, wraps, _ = self.path(q)
        rates = self.EA / self.sums(lengths + self.radii * wraps)
        by_belt = self.sums(S)
        stretching = np.einsum("b,ba,bc->ac", rates, by_belt, by_belt)
        return self.spring + np.einsum("s,sab->ab", P, whole) + stretching

    def held_as_drawn(self) -> tuple[Array, Array]:
        """Lengths of the belts, and where the own spring of each body is relaxed, by the tension.

        The drawn layout is then at rest without torques. Every body has a spring or is bolted.
        """
        still, tension = np.zeros(self.k), self.spread(self.numbers["tension"])
        pull, own = self.pulls(still, tension).sum(axis=0), self.rates[: self.k]
        relaxed = np.where(own > 0, pull / np.where(own > 0, own, 1.0), 0.0)
        between = np.zeros(len(self.rates) - self.k)
        return self.unstretched(still, tension), np.concatenate([relaxed, between])

    def at_rest(
        self, lengths: Array, free: Array, taken: Array, guess: Array
    ) -> tuple[Array, Array] | None:
        """Coordinates and span tensions with these torques, if a search from `guess` finds them.

        `guess` is of the coordinates over `unit`.
        """
        rises, belts = self.travel * taken / self.radii, range(len(self.EA))
        offsets = np.concatenate([np.cumsum(rises[self.belt == b]) for b in belts])
        level = np.mean(self.numbers["tension"])
        size, k = level * self.unit, self.k

        def state(unknown: Array) -> tuple[Array, Array]:
            return unknown[:k] * self.unit, offsets + self.spread(unknown[k:] * level)

        def equations(unknown: Array) -> Array:
            q, P = state(unknown)
            push = self.forces(q, P, free) / size
            wanted = np.clip(q + push * self.unit, self.stops[:, 0], self.stops[:, 1])
            rest = np.where(self.locked > 0, q, q - wanted) / self.unit
            return np.concatenate([rest, 100 * (self.unstretched(q, P) / lengths - 1)])

        with np.errstate(all="ignore"):
            try:
                end = root(equations, np.concatenate([guess, np.ones(len(belts))]), tol=1e-12)
            except (ValueError, np.linalg.LinAlgError):  # the path has ceased to be
                return None
            return state(end.x) if np.abs(equations(end.x)).max() < 1e-9 else None

    def floats(self) -> Array:
        """Bodies that no chain of springs holds to the ground or to a bolted one."""
        held = self.locked > 0
        reached = held.copy()
        for _ in range(self.k + 1):
            for row, rate in zip(self.rows, self.rates, strict=True):
                ends = np.flatnonzero(row)
                if rate > 0 and (len(ends) == 1 or reached[ends].any()):
                    reached[ends] = True
        return ~reached & ~held


class Bending:
    """The linear equations of the running belts about a state of strings: a potential.

    `loads` are the forces on the elongations that the state does not balance yet, `Q0` the
    effective tensions there, `give` the length of each belt that stretches, `rho` what stops carry.
    """

    def __init__(
        self, statics: Statics, at: Array, Q0: Array, flux: Array, give: Array, rho: Array
    ):
        self.statics, self.Q0, self.flux, self.rho = statics, Q0, flux, rho
        self.give = give / statics.EA
        self.lengths, self.S, self.a, H = statics.motion(at)
        floats = statics.floats()
        counted = (statics.numbers["curvature"] > 0) | floats[:, None] | floats
        self.H = H * counted
        bent = statics.faces / statics.radii
        self.start, self.end = bent, bent[statics.next]
        self.EI = statics.spread(statics.EI)
        self.lo, self.hi = statics.stops[:, 0] - at, statics.stops[:, 1] - at
        self.free = statics.locked == 0
        self._shaped: tuple[Array, tuple[Array, Array]] | None = None  # the last T and its shape

    def shape(self, T: Array) -> tuple[Array, Array]:
        """Slope of each span beside its chord, and its curvature, at the points of the rule."""
        if self._shaped is None or np.any(self._shaped[0] != T):
            self._shaped = np.array(T), self._shape(T)
        return self._shaped[1]

    def _shape(self, T: Array) -> tuple[Array, Array]:
        Q, along = self.Q0 + self.statics.spread(T), self.lengths
        with np.errstate(invalid="ignore", divide="ignore"):
            k = (along * np.sqrt(Q / self.EI))[:, None]
        x = POINTS
        # w'' = (start sinh(k(1 - x)) + end sinh(k x)) / sinh(k), written so that nothing grows.
        decay = 1 - np.exp(-2 * k)
        far, near = ((np.exp(-k * (1 - y)) - np.exp(-k * (1 + y))) / decay for y in (x, 1 - x))
        far_c, near_c = ((np.exp(-k * (1 - y)) + np.exp(-k * (1 + y))) / decay for y in (x, 1 - x))
        start, end = self.start[:, None], self.end[:, None]
        curvature = start * near + end * far
        slope = (end * far_c - start * near_c) / k + (start - end) / k**2
        return slope * along[:, None], curvature

    def elongation(self, q: Array, T: Array) -> Array:
        """By which the spans of each belt become longer, beside what the chords stretch."""
        slope = self.a @ q
        bent, _ = self.shape(T)
        wavy = self.lengths * ((bent + slope[:, None]) ** 2 @ WEIGHTS) / 2
        each = self.S @ q + np.einsum("sab,a,b->s", self.H, q, q) / 2 + wavy
        return self.statics.sums(each)

    def residual(self, q: Array, T: Array) -> Array:
        """Stretch of the belts by tension less that by geometry [m]."""
        return self.give * T - self.elongation(q, T)

    def potential(self, q: Array, T: Array) -> float:
        """Energy of springs and spans, their elongations under given forces [J]."""
        P = self.statics
        Q, slope = self.Q0 + P.spread(T), self.a @ q
        bent, curvature = self.shape(T)
        around = bent + slope[:, None]
        squares = self.lengths * (around**2 @ WEIGHTS)
        curved = self.lengths * (curvature**2 @ WEIGHTS)
        ends = self._ends(T) + slope
        work = self.EI * (self.end * ends[1] - self.start * ends[0])
        moved = P.spread(T) - self.flux
        quadratic = np.einsum("sab,a,b->s", self.H, q, q)
        spans = moved * (self.S @ q) + Q * (quadratic + squares) / 2 + self.EI * curved / 2 - work
        return q @ P.spring @ q / 2 + self.rho @ q + spans.sum()

    def _ends(self, T: Array) -> Array:
        """Slopes beside the chord at both ends."""
        Q, along = self.Q0 + self.statics.spread(T), self.lengths
        k = along * np.sqrt(Q / self.EI)
        coth = (1 + np.exp(-2 * k)) / (1 - np.exp(-2 * k))
        csch = 2 * np.exp(-k) / (1 - np.exp(-2 * k))
        offset = (self.start - self.end) / k**2
        at_start = (self.end * csch - self.start * coth) / k + offset
        at_end = (self.end * coth - self.start * csch) / k + offset
        return along * np.array([at_start, at_end])

    def gradient(self, q: Array, T: Array) -> Array:
        """Gradient of the potential, which is quadratic in q, so that differences are exact."""
        found = np.zeros(len(q))
        for a in range(len(q)):
            step = np.zeros(len(q))
            step[a] = 0.1 * self.statics.unit[a]
            up, down = self.potential(q + step, T), self.potential(q - step, T)
            found[a] = (up - down) / (2 * step[a])
        return found

    def stiffness(self, T: Array) -> Array:
        """Second derivatives of the potential by the coordinates."""
        k = self.statics.k
        none, columns = np.zeros(k), []
        base = self.gradient(none, T)
        for a in range(k):
            step = np.zeros(k)
            step[a] = self.statics.unit[a]
            columns.append((self.gradient(step, T) - base) / step[a])
        return np.array(columns).reshape(k, k).T

    def gamma(self, T: Array) -> Array:
        """Gamma of each span, the integral of its squared curvature in lengths of the span."""
        _, curvature = self.shape(T)
        return self.lengths**2 * (curvature**2 @ WEIGHTS)

    def settled(self, T: Array) -> Array:
        """The least of the potential within the stops, by trying all sets of stops."""
        k = self.statics.k
        A, g = self.stiffness(T), self.gradient(np.zeros(k), T)
        best: tuple[float, Array] | None = None
        for held in itertools.product((0, -1, 1), repeat=k):
            held = np.array(held, int)
            at = np.where(held < 0, self.lo, np.where(held > 0, self.hi, 0.0))
            if not np.all(np.isfinite(at)) or np.any(held[~self.free] != 0):
                continue
            loose = self.free & (held == 0)
            q = np.where(held != 0, at, 0.0)
            if loose.any():
                rhs = -(g + A @ q)[loose]
                q[loose] = np.linalg.solve(A[np.ix_(loose, loose)], rhs)
            if np.any(q[self.free] < self.lo[self.free] - 1e-12):
                continue
            if np.any(q[self.free] > self.hi[self.free] + 1e-12):
                continue
            value = float(q @ A @ q / 2 + g @ q)
            if best is None or value < best[0]:
                best = value, q
        assert best is not None
        return best[1]

    def holds(self, T: Array) -> bool:
        """Whether the potential has a least value over the bodies that are free."""
        A = self.stiffness(T)[np.ix_(self.free, self.free)]
        return not A.size or np.linalg.eigvalsh(A).min() > 0


def coupling(numbers: Mapping[str, Array], loops: tuple[int, ...], shaft: int = 0) -> float:
    """Gamma of a drive whose tension is given: the source's model, with the bodies' curvature."""
    drive = Statics(numbers, loops, shaft)
    found = drive.at_rest(*drive.held_as_drawn(), drive.taken, np.zeros(drive.k))
    assert found is not None, "no state of rest near the drawn one"
    at, P = found
    momentum = drive.momentum
    lengths, _, _, _ = drive.path(at)
    bending = Bending(drive, at, P - momentum, momentum, drive.sums(lengths), np.zeros(drive.k))

    def residual(T: Array) -> Array:
        return bending.residual(bending.settled(T), T) / bending.give

    start = 0.8 * np.array([momentum[drive.belt == b][0] for b in range(len(loops))])
    return float(bending.gamma(root(residual, start, tol=1e-12).x).sum())
