"""The public steady state of the prototype's own geometry, by each method."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example
from published import Value, assert_matches_print

import beltjax as bj

TENSION, MASS = 300.0, 0.1029


def prototype(eps, s, named=None):
    """The file's drive with k_s = 4, and its operating point."""
    drive, _ = example("three_pulley")
    at = bj.layout(drive)
    stiffness = eps**2 * TENSION * jnp.mean(at.span_lengths) ** 2
    rule = bj.TensionGiven(TENSION, None if named is None else TENSION * np.array(named))
    drive = eqx.tree_at(
        lambda d: (d.belt.bending_stiffness, d.tensioner.stiffness, d.installation),
        drive,
        (stiffness, 4 * TENSION * at.arm_length, rule),
    )
    return drive, bj.OperatingPoint(belt_speed=s * np.sqrt(TENSION / MASS))


@pytest.mark.parametrize(
    ("s", "named", "printed"),
    [(0.6, None, "0.282732"), (0.9, (0.9395, 0.9395, 1.5395), "0.640802")],
)
def test_tension_change_of_the_file_geometry(s, named, printed):
    steady = bj.steady_state(*prototype(0.01, s, named))
    assert_matches_print(steady.tension_change, Value(printed))


@pytest.mark.parametrize(
    ("eps", "printed"),
    [(0.01, "2.747617"), (0.015, "4.117276"), (0.04, "10.475229"), (0.05, "12.618201")],
)
def test_coupling_of_the_file_geometry(eps, printed):
    steady = bj.steady_state(*prototype(eps, 0.0))
    assert_matches_print(steady.coupling.sum(), Value(printed))
    assert_matches_print(steady.effectiveness, Value("0.78538"))


def test_string_runs_up_to_its_critical_speed():
    for s, runs in ((2.3514, True), (2.3516, False)):
        steady = bj.steady_state(*prototype(0.0, s), throw=False)
        assert bool(steady.result == bj.RESULTS.successful) is runs


@pytest.mark.parametrize(
    "method",
    [
        bj.Exact(),
        bj.Perturbation(),
        bj.Linear(),
        pytest.param(bj.Collocation(), marks=pytest.mark.slow),
    ],
)
def test_deflection_meets_the_pulleys(method):
    drive, point = prototype(0.02, 0.4)
    steady = bj.steady_state(drive, point, method)
    at, th = steady.reference.layout, float(steady.arm_rotation)
    # The arm moves its pulley by r_t theta cos(beta) along the spans' normals.
    moved = (
        float(at.arm_length)
        * th
        * np.cos(np.asarray(bj.alignment_angles(drive, at)[0]))
        / np.asarray(at.span_lengths)[:2]
    )
    ends = [[float(w) for w in steady.deflection(i, jnp.array([0.0, 1.0]))] for i in range(3)]
    # Each layer of the perturbation's composite leaves u^2 e^{-k} at the other end, here 3e-12.
    np.testing.assert_allclose(ends, [[0, moved[0]], [moved[1], 0], [0, 0]], atol=1e-11)
    with pytest.raises(IndexError, match="span 3 of 3"):
        steady.deflection(3, jnp.array(0.5))


def test_methods_agree_as_the_belt_softens():
    def gap(eps):
        exact, leading = (
            bj.steady_state(*prototype(eps, 0.6), m) for m in (bj.Exact(), bj.Perturbation())
        )
        return abs(float(exact.coupling.sum() / leading.coupling.sum()) - 1)

    # The next term of the expansion is of relative order gamma eps^2 (times curvatures).
    assert gap(1e-3) < 1e-3
    assert gap(1e-3) / gap(1e-4) > 10 * 0.9
