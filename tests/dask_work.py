"""An answer that workers give quickly: they import nothing but NumPy for it."""

import time

import numpy as np


def echoed(packed, versions, values, size, quick):
    """In place of `answer_packed`."""
    time.sleep(0.05)
    return {"a": values}


def numbered(count):
    """Batches whose values are their numbers."""
    return ((number, np.array([float(number)])) for number in range(count))
