"""Quantities of studies, measured alone."""

import numpy as np

import beltjax as bj


def measured(drive, point, name):
    """Value of the quantity of this name; it must have been found."""
    steady = bj.steady_state(drive, point)
    analyses = bj.optimize.DriveAnalyses(drive, point, steady)
    found = bj.optimize.find_quantity(name, drive, point).measure(analyses)
    assert bool(analyses.all_found())
    return np.asarray(found)
