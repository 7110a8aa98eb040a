"""Cords on an elastic layer around one pulley, and their vibration: tests/data/cushion.json.

The stored numbers are of an independent program: boundary value problems to 1e-9, and frequencies
by spectral elements that agree with exact dynamic stiffness to 1e-11.
"""

import itertools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

import beltjax as bj
from beltjax.numerics.gyroscopic import hermitian_modes
from beltjax.physics import cushion, cushion_arc, cushion_vibration
from beltjax.physics.cushion import Layer
from beltjax.physics.cushion_vibration import Mesh, Vibrating
from beltjax.physics.inclined_arcs import ArcEnds, arc_step

CASES = json.loads((Path(__file__).parents[1] / "data" / "cushion.json").read_text())


def layer(R, k_r, k_s, EA, mu=None):
    numbers = (R, k_r, k_s, mu or 1.0, 1.0, float(mu is None), EA, 1e-9)
    return Layer(*(jnp.asarray(x, float) for x in numbers))


def pull(P_in, P_out, turn):
    return ArcEnds(*(jnp.asarray(x, float) for x in (P_in, P_out, turn, 0.0)))


@pytest.mark.parametrize("case", CASES["steady"])
def test_thin_layers_without_torque(case):
    of = layer(case["R"], case["k_r"], 1e7, 25e3)
    S, first, last = cushion.contact_length(pull(case["P"], case["P"], case["turn"]), of)
    assert float(S) == pytest.approx(case["closed"]["S"], rel=1e-13)
    assert float(first) == float(last) == pytest.approx(case["closed"]["chi"], rel=1e-13)
    # What is left out is of the square of the angle.
    exact = case["bvp"]
    assert float(first) == pytest.approx(exact["chi"], rel=0.1 * exact["chi"] ** 2)


@pytest.mark.parametrize("case", CASES["shear"])
def test_shear_and_sliding_of_a_hard_layer(case):
    mu = case["mu"] if case["mu"] < 10 else None
    of = layer(case["R"], 1e16, case["k_s"], case["EA"], mu)
    S, closed = case["R"] * case["turn"], case["closed"]
    along, left, wholly = cushion.shear(pull(case["P_in"], case["P_out"], case["turn"]), of, S)
    assert not bool(wholly)
    assert float(along.low) == pytest.approx(closed["Pstar"], rel=1e-9)
    assert float(left) == pytest.approx(closed["zeta"], rel=1e-9)
    assert float(S - along.end) / case["R"] == pytest.approx(closed["slip_angle"], abs=1e-8)


def solved(case, elements=48):
    """One arc with its ends held, by Newton's method on two meshes."""
    of = layer(case["R"], case["k_r"], case["k_s"], case["EA"])
    ends = pull(case["P_in"], case["P_out"], case["turn"])

    @jax.jit
    def found(of, ends):
        def newton(arc, _):
            step = arc_step(cushion_arc.arc_problem(of, ends), arc)
            return arc._replace(z=jax.tree.map(jnp.subtract, arc.z, step.base)), None

        arc = cushion_arc.first_arc(of, ends, elements)
        arc, _ = jax.lax.scan(newton, arc, None, length=8)
        arc, _ = jax.lax.scan(newton, cushion_arc.moved_arc(arc), None, length=4)
        return cushion_arc.met_of(arc.z, arc.mesh, of), arc

    return found(of, ends)[0]


def test_exact_arcs_under_torque():
    for case in CASES["arc"]:
        met, exact = solved(case), case["bvp"]
        assert float(met.chi_in) == pytest.approx(exact["chi_in"], rel=1e-8)
        assert float(met.chi_out) == pytest.approx(exact["chi_out"], rel=1e-8)
        assert float(met.length) == pytest.approx(exact["S"], rel=1e-9)
        assert float(met.om) == pytest.approx(exact["om"], rel=1e-10)
        assert float(met.unstretched) == pytest.approx(exact["U"], rel=1e-9)
        assert float(met.zeta_out) == pytest.approx(exact["zeta"], rel=1e-7)
        # The power that is lost is that of the shear which the belt carries out.
        chi = np.cos([float(met.chi_in), float(met.chi_out)])
        moment = case["R"] * (case["P_out"] * chi[1] - case["P_in"] * chi[0])
        EA = case["EA"]
        work = ((EA + case["P_out"]) ** 2 - (EA + case["P_in"]) ** 2) / (2 * EA)
        lost = work - float(met.om) / case["R"] * moment
        assert lost == pytest.approx(case["k_s"] * float(met.zeta_out) ** 2 / 2, rel=1e-6)
        assert lost == pytest.approx(exact["loss"], rel=1e-6)


def test_curvature_of_a_stiff_belt_at_the_cushion():
    P, EI, k, R = 300.0, 0.02, 3e7, 0.05
    give, width = P / (k * R), np.sqrt(EI / P)

    # z, in units of `give`, is how far the belt lies inside the pulley's circle, and kappa, in
    # 1/R, its curvature: EI kappa'' = P kappa - N with N = k z on the arc and none before it. Both
    # parts run away from the point of contact, in units of `width`.
    def slopes(s, y):
        z, dz, kappa, dkappa, before, dbefore = y
        bent = (kappa - 1) * width**2 / (R * give)
        return np.vstack([dz, bent, dkappa, kappa - z, dbefore, before])

    def conditions(a, b):
        joined = a[2] - a[4], a[3] + a[5]
        return np.array([a[0], *joined, b[1], b[2] - 1, b[4]])

    s = np.linspace(0, 14, 200)
    guess = np.ones((6, len(s))) * np.array([1, 0, 1, 0, 0, 0])[:, None]
    found = scipy.integrate.solve_bvp(slopes, conditions, s, guess, tol=1e-8, max_nodes=20000)
    assert found.success
    got = float(cushion.end_curvature(jnp.asarray(P), jnp.asarray(EI), jnp.asarray(k)))
    assert got == pytest.approx(found.y[2, 0], rel=1e-5)
    assert got < 0.7
    # Towards a hard pulley it tends to 1, with the fourth root of the stiffness.
    lacking = [1 - float(cushion.end_curvature(P, jnp.asarray(EI), k)) for k in (1e20, 1e24)]
    assert lacking[0] == pytest.approx(10 * lacking[1], rel=1e-2)


def vibrating(case):
    """A stored case in the letters of the theory."""
    arcs = [segment for segment in case["segments"] if segment[0] == "arc"]
    spans = [segment for segment in case["segments"] if segment[0] == "span"]
    n, P, kappa = len(arcs), arcs[0][2], np.array([arc[3] for arc in arcs])
    R = 1 / np.abs(kappa)
    m, EA = case.get("m", 0.1029), case.get("EA", 120e3)
    by, mass, spring = np.zeros((2, n, 0)), np.zeros((0, 0)), np.zeros((0, 0))
    if "with arm" in case["name"]:
        drive, _ = bj.load_drive("examples/three_pulley.toml")
        arm = np.array(drive.pulleys[1].center - drive.tensioner.pivot)
        by = np.zeros((2, n, 1))
        by[:, 1, 0] = -arm[1], arm[0]
        mass, spring = np.array([[1.165e-3]]), np.array([[116.4]])
    numbers = (
        P,
        m,
        case["c"],
        EA,
        np.full(n, case["k_r"]),
        np.full(n, case["k_s"]),
        R,
        np.sign(kappa),
        [arc[1] for arc in arcs],
        [span[1] for span in spans],
        np.sqrt(case["k_r"] / P - 1 / R**2),
        [arc[7] for arc in arcs],
        np.ones(n),
        [arc[6] for arc in arcs],
        [0.0] + [1.0] * (n - 1),
        *by,
        mass,
        spring,
        np.ones(len(mass)),
    )
    return Vibrating(*(jnp.asarray(number, float) for number in numbers))


@pytest.mark.parametrize("case", CASES["vibration"][:3], ids=lambda case: f"{case['k_r']:g}")
def test_frequencies_of_two_pulleys(case):
    matrices = cushion_vibration.assembled(vibrating(case), Mesh(6, 10, 16))
    eigen, definite = hermitian_modes(*matrices, 6)
    assert bool(definite)
    # The stored numbers are good to 1e-11; layers of 1e8 N/m^2 cost these elements 5e-10.
    np.testing.assert_allclose(eigen.values.imag, case["omega_fe"][:6], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES["vibration"][3:], ids=lambda case: f"{case['c']:g} m/s")
def test_frequencies_of_three_pulleys(case):
    matrices = cushion_vibration.assembled(vibrating(case), Mesh(6, 10, 16))
    eigen, _ = hermitian_modes(*matrices, 8)
    np.testing.assert_allclose(eigen.values.imag, case["omega_fe"], rtol=3e-8)


@pytest.mark.slow
def test_frequencies_by_transfer_matrices():
    # Another route: the differential equations of the Lagrangian over short pieces.
    case = CASES["vibration"][1]
    of = vibrating(case)
    matrices = cushion_vibration.assembled(of, Mesh(6, 10, 16))
    eigen, _ = hermitian_modes(*matrices, 3)
    for guess in np.asarray(eigen.values.imag):
        f = transfer_residual(of)
        root = scipy.optimize.newton(f, complex(guess * (1 + 1e-6)), x1=complex(guess), tol=1e-9)
        assert abs(root.imag) < 1e-5
        assert guess == pytest.approx(root.real, rel=2e-9)


def transfer_residual(of):
    """A function of frequency that vanishes at the natural ones; the driver, pulley 0, is held."""
    P, m, c, EA = (float(x) for x in (of.P, of.m, of.c, of.EA))
    E = EA - m * c**2

    def piece(omega, start, end, kappa, k_r, k_s, R):
        """[u, p] at the end, and the pulley's moment, by [u, p] at the start and the rotation."""
        iw = 1j * omega

        def slopes(s, y):
            U, v, p, q, _ = y.reshape(5, 5)
            curve = kappa(s)
            turned = R * np.array([0, 0, 0, 0, 1.0])
            tight = iw * m * c * U - p
            dU, dv = curve * v + tight / E, (iw * m * c * v - q) / P
            dp = -k_s * (U - turned) - iw * (m * iw * U + m * c * (dU - 2 * curve * v))
            dq = -2 * m * c * curve * iw * U + curve * tight - k_r * v
            dq = dq - iw * (m * iw * v + m * c * dv)
            return np.concatenate([dU, dv, dp, dq, k_s * R * (U - turned)])

        begin = np.vstack([np.eye(4, 5), np.zeros(5)]).astype(complex).ravel()
        found = scipy.integrate.solve_ivp(
            slopes, (start, end), begin, method="DOP853", rtol=1e-12, atol=1e-14
        )
        return found.y[:, -1].reshape(5, 5)

    def residual(omega):
        blocks, at = [], []
        for i in range(len(of.arcs)):
            S, L, lam = float(of.arcs[i]), float(of.spans[i]), float(of.lam[i])

            R, side = float(of.R[i]), float(of.side[i])

            def kappa(s, S=S, lam=lam, R=R, side=side):
                layers = (np.exp(-lam * s) + np.exp(-lam * (S - s))) / (1 + np.exp(-lam * S))
                return side / (R * (1 - 1 / (R * lam) ** 2)) * (1 - layers)

            edges = np.linspace(0, S, int(S * lam / 2) + 1)  # solutions grow e^2 times in each
            for a, b in itertools.pairwise(edges):
                blocks.append(piece(omega, a, b, kappa, float(of.k_r[i]), float(of.k_s[i]), R))
                at.append(i)
            blocks.append(piece(omega, 0.0, L, lambda s: 0.0, 0.0, 0.0, 0.0))
            at.append(None)
        # Unknowns: [u, p] at the start of each piece, then the rotation of pulley 1.
        n = len(blocks)
        A = np.zeros((4 * n + 1, 4 * n + 1), complex)
        for k, (block, i) in enumerate(zip(blocks, at, strict=True)):
            rows, after = slice(4 * k, 4 * k + 4), 4 * ((k + 1) % n)
            A[rows, 4 * k : 4 * k + 4] += block[:4, :4]
            A[rows, after : after + 4] -= np.eye(4)
            if i == 1:
                A[rows, -1] += block[:4, 4]
                A[-1, 4 * k : 4 * k + 4] += block[4, :4]
                A[-1, -1] += block[4, 4]
        A[-1, -1] += omega**2 * float(of.J[1])
        scale = np.tile([1.0, 1.0, 1e4, 1e4], n)
        A[:, :-1] *= scale
        A[:-1] /= scale[:, None]
        right = np.cos(np.arange(len(A)))
        return 1 / (right @ np.linalg.solve(A, right))

    return residual
