"""A `ContactState` as `closed_belt.balances` takes it, in the units of its own scales."""

import numpy as np
from closed_belt import BeltData, PulleyData, SpanData, normal


def data_of(state, law="kong"):
    """Belt, pulleys and spans along the travel; lengths, forces and times over `state.scales`."""
    model, loop, spans = state.model, state.solved.loop, state.solved.loop.spans
    rho, kappa, EI = np.asarray(model.rho), np.asarray(loop.kap), float(model.EI)
    centers = moved_centers(state)
    lines = np.roll(centers, -1, axis=0) - centers
    psi = -2 * np.sign(rho) * np.asarray(spans.u_i)  # theta - phi, from the internal force
    theta = np.arctan2(lines[:, 1], lines[:, 0]) + np.asarray(spans.phi) + psi
    speed = float(loop.V_ref)
    belt = BeltData(
        EI,
        float(model.EA),
        speed,
        float(loop.g) / speed if speed else 0.0,
        float(state.solved.held.L0),
        hyperelastic=law == "hyperelastic",
    )
    moments = float(state.torque_factor) * np.asarray(model.pull) * np.abs(rho)
    slip, wrap = np.asarray(loop.slip), np.asarray(loop.touching)
    pulleys = PulleyData(centers, rho, moments, np.asarray(model.mu), wrap - slip, slip)
    return (
        belt,
        pulleys,
        SpanData(
            centers - rho[:, None] * normal(theta),
            theta,
            kappa,
            np.asarray(spans.F) * np.sin(psi) / EI,
            np.asarray(loop.P_out),
            np.asarray(spans.L),
        ),
    )


def moved_centers(state):
    """Centers along the travel, the tensioners where they are."""
    return np.stack([state.solved.loop.x, state.solved.loop.y], axis=1)
