"""Checkpoints: whatever happens to the file, one line or the very state that was saved."""

import io
import os
import random
import re

import jax.numpy as jnp
import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

Checkpoint = bj.optimize.checkpoint.Checkpoint
POINTS = jnp.arange(12.0).reshape(4, 3)
STATE = {"x": np.sqrt(np.arange(40.0)), "paths": np.full((2, 3, 2), np.nan), "valid": np.True_}


@pytest.fixture(scope="module")
def study():
    return bj.optimize.load_study(EXAMPLES / "three_pulley_study.toml")


@pytest.fixture
def saved(study, tmp_path):
    path = tmp_path / "state"
    kept = Checkpoint(path)
    assert kept.load(study, POINTS) is None
    kept.save(**STATE)
    return path


def test_what_is_saved_is_loaded(saved, study):
    found = Checkpoint(saved).load(study, POINTS)
    assert found is not None
    assert found.keys() == STATE.keys()
    for name, expected in STATE.items():
        np.testing.assert_array_equal(found[name], expected)


def test_other_points_are_another_search(saved, study):
    with pytest.raises(ValueError, match=r"state: is of another study or other numbers; remove it"):
        Checkpoint(saved).load(study, POINTS + 1e-12)


def test_every_truncation_and_flipped_bit_is_one_line(saved):
    whole, rng = saved.read_bytes(), random.Random(0)
    damaged = [whole[:size] for size in (0, 1, *rng.sample(range(len(whole)), 200))]
    for _ in range(300):
        flipped = bytearray(whole)
        flipped[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
        damaged.append(bytes(flipped))
    damaged += [bytes(len(whole)), whole + b"x", whole * 2]
    for content in damaged:
        saved.write_bytes(content)
        with pytest.raises(ValueError, match=r"state: is .*damaged.*; remove it to") as told:
            Checkpoint(saved)
        assert "\n" not in str(told.value)


def test_what_is_no_checkpoint_is_one_line(tmp_path):
    # As earlier versions wrote them.
    held = io.BytesIO()
    np.savez(held, key="a", **STATE)
    (tmp_path / "old.npz").write_bytes(held.getvalue())
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, says in (
        ("old.npz", "is no checkpoint of this version of beltjax, or damaged; remove it"),
        ("pipe", "is no file; give another path"),
        ("folder", "is no file; give another path"),
    ):
        with pytest.raises(ValueError, match=rf"{re.escape(name)}: {says}"):
            Checkpoint(tmp_path / name)


def test_it_is_read_before_the_work(study, tmp_path):
    (tmp_path / "state").write_bytes(b"")
    told = []
    with pytest.raises(ValueError, match=r"state: is no checkpoint"):
        bj.optimize.minimize(study, lambda *a: told.append(a), checkpoint=tmp_path / "state")
    assert told == []


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"pulley.tensioner.radius": np.nan}, r"warm: pulley\.tensioner\.radius: found nan; give"),
        ({}, r"warm: pulley\.tensioner\.radius: is missing; give each variable a finite value"),
    ],
)
def test_a_warm_design_is_finite_and_whole(values, says, study):
    with pytest.raises(ValueError, match=says):
        bj.optimize.minimize(study, warm=(values,))
