"""Belt laws: quadrature against closed forms, a law of one's own, the registry."""

import dataclasses

import numpy as np
import pytest
from contact_drives import equal, seven

import beltjax as bj
from beltjax.physics.belt_law import belt_laws, find_belt_law


class Hardening(bj.AbstractBeltLaw):
    """A belt that hardens as it is stretched; without that the linear law, by quadrature."""

    share: float = 0.0
    rate: float = 30.0

    def strain(self, tension, bending):
        return tension + self.share * bending - self.rate * tension**2


@pytest.mark.parametrize(
    ("law", "share", "drive"),
    [
        ("kong", 0.0, equal(M2=1.0)),
        ("hyperelastic", 1.0, equal(M2=1.0)),
        pytest.param("hyperelastic", 1.0, seven(), marks=pytest.mark.slow),
    ],
    ids=["kong", "hyperelastic", "hyperelastic of seven"],
)
def test_gauss_and_newton_give_the_closed_forms(law, share, drive):
    closed = bj.contact_state(*drive, law=law)
    summed = bj.contact_state(*drive, law=Hardening(share, rate=0.0))
    for key in ("tensions", "speeds", "wraps", "slips", "unstretched_span_lengths"):
        np.testing.assert_allclose(getattr(summed, key), getattr(closed, key), rtol=1e-9)
    for key in ("unstretched_length", "unstretched_speed", "mass_flow", "efficiency"):
        assert float(getattr(summed, key)) == pytest.approx(float(getattr(closed, key)), rel=1e-10)


def test_a_hardening_belt_stretches_by_its_law():
    """At rest without bending the tension is the same all along, and so is the strain."""
    drive, point = equal(EI=1e-9, M2=0.0)
    state = bj.contact_state(drive, dataclasses.replace(point, driver_speed=0.0), law=Hardening())
    tension = float(drive.installation.tension) / float(drive.belt.axial_stiffness)
    path = float(bj.layout(drive).path_length)
    assert float(state.unstretched_length) == pytest.approx(
        path / (1 + tension - 30 * tension**2), rel=1e-7
    )


def test_the_speed_of_a_hardening_belt_is_its_stretch():
    """Conservation of mass: V/V_ref = 1 + e at both ends of each span, T known."""
    drive, point = equal(M2=1.0)
    state = bj.contact_state(drive, point, law=Hardening())
    ratio = np.asarray(state.speeds) / float(state.unstretched_speed)
    tension = np.asarray(state.tensions)[:, ::2] / float(drive.belt.axial_stiffness)
    np.testing.assert_allclose(ratio, 1 + tension - 30 * tension**2, rtol=1e-12)


def test_names_of_laws():
    assert [law.name for law in belt_laws()][:2] == ["kong", "hyperelastic"]
    with pytest.raises(ValueError, match="there is a law 'kong' already"):
        bj.belt_law("kong")
    with pytest.raises(ValueError, match="law 'rubber' is not one of 'kong', 'hyperelastic'"):
        find_belt_law("rubber")
