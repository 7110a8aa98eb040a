"""Batches of linear algebra end on few cores."""

import os
import subprocess
import sys

# Twelve batched solves that do not need each other. Without the import this hangs on two cores.
_SOLVES = """
import beltjax
import jax, jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
count, batch, size = 12, 6, 40
shape = count, batch, size, size
given = jax.random.normal(jax.random.key(0), shape) + 20 * jnp.eye(size)

def step(x, _):
    solved = [jnp.linalg.solve(given[k] + x[k], x[k] + 1.0) for k in range(count)]
    return 0.1 * jnp.stack(solved), None

x, _ = jax.jit(lambda x: jax.lax.scan(step, x, None, length=100))(jnp.zeros(shape))
print(bool(jnp.all(jnp.isfinite(x))))
"""


def test_solves_at_a_time_do_not_wait_for_each_other():
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
    environment.pop("PJRT_NPROC", None)
    run = subprocess.run(
        [sys.executable, "-c", _SOLVES], env=environment, capture_output=True, text=True, timeout=60
    )
    assert run.stdout.strip() == "True", run.stderr


def test_a_number_of_threads_that_is_given_is_kept():
    environment = os.environ | {"PJRT_NPROC": "5"}
    code = "import os, beltjax; print(os.environ['PJRT_NPROC'])"
    run = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60
    )
    assert run.stdout.strip() == "5"
