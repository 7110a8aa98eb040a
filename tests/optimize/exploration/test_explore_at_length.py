"""The same store from a writer killed again and again, from a cluster, from two devices."""

import contextlib
import importlib
import os
import random
import socket
import subprocess
import sys
import time

import dask_work
import numpy as np
import psutil
import pytest
from drives import EXAMPLES, example
from explorations import explored, files

import beltjax as bj

DESIGNS = 2000
WORDS = "--over", "operation.torque.accessory=-40:10", "--over", "installation.tension=-50:900"
WORDS += "--samples", DESIGNS, "--batch", 8, "--quantity", "coupling", "--quantity", "clearance"


def command(store, *words):
    drive = EXAMPLES / "three_pulley.toml"
    words = [sys.executable, "-m", "beltjax", "explore", drive, *WORDS, "--out", store, *words]
    return [str(word) for word in words]


def marks(store):
    folder = store / "done" / "c"
    return len([path for path in folder.iterdir() if path.suffix == ""]) if folder.is_dir() else 0


def local_cluster():
    distributed = importlib.import_module("distributed")  # slow to load
    return distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    )


def worker_processes(pid=None):
    found = []
    for process in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it may just have ended
            if "spawn_main" in " ".join(process.cmdline()):
                found.append(process)
    return found


def own_cluster():
    """Address of a scheduler with one worker, and both processes."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    dask = [sys.executable, "-m", "dask"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    where = ["--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "scheduler", *where], **quiet)
    one = ["--nthreads", "1", "--nworkers", "1", "--no-nanny", "--no-dashboard"]
    worker = subprocess.Popen([*dask, "worker", address, *one], **quiet)
    return address, scheduler, worker


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_killed_ten_times_and_resumed_is_the_same_to_the_bit(tmp_path):
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "cache")}
    whole, store = tmp_path / "whole.zarr", tmp_path / "store.zarr"
    subprocess.run(command(whole), check=True, env=environment, capture_output=True)
    rng = random.Random(0)
    batches, seen = DESIGNS // 8, []
    for kill in range(10):
        process = subprocess.Popen(command(store), env=environment, stderr=subprocess.PIPE)
        # Once while the store is begun, then at any moment of computing and writing.
        if kill == 0:
            while not list(tmp_path.glob(".store.zarr.new*")):
                time.sleep(1e-4)
        else:
            while marks(store) < kill * batches // 11:
                time.sleep(1e-3)
            time.sleep(rng.uniform(0.0, 0.05))
        process.kill()
        process.communicate()
        assert process.returncode == -9
        seen.append(marks(store))
    assert seen[0] == 0
    assert all(np.diff(seen) > 0)
    assert seen[-1] < batches
    subprocess.run(command(store), check=True, env=environment, capture_output=True)
    assert files(store) == files(whole)
    assert not list(tmp_path.glob(".store*"))


@pytest.mark.slow
def test_two_dask_workers_write_the_same_store(tmp_path):
    for name, options in (("one.zarr", {}), ("two.zarr", {"workers": 2})):
        explored(tmp_path / name, **options)
    assert files(tmp_path / "one.zarr") == files(tmp_path / "two.zarr")


@pytest.mark.slow
def test_dask_cluster_at_an_address_writes_the_same_store(tmp_path):
    with local_cluster() as cluster:
        explored(tmp_path / "far.zarr", scheduler=cluster.scheduler_address)
    explored(tmp_path / "near.zarr")
    assert files(tmp_path / "far.zarr") == files(tmp_path / "near.zarr")


@pytest.mark.slow
def test_scheduler_that_does_not_answer_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr("beltjax.optimize.exploration.cluster._PATIENCE", 0.2)
    with pytest.raises(ValueError, match=r"scheduler: found 'tcp://127\.0\.0\.1:9', where none"):
        explored(tmp_path / "store.zarr", scheduler="tcp://127.0.0.1:9")
    assert list(tmp_path.iterdir()) == []


def test_worker_of_another_version_is_one_line():
    with pytest.raises(ValueError, match=r"a worker has .*'beltjax'.* install the same versions"):
        bj.optimize.exploration.cluster.answer_packed(
            b"", {"beltjax": "0.0"}, np.zeros((1, 1)), 1, True
        )


@pytest.mark.slow
def test_worker_that_is_killed_is_replaced(tmp_path):
    killed = []

    def kill(stage, done, total):
        if done == 16:
            for process in worker_processes():
                process.kill()
                killed.append(process.pid)

    explored(tmp_path / "store.zarr", workers=1, advance=kill)
    assert len(killed) == 1
    explored(tmp_path / "whole.zarr")
    assert files(tmp_path / "store.zarr") == files(tmp_path / "whole.zarr")


@pytest.mark.slow
def test_cluster_that_is_lost_is_one_line_and_the_store_goes_on(tmp_path):
    store = tmp_path / "store.zarr"
    cluster = local_cluster()

    def close(stage, done, total):
        if done == 16:
            cluster.close()

    with pytest.raises(ValueError, match=r"the cluster was lost; what is written is intact"):
        explored(store, scheduler=cluster.scheduler_address, advance=close)
    explored(store)
    explored(tmp_path / "whole.zarr")
    assert files(store) == files(tmp_path / "whole.zarr")


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_workers_killed_at_random_moments_cost_seconds(monkeypatch, capsys):
    # Dask tries for 30 s to reach a worker that died with a finished batch, one after the other.
    monkeypatch.setattr("beltjax.optimize.exploration.cluster.answer_packed", dask_work.echoed)
    rows = []
    for seed in range(5):
        rng = random.Random(seed)
        moments = sorted(rng.sample(range(1, 150), rng.choice((2, 3, 4))))
        pauses, last, found = [], time.monotonic(), []
        with bj.optimize.exploration.cluster.cluster(2, None) as client:
            batches = bj.optimize.exploration.cluster.on_cluster(
                client, None, dask_work.numbered(200), 8, quick=True
            )
            for number, columns in batches:
                now = time.monotonic()
                pauses.append(now - last)
                last = now
                assert columns["a"][0] == number
                found.append(number)
                # One of two workers, or both; some of them before they have come back.
                if moments and len(found) >= moments[0]:
                    moments.pop(0)
                    time.sleep(rng.uniform(0.0, 0.1))
                    for worker in worker_processes()[: rng.choice((1, 1, 2))]:
                        worker.kill()
        assert sorted(found) == list(range(200))
        rows.append(max(pauses))
    with capsys.disabled():
        print("\nlongest pauses [s]:", ", ".join(f"{pause:.1f}" for pause in rows))
    assert max(rows) < 28


@pytest.mark.slow
def test_worker_killed_before_it_has_started_is_one_line(tmp_path):
    process = subprocess.Popen(
        command(tmp_path / "store.zarr", "--workers", 1), stderr=subprocess.PIPE, text=True
    )
    while not worker_processes(process.pid):
        time.sleep(1e-3)
    for worker in worker_processes(process.pid):
        worker.kill()
    _, err = process.communicate()
    assert (process.returncode, err.count("\n")) == (1, 1)
    assert "beltjax: explore: workers: 1 processes could not be started (" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_scheduler_that_is_killed_is_one_line_and_the_store_goes_on(tmp_path):
    store = tmp_path / "store.zarr"
    address, *processes = own_cluster()
    try:
        process = subprocess.Popen(
            command(store, "--scheduler", address), stderr=subprocess.PIPE, text=True
        )
        while marks(store) < 3:
            time.sleep(1e-3)
        processes[0].kill()
        _, err = process.communicate()
    finally:
        for one in processes:
            one.kill()
            one.wait()
    assert (process.returncode, err.count("\n")) == (1, 1)
    assert "beltjax: explore: the cluster was lost; what is written is intact: repeat" in err
    done = marks(store)
    found = subprocess.run(command(store), check=True, capture_output=True, text=True)
    # What was marked when the scheduler died is not done again.
    assert f"{8 * done:,} were there before" in found.stdout


@pytest.mark.slow
def test_cluster_without_workers_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr("beltjax.optimize.exploration.cluster._ALONE", 1.5)
    distributed = importlib.import_module("distributed")
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as none,
        pytest.raises(ValueError, match=r"the cluster has had no worker for 1\.5 s; what is wri"),
    ):
        explored(tmp_path / "store.zarr", scheduler=none.scheduler_address)


@pytest.mark.slow
def test_two_devices_share_each_batch(tmp_path):
    # A batch of 8 is split in halves; one of 7 is filled up first.
    explored(tmp_path / "one.zarr")
    script = (
        "import jax; jax.config.update('jax_enable_x64', True)\n"
        "assert jax.local_device_count() == 2\n"
        "from explorations import explored\n"
        f"explored({str(tmp_path / 'two.zarr')!r})\n"
        f"explored({str(tmp_path / 'odd.zarr')!r}, batch=7)\n"
    )
    devices = " --xla_force_host_platform_device_count=2"
    environment = os.environ | {"XLA_FLAGS": os.environ["XLA_FLAGS"] + devices}
    subprocess.run(
        [sys.executable, "-c", script],
        check=True,
        env=environment | {"PYTHONPATH": os.path.dirname(__file__) + "/../.."},
    )
    one, two, odd = (
        bj.optimize.open_exploration(tmp_path / f"{name}.zarr") for name in ("one", "two", "odd")
    )
    for name in one.variables:
        if name != "done":
            for other in (two, odd):
                np.testing.assert_allclose(other[name], one[name], rtol=1e-11)


@pytest.mark.slow
def test_frequencies_are_those_of_the_single_design(tmp_path):
    drive, point = example("three_pulley")
    speeds, tensions = [0.0, 10.0, 20.0], [-1.0, float(drive.installation.tension)]
    grid = bj.optimize.Grid({"operation.belt_speed": speeds, "installation.tension": tensions})
    basis = bj.Legendre(12)
    store = tmp_path / "store.zarr"
    data = bj.optimize.explore(drive, point, grid, ["coupling"], store, modes=3, basis=basis)
    assert data.frequency.attrs["units"] == "rad/s"
    assert data.frequency.dims == ("design", "mode")
    for k, speed in zip((1, 3, 5), speeds, strict=True):
        steady = bj.steady_state(drive, bj.OperatingPoint(belt_speed=speed))
        alone = bj.modes(bj.linearize(steady, basis), 3)
        np.testing.assert_allclose(data.frequency[k], alone.frequencies, rtol=1e-9)
        assert np.isnan(data.frequency[k - 1]).all()
    with pytest.raises(bj.FileError, match=r"basis: was begun with .*12.* and is now to have"):
        bj.optimize.explore(drive, point, grid, ["coupling"], store, modes=3)


@pytest.mark.slow
def test_drive_slips_beyond_its_largest_torque(tmp_path):
    drive, point = example("two_pulley_table_5_1")
    (name,) = point.torque
    most = float(bj.maximum_moment(drive, point).torque_factor) * float(point.torque[name])
    grid = bj.optimize.Grid({f"operation.torque.{name}": most * np.array([0.5, 0.99, 1.01])})
    data = bj.optimize.explore(drive, point, grid, ["coupling", "efficiency"], tmp_path / "s.zarr")
    flags = dict(zip(data.result.flag_values, data.result.flag_meanings.split(), strict=True))
    results = [flags[code] for code in data.result.values]
    assert results == ["successful", "successful", "gross_slip"]
    assert np.isfinite(data.coupling).all()
    assert data.efficiency[0] > data.efficiency[1]
