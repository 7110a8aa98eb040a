"""Explorations: right, whole after any interruption, and refused where they would mix."""

import json
import re
import resource
import shutil

import jax
import numpy as np
import pytest
import xarray
from drives import EXAMPLES, example
from explorations import BATCH, NUMBERS, QUANTITIES, explored, files
from scipy.stats import qmc

import beltjax as bj
from beltjax.commands.reports import explore as exploration
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.numbers import number_names, number_value, with_number, with_numbers
from beltjax.results import explanation, outcomes


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    store = tmp_path_factory.mktemp("whole") / "store.zarr"
    explored(store)
    return store


def test_quantities_are_those_of_the_single_design(whole):
    data = bj.optimize.open_exploration(whole)
    drive, point = example("three_pulley")

    @quickly_compiled
    def single(values):
        numbers = dict(zip(NUMBERS, values, strict=True))
        one = with_numbers(drive, point, numbers)
        steady = bj.steady_state(*one, throw=False)
        of = bj.optimize.DriveAnalyses(*one, steady)
        found = [bj.optimize.find_quantity(name, drive).measure(of) for name in QUANTITIES]
        return found, steady.result

    endings = set()
    for k in range(data.sizes["design"]):
        found, result = single(np.array([data[name][k].item() for name in NUMBERS]))
        endings.add(explanation(result))
        flags = dict(zip(data.result.flag_values, data.result.texts, strict=True))
        assert flags[data.result[k].item()] == explanation(result)
        for name, expected in zip(QUANTITIES, found, strict=True):
            value = np.atleast_1d(data[name][k].values)
            if result == bj.RESULTS.successful:
                np.testing.assert_allclose(value, expected, rtol=1e-12)
            else:
                assert np.isnan(value).all()
    assert len(endings) == 3  # successful, span_slack, numbers_unusable


def test_store_is_read_by_xarray_alone_with_units_and_names(whole):
    with xarray.open_zarr(whole) as data:  # dask or not, consolidated or not: no warning
        assert data["hub_load:accessory"].dims == ("design",)
        assert data["hub_load:accessory"].attrs["units"] == "N"
        assert data["clearance"].dims == ("design", "part of clearance")
        assert data["installation.tension"].attrs == {
            "long_name": "installation.tension",
            "units": "N",
        }
        names = data.result.attrs["flag_meanings"].split()
        slack = data.result.attrs["flag_values"][names.index("span_slack")]
        assert slack == outcomes()["span_slack"][0]
        assert data.result.dtype == np.int16


class StoppedError(Exception):
    """In place of a signal that kills."""


def stopping_after(batches):
    def advance(stage, done, total):
        if done >= batches * BATCH:
            raise StoppedError

    return advance


def test_resumed_store_is_the_same_to_the_bit(whole, tmp_path):
    store = tmp_path / "store.zarr"
    for batches in (1, 2, 5):
        with pytest.raises(StoppedError):
            explored(store, advance=stopping_after(batches))
    # What a killed writer may leave: data without their mark, torn, and a half-written file.
    marks = [int(path.name) for path in (store / "done" / "c").iterdir()]
    assert sorted(marks) == [0, 1, 2, 3, 4]
    torn = store / "coupling" / "c" / "5"
    torn.write_bytes((store / "coupling" / "c" / "4").read_bytes()[:7])
    (store / "coupling" / "c" / "6.0123456789abcdef.partial").write_bytes(b"torn")
    told = []
    explored(store, advance=lambda stage, done, total: told.append(done))
    assert told == [40, 48, 50]  # nothing is done twice
    assert files(store) == files(whole)


def test_finished_store_is_returned_without_computing(whole):
    before = files(whole)
    told = []
    data = explored(whole, advance=lambda *words: told.append(words))
    assert told == [("compiling", 50, 50)]
    assert data.sizes["design"] == 50
    assert files(whole) == before


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"count": 51}, r"store\.zarr: designs\.samples: was begun with 50 and is now to have 51"),
        ({"batch": 16}, r"batch: was begun with 8 .* 16; repeat the command that began it, or give"),
        ({"modes": 2}, r"modes: was begun with 0 and is now to have 2"),
    ],
)  # fmt: skip
def test_store_of_another_question_is_refused(change, says, whole):
    before = files(whole)
    with pytest.raises(bj.FileError, match=says):
        explored(whole, **change)
    assert files(whole) == before


def test_store_of_another_drive_is_refused(whole):
    drive, point = example("three_pulley")
    drive, point = with_number(drive, point, "pulley.tensioner.radius", np.array(0.05))
    designs = bj.optimize.Samples(NUMBERS, 50, seed=3)
    with pytest.raises(bj.FileError, match=r"drive\.pulley: was begun with .* give another path"):
        bj.optimize.explore(drive, point, designs, QUANTITIES, whole, batch=BATCH)


def test_path_that_holds_something_else_is_left_alone(tmp_path):
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.txt").write_text("mine")
    (tmp_path / "b.txt").write_text("mine")
    for name in ("notes", "b.txt"):
        with pytest.raises(bj.FileError, match=f"{name}: is there already and is no exploration"):
            explored(tmp_path / name)
    assert (tmp_path / "notes" / "a.txt").read_text() == "mine"


def test_store_has_one_writer(tmp_path):
    store = tmp_path / "store.zarr"

    def second(stage, done, total):
        if stage == "exploring":
            explored(store)

    with pytest.raises(bj.FileError, match=r"store\.zarr: another process is writing it; wait"):
        explored(store, advance=second)
    explored(store)  # the first has let go of it


def test_full_disk_leaves_what_is_written(whole, tmp_path):
    store = tmp_path / "store.zarr"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(stage, done, total):
        if done == 3 * BATCH:  # from now on the file system takes no bytes
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))

    says = (
        r"store\.zarr: the file system failed when batch 4 of 7 was written \(File too large\); "
        r"3 batches \(24 designs\) are intact: make room and repeat the command to go on$"
    )
    try:
        with pytest.raises(bj.FileError, match=says):
            explored(store, advance=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    explored(store)
    assert files(store) == files(whole)


def test_store_that_cannot_be_begun_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in ("file", "nothing"):
        with pytest.raises(bj.FileError, match=r"lies in no folder; give a path in one that"):
            explored(tmp_path / folder / "store.zarr")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        with pytest.raises(bj.FileError, match=r"file system failed when the store was begun \("):
            explored(tmp_path / "store.zarr")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_grid_is_every_combination_the_last_number_fastest():
    grid = bj.optimize.Grid({"a": [1.0, 2.0], "b": [3.0, 4.0, 5.0]})
    parts = list(grid.walk([(0, 4), (4, 6)]))
    expected = [[1, 3], [1, 4], [1, 5], [2, 3], [2, 4], [2, 5]]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    assert (grid.total, grid.shape) == (6, (2, 3))


def test_samples_are_one_sobol_sequence_however_it_is_cut():
    samples = bj.optimize.Samples({"a": (-1.0, 3.0), "b": (0.0, 1.0)}, 64, seed=7)
    expected = qmc.scale(qmc.Sobol(2, rng=7).random(64), [-1.0, 0.0], [3.0, 1.0])
    for cuts in ([(0, 64)], [(0, 5), (5, 64)]):
        np.testing.assert_array_equal(np.concatenate(list(samples.walk(cuts))), expected)
    later = np.concatenate(list(bj.optimize.exploration.samples.sobol(2, 7, [(3, 4), (40, 64)])))
    np.testing.assert_array_equal(later, qmc.Sobol(2, rng=7).random(64)[[3, *range(40, 64)]])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: bj.optimize.Grid({}), "at least one number"),
        (lambda: bj.optimize.Grid({"a": [1.0, np.nan]}), "a: give a list of at least one finite"),
        (lambda: bj.optimize.Samples({"a": (1.0, 1.0)}, 8), "a: found 1 to 1; give lower, then"),
        (lambda: bj.optimize.Samples({"a": (0.0, 1.0)}, 0), "samples: found 0; give 1 to"),
    ],
)
def test_designs_that_are_none(make, says):
    with pytest.raises(ValueError, match=says):
        make()


@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_numbers_set_to_what_they_are_change_nothing(name):
    drive, point = example(name)

    def everything(drive, point):
        return jax.tree.leaves((drive, point.speed(drive), point.torques(drive)))

    for key in number_names(drive):
        same = with_number(drive, point, key, number_value(drive, point, key))
        for a, b in zip(everything(drive, point), everything(*same), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-16)


def test_tensioner_turns_with_the_pivot_it_was_given_in_any_order():
    drive, point = example("three_pulley")
    turn, x = np.array(0.3), np.array(0.2)
    ways = [
        {"tensioner.angle": turn, "tensioner.pivot.x": x},
        {"tensioner.pivot.x": x, "tensioner.angle": turn},
    ]
    arms = [np.asarray(bj.layout(with_numbers(drive, point, way)[0]).arms[0]) for way in ways]
    np.testing.assert_array_equal(*arms)
    moved, _ = with_number(drive, point, "tensioner.pivot.x", x)
    a, b = complex(*np.asarray(bj.layout(moved).arms[0])), complex(*arms[0])
    assert b / a == pytest.approx(np.exp(0.3j))


EXPLORE = "explore", EXAMPLES / "three_pulley.toml", "--batch", BATCH
RANGES = [f"{name}={low}:{high}" for name, (low, high) in NUMBERS.items()]
ASKED = [word for name in QUANTITIES for word in ("--quantity", name)]
SAMPLED = *EXPLORE, "--over", RANGES[0], "--over", RANGES[1], "--samples", 50, "--seed", 3, *ASKED


def test_command_writes_the_same_store_and_summarizes_it(run, whole, tmp_path):
    status, out, err = run(*SAMPLED, "--out", "s.zarr", "--json", "s.json")
    assert (status, err) == (0, "")
    assert files(tmp_path / "s.zarr") == files(whole)
    document = json.loads((tmp_path / "s.json").read_text())
    data = bj.optimize.open_exploration(whole)
    gamma = document["quantities"][0]
    at = int(data.coupling.argmin("design"))
    assert gamma["least"]["value"] == float(data.coupling[at])
    assert gamma["least"]["at"] == {name: float(data[name][at]) for name in NUMBERS}
    assert gamma["mean"] == pytest.approx(float(data.coupling.mean()), rel=1e-14)
    counts = {row["result"]: row["designs"] for row in document["outcomes"]}
    assert counts["successful"] == gamma["found"] == int(data.coupling.notnull().sum())
    assert sum(counts.values()) == 50
    assert re.search(rf"span_slack +{counts['span_slack']}\b", out)
    status, out, _ = run(*SAMPLED, "--out", "s.zarr")
    assert (status, "0 designs in" in out) == (0, True)


def test_command_mends_a_damaged_store_and_says_so(run, whole, tmp_path):
    store = shutil.copytree(whole, tmp_path / "s.zarr")
    (store / "coupling" / "c" / "3").unlink()
    status, out, err = run(*SAMPLED, "--out", "s.zarr", "--json", "s.json")
    assert (status, err) == (0, "")
    told = "s.zarr was damaged; made anew: batch 4 (of 7)"
    assert told in out
    document = json.loads((tmp_path / "s.json").read_text())
    assert (document["repaired"], document["designs_before"]) == ([told], 42)
    assert files(store) == files(whole)


def test_store_damaged_while_it_is_read_is_one_line(run, whole, tmp_path, monkeypatch):
    store = shutil.copytree(whole, tmp_path / "s.zarr")
    dataset = bj.optimize.exploration.store.dataset

    def damaged(path):
        (store / "coupling" / "c" / "3").write_bytes(b"torn")
        return dataset(path)

    monkeypatch.setattr("beltjax.optimize.exploration.explore.dataset", damaged)
    status, out, err = run(*SAMPLED, "--out", "s.zarr")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert re.search(r"s\.zarr: was damaged while it was read \(.*\); repeat the command to", err)


BAD = {
    "two speeds": (["operation.belt_speed=1:2:2", "operation.driver_speed=1:2:2"], [], r"--over: .* are one speed"),
    "twice": (["installation.tension=1:2:2"] * 2, [], r"--over: 'installation\.tension' is given twice"),
    "no such number": (["noise=1:2:2"], [], r"--over: there is no number 'noise'"),
    "no points": (["installation.tension=1:2"], [], r"--over installation\.tension: found '1:2'; give FROM:TO:POINTS"),
    "points of a sample": (["installation.tension=1:2:3"], ["--samples", 8], r"found '1:2:3'; give FROM:TO, such as"),
    "no samples": (["installation.tension=1:2"], ["--samples", 0], r"--samples: samples: found 0; give 1"),
    "no such quantity": (["installation.tension=1:2:2"], ["--quantity", "noise"], r"there is no quantity 'noise'"),
    "twice a quantity": (["installation.tension=1:2:2"], ["--quantity", "coupling"] * 2, r"quantities: one is given twice"),
    "too many modes": (["installation.tension=1:2:2"], ["--modes", 1000], r"count: found 1000; give 1 to"),
    "no batch": (["installation.tension=1:2:2"], ["--batch", 0], r"batch: found 0; give at least 1"),
    "no processes": (["installation.tension=1:2:2"], ["--workers", 0], r"workers: found 0; give 1 to \d+ on this"),
    "fewer than none": (["installation.tension=1:2:2"], ["--workers", -2], r"workers: found -2; give 1"),
    "too many processes": (["installation.tension=1:2:2"], ["--workers", 10**6], r"workers: found 1000000; give 1"),
    "none of a scheduler's": (["installation.tension=1:2:2"], ["--workers", 0, "--scheduler", "x"], r"--workers: a scheduler has"),
    "seed": (["installation.tension=1:2"], ["--samples", 8, "--seed", -2], r"'--seed': -2 is not in the range x>=0"),
    "huge sample": (["installation.tension=1:2"], ["--samples", 10**14], r"samples: found 10{14}, 8e\+05 GB of numbers; give 1 to 2\^30"),
    "huge grid": ([f"{name}=1:2:100000" for name in NUMBERS], [], r"--over: grid: found 100000 x 100000 = 1e\+10 designs, 160 GB of numbers; give at most 2\^30"),
    "huge batch": (["installation.tension=1:2"], ["--samples", 10**9, "--batch", 10**9], r"batch: found 10{9}; give at least 1 and at most 65536"),
    "huge batch of modes": (["installation.tension=1:2"], ["--samples", 10**9, "--batch", 5000, "--modes", 1], r"batch: .* at most 4096"),
    "many batches": (["installation.tension=1:2"], ["--samples", 10**9, "--batch", 8], r"batch: found 8, which makes 125000000 files for each quantity; give at least 954"),
    "both": (["installation.tension=1:2:2"], ["--workers", 1, "--scheduler", "x"], r"--workers: a scheduler has its own"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_question_is_one_line_and_writes_nothing(case, run, tmp_path):
    over, more, says = BAD[case]
    words = [word for text in over for word in ("--over", text)]
    status, out, err = run(*EXPLORE[:2], *words, *more, "--out", "s.zarr")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert re.search(says, err)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "total", "own", "workers"),
    [
        ({"modes": 4}, 2000, True, 6),
        ({"modes": 0}, 10**6, True, None),  # formulas, which XLA shares between the cores
        ({"modes": 4}, 1999, True, None),  # done before the processes have begun
        ({"modes": 4, "workers": 1}, 10**6, True, 1),
        ({"modes": 4, "scheduler": "tcp://there:1"}, 10**6, True, None),
        ({"modes": 4}, 10**6, False, None),  # --extend: other processes lack what it registers
    ],
)  # fmt: skip
def test_modes_of_many_designs_have_a_process_for_each_core(
    words, total, own, workers, monkeypatch
):
    monkeypatch.setattr(exploration, "available_cores", lambda: 6)
    monkeypatch.setattr(exploration, "only_own_code", lambda: own)
    given = dict.fromkeys(exploration.ExploreOptions._fields) | words
    assert exploration._workers(exploration.ExploreOptions(**given), total) == workers


def test_progress_tells_rate_and_time_left_of_this_run(monkeypatch):
    clock, told = iter([0.0, 5.0, 7.0, 12.0]), []
    monkeypatch.setattr(exploration.time, "monotonic", lambda: next(clock))
    pace = exploration._Pace(lambda stage, done, total: told.append(stage))
    for stage, done in (("compiling", 1000), ("exploring", 1010), ("exploring", 1030)):
        pace(stage, done, 2000)
    assert told[-1] == "exploring: 1,030 of 2,000, 10 designs/s, 0:01:37 left"
    assert pace.before == 1000


def test_nothing_that_runs_is_an_answer(run, tmp_path):
    # The same order of numbers as above, and the same eight designs at once.
    words = "--over", RANGES[0] + ":4", "--over", "installation.tension=-50:-40:2", *ASKED
    status, _, err = run(*EXPLORE, *words, "--out", "s.zarr", "--json", "s.json")
    assert status == 2
    assert "no design succeeded: A number of the drive is not finite" in err
    assert json.loads((tmp_path / "s.json").read_text())["success"] is False
