"""A textbook's flat belt, as its readers would describe it, to the digits that it prints.

R. G. Budynas and J. K. Nisbett, Solutions Manual to accompany Shigley's Mechanical Engineering
Design, 8th edition, chapter 17, page 425: pulleys of 6 and 18 in, 96 in apart, a belt of 0.13 in
and 0.042 lbf/in^3 that may have 70 lbf for each inch of its width, 20.6 hp at 2749 ft/min, and
exp(f theta) = 11.17 on the small pulley, which drives.

The book's initial tension F_i leaves out the centrifugal tension F_c. On fixed centers the running
strands have the sum of tensions that they have at rest, so that the belt is mounted with F_i + F_c.
The book's belt does not stretch, and EA is not printed: here it is large.
"""

import math

import pytest
from bodies_cases import load
from scipy.optimize import brentq

import beltjax as bj
from beltjax.validation.printed.value import Value

LBF, INCH, FOOT = 4.4482216152605, 0.0254, 0.3048
SPEED = 2749 * FOOT / 60  # m/s
PULL = 20.6 * 550 * LBF * FOOT / SPEED  # N, tight side less slack side
DRIVE = """
schema = 1
name = "flat belt of polyamide"
listed = "counterclockwise"
[belt]
axial_stiffness = "1e8 lbf"
bending_stiffness = 0.0
mass_per_length = "{weight!r} lb/ft"
[[pulley]]
name = "motor"
center = [0, 0]
diameter = "6 in"
face = "grooved"
friction = {friction!r}
driver = true
[[pulley]]
name = "machine"
center = ["96 in", 0]
diameter = "18 in"
face = "grooved"
[installation]
tension = {mounted!r}
[operation]
belt_speed = "2749 ft/min"
torque = {{ machine = {torque!r} }}
"""


def belt_of(folder, width):
    """The drive and its point with a belt of this width [in], as tight as it may be."""
    theta = math.pi - 2 * math.asin(12 / 192)
    text = DRIVE.format(
        weight=12 * 0.042 * 0.13 * width,
        friction=math.log(11.17) / theta,
        mounted=70 * width * LBF - PULL / 2,
        torque=PULL * 9 * INCH,
    )
    return load(folder, text)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("3.016511", lambda at: at.wraps[0]),
        ("3.266674", lambda at: at.wraps[1]),
        ("230.074", lambda at: at.path_length / INCH),
    ],
    ids=["small arc", "large arc", "length"],
)
def test_arcs_and_length_are_those_printed(tmp_path, text, found):
    assert Value(text).matches(float(found(bj.layout(belt_of(tmp_path, 5.0)[0]))))


def test_the_narrowest_belt_that_does_not_slip_is_the_one_printed(tmp_path):
    def margin(width):
        drive, point = belt_of(tmp_path, width)
        steady = bj.steady_state(drive, point)
        # The tight strand has what the belt may have.
        assert float(steady.running_tensions.max()) == pytest.approx(70 * width * LBF, rel=1e-5)
        return math.log(11.17) - float(steady.slip_exponents[0])

    assert Value("4.13").matches(brentq(margin, 4.0, 4.5, xtol=1e-5))
