"""Programs kept between runs: the same answers, traced once, and no harm from a bad file."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.compiling import kept_programs as programs

TRACED = []


def doubled(numbers, power):
    TRACED.append(power)
    return {"values": numbers**power, "word": "kept"}


@pytest.fixture
def folder(tmp_path):
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    TRACED.clear()
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def kept_files(folder):
    return sorted(folder.glob("*.program"))


def test_a_second_run_traces_nothing(folder):
    numbers = jnp.array([1.0, 2.0, 3.0])
    for _ in range(2):
        found = programs.run_kept(doubled, numbers, 2)
        np.testing.assert_array_equal(found["values"], [1.0, 4.0, 9.0])
        assert found["word"] == "kept"
    np.testing.assert_array_equal(programs.run_kept(doubled, -numbers, 2)["values"], [1, 4, 9])
    assert TRACED == [2]
    assert len(kept_files(folder)) == 1


def test_what_it_depends_on_is_in_its_name(folder):
    programs.run_kept(doubled, jnp.ones(3), 2)
    programs.run_kept(doubled, jnp.ones(3), 3)
    programs.run_kept(doubled, jnp.ones(4), 2)
    assert TRACED == [2, 3, 2]
    assert len(kept_files(folder)) == 3


def test_a_spoiled_file_is_written_anew(folder):
    programs.run_kept(doubled, jnp.ones(3), 2)
    (kept,) = kept_files(folder)
    kept.write_bytes(b"half of someth")
    np.testing.assert_array_equal(programs.run_kept(doubled, jnp.ones(3), 2)["values"], 1.0)
    assert TRACED == [2, 2]
    programs.run_kept(doubled, jnp.ones(3), 2)
    assert TRACED == [2, 2]


def test_without_a_cache_it_just_runs(folder):
    jax.config.update("jax_compilation_cache_dir", None)
    np.testing.assert_array_equal(programs.run_kept(doubled, jnp.ones(3), 2)["values"], 1.0)
    assert kept_files(folder) == []


def test_a_folder_in_which_others_may_write_is_not_used(folder):
    programs.run_kept(doubled, jnp.ones(3), 2)
    folder.chmod(0o777)
    for _ in range(2):  # nothing is read there, and nothing written
        np.testing.assert_array_equal(programs.run_kept(doubled, jnp.ones(3), 2)["values"], 1.0)
        programs.run_kept(doubled, jnp.ones(4), 2)
    assert TRACED[:2] == [2, 2]
    assert len(kept_files(folder)) == 1
    folder.chmod(0o700)


SOLVED_ELSEWHERE = """
import jax, sys
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
from beltjax.compiling import kept_programs as programs

def lower(matrix):
    print("traced")
    return jax.numpy.linalg.cholesky(matrix)

print(float(programs.run_kept(lower, 4 * jax.numpy.eye(2))[0, 0]))
"""


def test_another_process_runs_it_with_its_matrix_routines(folder):
    # A program that is read brings no LAPACK with it: without it the process would crash.
    words = [sys.executable, "-c", SOLVED_ELSEWHERE, str(folder)]
    runs = [
        subprocess.run(words, capture_output=True, text=True, check=True, timeout=120).stdout
        for _ in range(2)
    ]
    assert [run.split() for run in runs] == [["traced", "2.0"], ["2.0"]]
