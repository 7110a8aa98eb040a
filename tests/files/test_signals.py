"""Signals over time from files: units of their heads, and one line for what is wrong."""

import numpy as np
import pytest

import beltjax as bj
from beltjax.files.signals import read_signal

UNITS = {"speed": "rad/s", "angle": "rad"}


def test_units_stand_in_the_heads(tmp_path):
    path = tmp_path / "signal.csv"
    path.write_text("time (ms), speed [rpm]\n0,600\n500, 900\n\n1000,1200\n")
    found = read_signal(path, UNITS, 2)
    assert found.name == "speed"
    np.testing.assert_allclose(found.times, [0, 0.5, 1])
    np.testing.assert_allclose(found.values, np.array([600, 900, 1200]) * np.pi / 30)
    path.write_text("time,angle\n0,0.1\n1,0.2\n")  # bare numbers are SI
    np.testing.assert_allclose(read_signal(path, UNITS, 2).values, [0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: found nothing; head two columns time and speed or angle"),
        ("time,force\n0,1\n", "line 1: found 'time,force'; head two columns time and"),
        ("time,speed (kg)\n0,1\n", "line 1: speed: "),
        ("time,speed\n0,1\n1,fast\n", "row 3: found '1,fast'; give a time and a number"),
        ("time,speed\n0,1\n1\n", "row 3: found '1'; give a time and a number"),
        ("time,speed\n0,1\n", "found 1 rows; give at least 2"),
        (
            "time,speed\n1,1\n0,2\n",
            "row 3: the time 0 s is not after the one before; sort the rows",
        ),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, text, message):
    path = tmp_path / "signal.csv"
    path.write_text(text)
    with pytest.raises(bj.FileError) as error:
        read_signal(path, UNITS, 2)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
