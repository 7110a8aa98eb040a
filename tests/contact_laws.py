"""A `ContactState` as `closed_belt.balances` takes it, in the units of its own scales."""

import numpy as np
from closed_belt import BeltData, PulleyData, SpanData, normal


def data_of(state, law="kong", belt=0):
    """Belt, pulleys and spans along the travel; lengths, forces and times over `state.scales`."""
    loops = state.model.loops
    of = slice(int(loops.starts[belt]), int(loops.starts[belt]) + loops.sizes[belt])
    model, loop, spans = state.model, state.solved.loop, state.solved.loop.spans
    rho, kappa = np.asarray(model.rho)[of], np.asarray(loop.kap)[of]
    EI, EA = float(model.EI[belt]), float(model.EA[belt])
    centers = moved_centers(state)[of]
    lines = np.roll(centers, -1, axis=0) - centers
    psi = -2 * np.sign(rho) * np.asarray(spans.u_i)[of]  # theta - phi, from the internal force
    theta = np.arctan2(lines[:, 1], lines[:, 0]) + np.asarray(spans.phi)[of] + psi
    speed, flux = float(loop.V_ref[of][0]), float(loop.g[of][0])
    belt = BeltData(
        EI,
        EA,
        speed,
        flux / speed if speed else 0.0,
        float(state.solved.held.L0[belt]),
        hyperelastic=law == "hyperelastic",
    )
    moments = float(state.torque_factor) * np.asarray(model.pull)[of] * np.abs(rho)
    slip, wrap = np.asarray(loop.slip)[of], np.asarray(loop.touching)[of]
    pulleys = PulleyData(centers, rho, moments, np.asarray(model.mu)[of], wrap - slip, slip)
    return (
        belt,
        pulleys,
        SpanData(
            centers - rho[:, None] * normal(theta),
            theta,
            kappa,
            np.asarray(spans.F)[of] * np.sin(psi) / EI,
            np.asarray(loop.P_out)[of],
            np.asarray(spans.L)[of],
        ),
    )


def moved_centers(state):
    """Centers along the travel, the tensioners where they are."""
    return np.stack([state.solved.loop.x, state.solved.loop.y], axis=1)
