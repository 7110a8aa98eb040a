"""Every drive of the gallery: three numbers by plain geometry and statics, as the page prints them.

The belt runs by directions: from pulley to pulley along the angle t = f + asin((s_i - s_j)/d),
where f and d are direction and distance of the centers and s the signed radii, positive where the
belt turns left.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from drives import example
from scipy.optimize import brentq

import beltjax as bj

PAGE = Path(__file__).parents[1] / "docs" / "gallery.md"
TURN = 2 * np.pi


def belt_round(centers, radii):
    """Directions and lengths of the spans, and wraps; radii are positive where it turns left."""
    centers, s = np.asarray(centers, float), np.asarray(radii, float)
    apart, less = np.roll(centers, -1, axis=0) - centers, s - np.roll(s, -1)
    d = np.hypot(*apart.T)
    angles = np.arctan2(apart[:, 1], apart[:, 0]) + np.arcsin(less / d)
    turns = np.sign(s) * (angles - np.roll(angles, 1))
    return angles, np.sqrt(d**2 - less**2), np.mod(turns, TURN)


def path(centers, radii):
    _, spans, wraps = belt_round(centers, radii)
    return spans.sum() + (np.abs(radii) * wraps).sum()


def unstretched(centers, radii, tensions, EA):
    """Each span by its tension, each arc by the mean of the spans beside it."""
    _, spans, wraps = belt_round(centers, radii)
    tensions = np.asarray(tensions, float)
    arcs = (tensions + np.roll(tensions, 1)) / 2
    return (spans / (1 + tensions / EA)).sum() + (np.abs(radii) * wraps / (1 + arcs / EA)).sum()


def pull(centers, radii, place, tensions):
    """Force of the two spans at a pulley."""
    angles, *_ = belt_round(centers, radii)
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return tensions[place] * along[place] - tensions[place - 1] * along[place - 1]


def bolted(centers, radii, EA, tension, offsets):
    """Tensions on fixed centers of a belt that had one tension before its torques came."""
    length = unstretched(centers, radii, np.full(len(radii), tension), EA)
    level = brentq(
        lambda P: unstretched(centers, radii, P + offsets, EA) - length, 1.0, 1e5, xtol=1e-12
    )
    return level + offsets


def moment(arm, force):
    return arm[0] * force[1] - arm[1] * force[0]


def v_belt_slide():
    radii, EA = np.array([0.09, 0.125, 0.056]), 60e3

    def centers(q):
        return [[0, 0], [0.48, 0.04], [0.23, 0.285 + q]]

    drawn = 1.782 * (1 + 350 / EA)
    q = brentq(lambda q: path(centers(q), radii) - drawn, -0.05, 0.05, xtol=1e-15)
    offsets = np.cumsum([0.0, 24 / 0.125, 6 / 0.056])
    hand = {
        "the slide stands from the drawn place by": (1e3 * q, "mm", 3),
        "wrap of the engine's pulley": (np.degrees(belt_round(centers(q), radii)[2][0]), "deg", 2),
        "slack span at rest": (bolted(centers(q), radii, EA, 350.0, offsets)[0], "N", 1),
    }
    drive, point = example("v_belt_slide")
    rest = bj.reference_state(drive, point)
    wrap = np.degrees(float(rest.layout.wraps[0]))
    return hand, [1e3 * float(rest.installed[0]), wrap, float(rest.tensions[0])]


def six_pulley_accessory():
    inch, out = 0.0016, 0.0024
    radii = [0.0785 + inch, 0.0585 + inch, 0.026 + inch, -0.035 - out, 0.0605 + inch, -0.03 - out]
    centers = [[0, 0], [0.25, -0.02], [0.26, 0.27], [0.14, 0.238], [0, 0.33], [-0.07, 0.165]]
    arm = np.array([-0.07 + 0.11, 0.165 - 0.08])
    tension = 16 / moment(arm, pull(centers, radii, 5, np.ones(6)))
    length = path(centers, radii) / (1 + tension / 120e3) - TURN * inch
    hand = {
        "tension that the spring's 16 N m give": (tension, "N", 1),
        "effective length of the belt": (1e3 * length, "mm", 2),
        "wrap of the alternator": (np.degrees(belt_round(centers, radii)[2][2]), "deg", 2),
    }
    drive, point = example("six_pulley_accessory")
    rest = bj.reference_state(drive, point)
    length = 1e3 * (float(rest.unstretched_length) - TURN * inch)
    wrap = np.degrees(float(bj.layout(drive).wraps[2]))
    return hand, [float(rest.base_tension), length, wrap]


def starter_generator():
    radii, pivot = [0.08, 0.06, -0.0325, 0.0275, -0.0325], np.array([0.05, 0.3])
    fixed = np.array([[0, 0], [0.25, 0.02], [0.1237, 0.2484], [0.05, 0.3], [-0.0016, 0.2263]])

    def centers(turn):
        cos, sin = np.cos(turn), np.sin(turn)
        moved = fixed.copy()
        for k in (2, 4):
            moved[k] = pivot + np.array([[cos, -sin], [sin, cos]]) @ (fixed[k] - pivot)
        return moved

    def moments(turn):
        at = centers(turn)
        return [moment(at[k] - pivot, pull(at, radii, k, np.full(5, 600.0))) for k in (2, 4)]

    turn = brentq(lambda t: sum(moments(t)), -0.1, 0.1, xtol=1e-15)
    hand = {
        "both arms balance, turned from the drawn place by": (np.degrees(turn), "deg", 4),
        "moment of the spring between the arms": (abs(moments(turn)[0]), "N m", 3),
        "belt without tension": (1e3 * path(centers(turn), radii) / (1 + 600 / 150e3), "mm", 2),
    }
    drive, point = example("starter_generator")
    rest = bj.reference_state(drive, point)
    spring = 60 * abs(float(rest.free[2]))
    return hand, [
        np.degrees(float(rest.installed[0])),
        spring,
        1e3 * float(rest.unstretched_length),
    ]


def timing_belt_eccentric():
    radii = np.array([24 * 0.005 / TURN, 60 * 0.005 / TURN, -0.015 - 0.0012])

    def centers(turn):
        return [[0, 0], [0.19, 0], [0.096 - 0.006 * np.cos(turn), 0.042 - 0.006 * np.sin(turn)]]

    wanted = 119 * 0.005 * (1 + 120 / 90e3)
    turn = brentq(lambda t: path(centers(t), radii) - wanted, 0, 1.5, xtol=1e-15)
    hand = {
        "teeth on the drawn path": (path(centers(0), radii) / 0.005, "", 3),
        "turn of the eccentric for 119 teeth and 120 N": (np.degrees(turn), "deg", 2),
        "speed of the spindle": (3000 * 24 / 60, "rpm", 0),
    }
    drive, point = example("timing_belt_eccentric")
    rest, drawn = bj.reference_state(drive, point), bj.layout(drive)
    teeth, turned = (
        float(drawn.path_length) / drive.belt.pitch,
        np.degrees(float(rest.installed[0])),
    )
    speed = float(point.speed(drive) / drive.radii[1]) * 30 / np.pi
    return hand, [teeth, turned, speed]


def printer_axis():
    hand = {
        "teeth on the path": ((2 * 0.42 + 20 * 0.002) / 0.002, "", 0),
        "belt without tension": (1e3 * 0.88 / (1 + 30 / 9000), "mm", 2),
        "load on the motor's bearing": (2 * 30.0, "N", 0),
    }
    drive, point = example("printer_axis")
    steady = bj.steady_state(drive, point)
    teeth = float(steady.reference.layout.path_length) / drive.belt.pitch
    length = 1e3 * float(steady.reference.unstretched_length)
    return hand, [teeth, length, float(np.hypot(*steady.hub_loads[0]))]


def conveyor():
    radii, EA = [0.4, -0.15, 0.4], 2.4e6

    def centers(q):
        return [[0.25 - q, 0.5], [38.35, 0.05], [39.25, 0.5]]

    def strands(q, step):
        """Below and above the tail, from the weight's balance: the upper one has `step` more."""
        angles, *_ = belt_round(centers(q), radii)
        below, above = np.cos(angles[0]), -np.cos(angles[2])
        slack = (24e3 - step * above) / (below + above)
        return np.array([slack, slack, slack + step])

    length = unstretched(centers(0), radii, strands(0, 0.0), EA)

    def excess(q):
        return unstretched(centers(q), radii, strands(q, 3200 / 0.4), EA) - length

    q = brentq(excess, -0.01, 0.01, xtol=1e-15)
    hand = {
        "carrying strand at rest": (strands(q, 3200 / 0.4)[2] / 1e3, "kN", 4),
        "wrap of the head drum": (np.degrees(belt_round(centers(q), radii)[2][2]), "deg", 2),
        "belt without tension": (length, "m", 4),
    }
    drive, point = example("conveyor")
    rest = bj.reference_state(drive, point)
    wrap = np.degrees(float(rest.layout.wraps[2]))
    return hand, [float(rest.tensions[2]) / 1e3, wrap, float(rest.unstretched_length)]


def combine_two_belts():
    centers, radii = [[1.1, 0.2], [1.9, -0.1]], [0.15, 0.225]
    tensions = bolted(centers, radii, 300e3, 1600.0, np.array([0.0, 420 / 0.225]))
    hand = {
        "speed of the thresher": (2100 * 250 / 500 * 300 / 450, "rpm", 0),
        "torque of the engine": (420 * 250 / 500 * 300 / 450, "N m", 0),
        "slack span of the drum's belt at rest": (tensions[0], "N", 1),
    }
    drive, point = example("combine_two_belts")
    state = bj.reference_state(drive, point)
    # The thresher's belt runs as fast as the pinion's rim, whose shaft the main belt turns.
    rims = np.asarray(drive.radii)
    speed = float(point.speed(drive)) / rims[1] * rims[2] / rims[3] * 30 / np.pi
    tensions = dict(zip(drive.span_names, np.asarray(state.tensions), strict=True))
    return hand, [speed, -float(state.torques[0]), float(tensions["pinion-thresher"])]


def crossed_belt():
    s, d, EA = 0.1 + 0.32, np.hypot(1.6, 0.5), 200e3
    wrap, span = np.pi + 2 * np.arcsin(s / d), np.sqrt(d**2 - s**2)
    step, arcs = 110 / 0.32, s * wrap
    length = (2 * span + arcs) / (1 + 700 / EA)

    def excess(slack):
        spans = span / (1 + slack / EA) + span / (1 + (slack + step) / EA)
        return spans + arcs / (1 + (slack + step / 2) / EA) - length

    hand = {
        "wrap of both pulleys": (np.degrees(wrap), "deg", 2),
        "belt's path": (1e3 * (2 * span + arcs), "mm", 2),
        "tight span at rest": (brentq(excess, 1.0, 1e4, xtol=1e-12) + step, "N", 1),
    }
    drive, point = example("crossed_belt")
    rest = bj.reference_state(drive, point)
    at = rest.layout
    return hand, [
        np.degrees(float(at.wraps[0])),
        1e3 * float(at.path_length),
        float(np.max(rest.tensions)),
    ]


DRIVES = (
    v_belt_slide,
    six_pulley_accessory,
    starter_generator,
    timing_belt_eccentric,
    printer_axis,
    conveyor,
    combine_two_belts,
    crossed_belt,
)


@pytest.mark.parametrize("by_hand", DRIVES, ids=lambda one: one.__name__)
def test_three_numbers_of_each_drive_are_those_of_a_hand(by_hand):
    hand, found = by_hand()
    for (label, (value, unit, digits)), computed in zip(hand.items(), found, strict=True):
        assert computed == pytest.approx(value, rel=1e-9), label
        section = PAGE.read_text().split(f"examples/{by_hand.__name__}.toml")[1].split("\n## ")[0]
        shown = f"{value:.{digits}f} {unit}".strip()
        assert re.search(rf"^\| {re.escape(label)} \| {re.escape(shown)} \|$", section, re.M), (
            f"| {label} | {shown} |"
        )


def test_each_drive_has_its_file_and_its_picture():
    names = re.findall(r"examples/(\w+)\.toml", PAGE.read_text())
    assert names == [one.__name__ for one in DRIVES]
    for name in names:
        assert f"](images/gallery_{name}.svg)" in PAGE.read_text()
        assert (PAGE.parent / "images" / f"gallery_{name}.svg").stat().st_size > 1000
