"""Problems of the literature in the unit box, as optimizers on the host take them."""

import numpy as np

import beltjax as bj

# W. Hock and K. Schittkowski, Test Examples for Nonlinear Programming Codes (1981), problem 71.
HS71_OPTIMUM = np.array([1.0, 4.7429994, 3.8211503, 1.3794082])
HS71_VALUE = 17.0140173


def hs71(x):
    """Product at least 25, sum of squares 40; 1 <= x <= 5 is the unit box."""
    y = 1 + 4 * np.asarray(x)
    total = y[0] + y[1] + y[2]
    f = y[0] * y[3] * total + y[2]
    df = np.array([y[3] * (total + y[0]), y[0] * y[3], y[0] * y[3] + 1, y[0] * total])
    product, squares = np.prod(y), np.sum(y**2)
    c = np.array([25 - product, squares - 40, 40 - squares])
    dc = np.stack([-product / y, 2 * y, -2 * y])
    return local(x, f, c, 4 * df, 4 * dc)


def local(x, f, c, df, dc):
    """With the box's bounds after the constraints."""
    x, eye = np.asarray(x, float), np.eye(len(x))
    return bj.optimize.optimality.LocalModel(
        x,
        float(f),
        np.concatenate([c, -x, x - 1]),
        np.asarray(df, float),
        np.concatenate([np.reshape(dc, (-1, len(x))), -eye, eye]),
    )
