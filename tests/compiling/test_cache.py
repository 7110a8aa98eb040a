"""The cache of compiled programs: a second process compiles nothing, and no cache does no harm."""

import os
import stat
import subprocess
import sys

import jax
import jax.numpy as jnp
import pytest

import beltjax as bj

WORK = """
import sys
import jax

jax.config.update("jax_enable_x64", True)
events, seconds = [], []
jax.monitoring.register_event_listener(lambda event, **_: events.append(event))
import beltjax as bj

early = float(jax.jit(lambda x: x + 3)(4.0))  # JAX asks for its cache at the first program
assert bj.use_cache(*sys.argv[1:]) is not None
drive, point = bj.load_drive("examples/three_pulley.toml")
print(bj.layout(drive).path_lengths[0])
gradient = bj.quick_jit(jax.grad(lambda d: bj.layout(d, throw=False).path_lengths.sum()))
print(gradient(drive).pulleys[0].radius)
print(*(sum(e.endswith(end) for e in events) for end in ("cache_misses", "cache_hits")))
"""


def of_a_process(*words, **environment):
    found = subprocess.run(
        [sys.executable, "-c", WORK, *words],
        capture_output=True,
        text=True,
        timeout=200,
        env=os.environ | environment,
    )
    assert found.returncode == 0, found.stderr
    length, slope, counts = found.stdout.splitlines()
    return length, slope, *map(int, counts.split())


def test_a_second_process_compiles_nothing(tmp_path):
    folder = tmp_path / "kept"
    length, slope, missed, hit = of_a_process(str(folder))
    assert missed > 0
    assert hit < missed
    again = of_a_process(str(folder))
    assert again == (length, slope, 0, missed + hit)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.fixture
def untouched():
    """JAX's settings, as they were before."""
    names = [f"jax_{name}" for name in (
        "compilation_cache_dir",
        "persistent_cache_min_compile_time_secs",
        "persistent_cache_min_entry_size_bytes",
    )]  # fmt: skip
    before = {name: jax.config.values[name] for name in names}
    yield before
    for name, value in before.items():
        jax.config.update(name, value)
    bj.compiling.cache.compilation_cache.reset_cache()


def test_a_folder_that_is_not_the_users_own_is_not_used(tmp_path, untouched):
    shared, blocked = tmp_path / "shared", tmp_path / "file"
    shared.mkdir()
    shared.chmod(0o777)
    blocked.write_text("no folder")
    for folder in (shared, blocked / "below"):
        with pytest.warns(UserWarning, match="give a folder of your own"):
            assert bj.use_cache(folder) is None
        assert {name: jax.config.values[name] for name in untouched} == untouched
        assert float(jax.jit(lambda x: x + 1)(jnp.asarray(2.0))) == 3.0
    assert list(shared.iterdir()) == []


def test_the_folder_is_the_users_unless_the_environment_names_one(tmp_path, untouched, monkeypatch):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    if sys.platform == "linux":
        assert bj.use_cache() == tmp_path / "caches" / "beltjax"
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "named"))
    assert bj.use_cache() == tmp_path / "named"
    assert bj.use_cache(tmp_path / "given") == tmp_path / "given"


def test_a_folder_that_vanishes_does_no_harm(tmp_path, untouched):
    folder = bj.use_cache(tmp_path / "kept")
    folder.rmdir()
    (tmp_path / "kept").write_text("no folder any more")
    with pytest.warns(UserWarning, match="persistent compilation cache"):  # JAX's own
        assert float(jax.jit(lambda x: 5 * x)(jnp.asarray(2.0))) == 10.0
