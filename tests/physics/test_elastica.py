"""The free span in closed form: a second route to it, its limits, and how far it can be asked."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from closed_belt import BeltData, integrated_span

from beltjax.physics.elastica import LONG, SpanData, elastica
from beltjax.validation.peers.span import bent_span

EA = 1e4
SIGNS = [(1, 1), (1, -1), (-1, 1), (-1, -1)]


@jax.jit
def solved(numbers):
    """Spans, and the derivative of all of each with respect to the logarithm of its EI."""

    def span(log_EI, row):
        C, _, d, rho_i, rho_j = row
        one = jnp.ones_like(C)
        kappa = 1 / rho_i, 1 / rho_j
        return elastica(SpanData(C, jnp.exp(log_EI), EA * one, d, rho_i, rho_j, *kappa))

    def both(row):
        numbers, along = (jnp.log(row[1]),), (jnp.ones_like(row[1]),)
        return jax.jvp(lambda log_EI: span(log_EI, row), numbers, along)

    return jax.vmap(both)(numbers)


def spans(rows):
    """C, EI, d, rho_i, rho_j a row; padded so that all tests share one program."""
    rows = np.asarray(rows, float)
    full = np.concatenate([rows, np.tile(rows[-1:], (-len(rows) % 512, 1))])
    parts = [jax.device_get(solved(full[k : k + 512])) for k in range(0, len(full), 512)]
    return jax.tree.map(lambda *x: np.concatenate(x)[: len(rows)], *parts)


def angles(span, rows):
    """Inclinations at the ends, from the line of centers."""
    sense_i, sense_j = np.sign(np.asarray(rows)[:, 3:]).T
    return span.phi - 2 * sense_i * span.u_i, span.phi + 2 * sense_j * span.u_j


def random_rows(count, seed=0):
    """All patterns of senses; stiff to slack, near to far, alike and a hundredfold apart."""
    rng = np.random.default_rng(seed)
    small = 10 ** rng.uniform(-2, 0, count)
    radii = np.where(
        rng.uniform(size=(2, count)) < 0.5, [small, np.ones(count)], [np.ones(count), small]
    )
    signs = rng.choice([-1.0, 1.0], (2, count))
    d = radii.sum(axis=0) * (1 + 10 ** rng.uniform(-2, 1, count))
    # P > 0 at the tighter end: EI below 2 C R^2, up to nine tenths of it.
    EI = 2 * radii.min(axis=0) ** 2 * 10 ** rng.uniform(-4, np.log10(0.9), count)
    return np.stack([np.ones(count), EI, d, *(signs * radii)], axis=1)


def test_random_spans_meet_the_equations_of_their_shape():
    rows = random_rows(2048)
    span, slope = spans(rows)
    assert np.all(span.converged)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((span, slope))
               if leaf.dtype == float)  # fmt: skip
    backwards = np.abs(span.phi) > np.pi / 2
    print(f"{np.sum(backwards)} thrust lines point backwards, {np.sum(span.long)} spans are long")
    assert np.sum(backwards) > 5
    start, end = angles(span, rows)
    # Integrated from the start, without a formula of the elastica, the span ends where it should.
    short = 60 * np.sqrt(rows[:, 1]) > span.L
    picked = np.concatenate([np.flatnonzero(backwards & short)[:10], np.flatnonzero(short)[::25]])
    for k in picked:
        C, EI, d, rho_i, rho_j = rows[k]
        P = C - EI / (2 * rho_i**2)
        shape = integrated_span(BeltData(EI, EA), P, 1 / rho_i, 1 / rho_j, start[k], span.L[k])
        reach = np.array([d + rho_j * np.sin(end[k]), -rho_j * np.cos(end[k])])
        reach = reach - rho_i * np.array([np.sin(start[k]), -np.cos(start[k])])
        size = span.L[k]
        assert np.max(np.abs(shape.end - reach)) < 1e-10 * size, rows[k]
        assert abs(shape.turn - (end[k] - start[k])) < 1e-10, rows[k]
        assert abs(shape.unstretched / (EA * span.J[k]) - 1) < 1e-10, rows[k]


def test_spans_agree_with_scipy():
    rows, peers = [], []
    for sense_i, sense_j in SIGNS:
        for EI, d in ((1e-4, 0.3), (0.05, 0.2)):
            rho_i, rho_j, P = sense_i * 0.05, sense_j * 0.08, 100.0
            peers.append(bent_span(P, EI, rho_i, rho_j, d, EA=EA, tol=1e-7))
            rows.append((P + EI / (2 * rho_i**2), EI, d, rho_i, rho_j))
    span, _ = spans(rows)
    start, end = angles(span, rows)
    for k, peer in enumerate(peers):
        assert span.L[k] == pytest.approx(peer.length, rel=1e-9)
        assert span.J[k] == pytest.approx(peer.compliance, rel=1e-9)
        assert [start[k], end[k]] == pytest.approx([peer.angle_start, peer.angle_end], abs=1e-9)
        assert span.P_mid[k] == pytest.approx(peer.middle, rel=1e-9)


@pytest.mark.parametrize(("sense_i", "sense_j"), SIGNS)
def test_nothing_jumps_where_the_long_span_takes_over(sense_i, sense_j):
    # At L = 35 layers what the explicit span leaves out, e^-35, is below rounding.
    d, radii = 1.0, (0.05, 0.2)
    lengths = LONG + np.array([-1e-5, 1e-5])
    EI = (1.02 / lengths) ** 2  # L is about d cos(phi) and twice a layer's own share

    def at(EI):
        return spans([(1.0, one, d, sense_i * radii[0], sense_j * radii[1]) for one in EI])

    for _ in range(30):
        EI = EI * (at(EI)[0].L / np.sqrt(EI) / lengths) ** 2
    span, slope = at(EI)
    assert list(span.long) == [False, True]
    step = np.log(EI[1] / EI[0])
    for name in ("L", "J", "phi", "u_i", "u_j", "F", "P_mid"):
        low, high = getattr(span, name)
        rise, after = getattr(slope, name)
        assert high - low == pytest.approx(step * (rise + after) / 2, abs=1e-11), name
        assert after - rise == pytest.approx(0, abs=1e-5 * max(abs(rise), 1e-6)), name


@pytest.mark.parametrize(("sense_i", "sense_j"), SIGNS)
def test_angles_change_by_the_root_of_the_stiffness_and_lengths_by_less(sense_i, sense_j):
    rho = np.array([sense_i * 0.3, sense_j * 0.5])
    EI = np.array([1e-8, 1e-10, 1e-12])
    rows = [(1.0, one, 2.0, *rho) for one in EI]
    span, _ = spans(rows)
    phi = -np.arcsin((rho[1] - rho[0]) / 2.0)
    start, end = angles(span, rows)
    for angle, radius in ((phi - start, rho[0]), (end - phi, rho[1])):
        assert angle / np.sqrt(EI) == pytest.approx(np.full(3, 1 / radius), rel=1e-3)
    # Longer than the string's by half a layer over each radius less what the ends' arcs are
    # shorter: with the arcs, which lose R times the same angles, only O(EI) is left.
    arcs = np.abs(rho[0]) * np.abs(start - phi) + np.abs(rho[1]) * np.abs(end - phi)
    change = span.L - arcs - 2.0 * np.cos(phi)
    assert np.max(np.abs(change) / EI) < 20
    unstretched = span.J * (EA + 1) - arcs - 2.0 * np.cos(phi)
    assert np.max(np.abs(unstretched) / EI) < 20
