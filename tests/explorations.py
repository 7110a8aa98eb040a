"""An exploration that several tests share, so that it compiles once."""

from pathlib import Path

from drives import example

import beltjax as bj

NUMBERS = {"operation.torque.accessory": (-40.0, 10.0), "installation.tension": (-50.0, 900.0)}
QUANTITIES = ("coupling", "hub_load:accessory", "clearance")
BATCH = 8


def explored(store, count=50, **options):
    """Fifty designs, some of which cannot run, in seven batches."""
    drive, point = example("three_pulley")
    designs = bj.optimize.Samples(NUMBERS, count, seed=3)
    options = {"batch": BATCH} | options
    return bj.optimize.explore(drive, point, designs, QUANTITIES, store, **options)


def files(store):
    """Content of every file of a store, by its path in it."""
    found = Path(store).rglob("*")
    return {path.relative_to(store): path.read_bytes() for path in found if path.is_file()}
