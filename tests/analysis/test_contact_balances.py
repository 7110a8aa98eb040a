"""Conservation laws of whole belts in contact, by quadrature that knows no elastica.

Lengths over the mean distance of the centers, forces over the tension at rest, times so that the
belt's mass per length is 1: every residual is of order one times its error.
"""

import numpy as np
import pytest
from closed_belt import balances
from contact_drives import equal, largest, random_seven, seven, state, unequal
from contact_laws import data_of

MADE_OF = ("friction_loss", "pulley_speeds", "axle_forces")  # no residuals
WRAPPED = (0, 2, 3, 4, 6)  # of the random drives: torque on pulleys with wrap alone

CASES = {
    "equal": lambda law: state(*equal(), law=law),
    "equal, thin layers": lambda law: state(*equal(EI=0.0015), law=law),
    "equal, stiff": lambda law: state(*equal(EI=0.05), law=law),
    "equal, maximum": lambda law: largest(*equal(), law=law),
    "unequal": lambda law: state(*unequal(M2=10.0), law=law),
    "unequal, maximum": lambda law: largest(*unequal(), law=law),
    "unequal, maximum, stiff": lambda law: largest(*unequal(EI=0.05), law=law),
    "unequal, standing": lambda law: largest(*unequal(c=0.0), law=law),
    "seven": lambda law: state(*seven(), law=law),
    "seven, maximum": lambda law: largest(*seven(), law=law),
    "seven, opposite travel": lambda law: state(
        *seven(torque=(0, 2, 0, 1, 0.1, 2), travel="opposite"), law=law
    ),
    "seven, locked": lambda law: state(*seven(torque=(0, 3, 0, 2, 0.4, 4), k_r=1e9), law=law),
    "seven, point contact": lambda law: state(*point_contact(), law=law),
}
for place in WRAPPED:
    CASES[f"random {place}"] = lambda law, k=place: state(*random_seven(7)[k], law=law)


MORE = {f"random {place}" for place in WRAPPED[1:]}


def point_contact():
    return seven(torque=(0, 1, 0, 0.7, 0.05, 1.5), EI=0.19)


def test_the_idler_touches_at_one_point():
    found = state(*point_contact())
    assert found.wraps[3] == 0.0
    assert 0 < found.contact_curvatures[3] * 0.045 < 1


NAMES = [pytest.param(name, marks=pytest.mark.slow if name in MORE else ()) for name in CASES]


@pytest.mark.parametrize("law", ["kong", "hyperelastic"])
@pytest.mark.parametrize("name", NAMES)
def test_every_balance_closes(name, law):
    found = CASES[name](law)
    assert found.feasible
    b = balances(*data_of(found, law))
    for field, residual in b._asdict().items():
        if field not in (*MADE_OF, "power"):
            # The slope of the curvature is of order lambda kappa.
            unit = 1.0
            if field == "curvature_slope":
                unit = np.max(np.sqrt(found.solved.loop.C / found.model.EI))
                unit = unit * np.max(np.abs(found.solved.loop.kap))
            assert np.max(np.abs(residual)) < 1e-10 * unit, field
    if law == "hyperelastic":
        assert abs(b.power) <= 1e-10 * b.friction_loss


@pytest.mark.parametrize("name", NAMES)
def test_the_sources_law_makes_power_of_bending(name):
    found = CASES[name]("kong")
    b = balances(*data_of(found))
    model, loop = found.model, found.solved.loop
    softness = loop.V_ref[0] / (model.EA[0] - loop.g[0])
    pull = found.torque_factor * model.pull
    friction = softness / 2 * np.sum(pull**2)
    flaw = softness * model.EI[0] / 2 * np.sum(pull / model.rho**2)
    assert b.friction_loss == pytest.approx(float(friction), rel=1e-10)
    assert abs(b.power - float(flaw)) <= 1e-10 * max(float(friction), abs(float(flaw)))
