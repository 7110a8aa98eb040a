"""Damaged stores: never silent, one line that names what is intact, and mended by the command."""

import json
import random
import re
import shutil
import warnings

import numpy as np
import pytest
import zarr
from explorations import explored, files

import beltjax as bj

RECORD = {"designs": {"grid": {"a": [0.0]}}, "drive": {"of": 1.0 / 3.0}}
Column = bj.optimize.exploration.store.Column
COLUMNS = [Column("a", "m"), Column("gap/b", "N", 3)]
TOTAL, SIZE = 50, 8
REPEAT = "repeat the command that began it: it mends the store and computes only what is missing"


def answered(batch, store):
    start, stop = store.span(batch)
    at = np.arange(start, stop, dtype=float)
    # Nothing was found in the second batch: Zarr writes no chunk for it.
    parts = np.full((len(at), 3), np.nan) if batch == 1 else np.sqrt(at)[:, None] + [1.0, 2.0, 3.0]
    return {"result": np.zeros(len(at), np.int16), "a": at, "gap/b": parts}


def begun(path, record=RECORD):
    return bj.optimize.exploration.store.Store(path, record, COLUMNS, TOTAL, SIZE)


def finish(path, record=RECORD):
    """Do what is to be done; says which batches that were, and what was damaged."""
    with begun(path, record) as store:
        pending = store.pending()
        for batch in pending:
            store.write(batch, answered(batch, store))
        return pending, store.damage


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    store = tmp_path_factory.mktemp("damage") / "whole.zarr"
    finish(store)
    return store


@pytest.fixture
def store(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "s.zarr")


def flip(path, at=0.5, bit=3):
    content = bytearray(path.read_bytes())
    content[int(at * (len(content) - 1))] ^= 1 << bit
    path.write_bytes(content)


def cut(path, share=0.5):
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def exchange(one, other):
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


BATCHES = {
    "chunk deleted": (lambda s: (s / "a/c/3").unlink(), [3]),
    "chunk deleted where nothing else is": (lambda s: (s / "gap%2Fb/c/2/0").unlink(), [2]),
    "chunk cut": (lambda s: cut(s / "gap%2Fb/c/6/0"), [6]),
    "chunk emptied": (lambda s: cut(s / "result/c/0", 0), [0]),
    "chunk zeroed": (lambda s: (s / "a/c/1").write_bytes(bytes(4)), [1]),
    "checksum flipped": (lambda s: flip(s / "a/c/5", 1.0), [5]),
    "chunks exchanged": (lambda s: exchange(s / "a/c/0", s / "a/c/4"), [0, 4]),
    "chunk where none was": (lambda s: shutil.copytree(s / "gap%2Fb/c/0", s / "gap%2Fb/c/1"), [1]),
    "array of data deleted": (lambda s: shutil.rmtree(s / "a/c"), list(range(7))),
    "mark deleted": (lambda s: (s / "done/c/2").unlink(), [2]),
    "mark flipped": (lambda s: flip(s / "done/c/2"), [2]),
    "mark cut": (lambda s: cut(s / "done/c/2"), [2]),
    "marks exchanged": (lambda s: exchange(s / "done/c/2", s / "done/c/3"), [2, 3]),
}  # fmt: skip


@pytest.mark.parametrize("case", BATCHES)
def test_damaged_batches_are_named_and_computed_anew(case, store, whole):
    damage, batches = BATCHES[case]
    damage(store)
    which = f"batch{'es' * (len(batches) > 1)} {', '.join(str(batch + 1) for batch in batches)}"
    says = (
        rf"^\S*s\.zarr: is damaged or incomplete: {which}; {7 - len(batches)} of 7 batches are "
        rf"intact; {REPEAT}$"
    )
    with pytest.raises(bj.FileError, match=says):
        bj.optimize.open_exploration(store)
    computed, told = finish(store)
    assert computed == batches
    # A mark that is lost looks like a batch that was never finished.
    assert told == ("" if case == "mark deleted" else f"was damaged; made anew: {which} (of 7)")
    assert files(store) == files(whole)
    assert finish(store) == ([], "")


METADATA = {
    "store flipped": lambda s: flip(s / "zarr.json"),
    "store cut": lambda s: cut(s / "zarr.json"),
    "store deleted": lambda s: (s / "zarr.json").unlink(),
    "store nested": lambda s: (s / "zarr.json").write_text("[" * 100_000),
    "array flipped": lambda s: flip(s / "a" / "zarr.json"),
    "array cut": lambda s: cut(s / "result" / "zarr.json"),
    "array deleted": lambda s: (s / "gap%2Fb" / "zarr.json").unlink(),
    "marks deleted": lambda s: (s / "done" / "zarr.json").unlink(),
}


@pytest.mark.parametrize("case", METADATA)
def test_damaged_metadata_are_written_anew_and_nothing_is_computed(case, store, whole):
    METADATA[case](store)
    says = rf"^\S*s\.zarr: is damaged.*: its metadata \((\S+/)?zarr\.json\); .*; {REPEAT}$"
    with pytest.raises(bj.FileError, match=says):
        bj.optimize.open_exploration(store)
    assert finish(store) == ([], "was damaged; made anew: its metadata")
    assert files(store) == files(whole)


def test_every_byte_of_the_metadata_counts(store):
    # In the digits of a third, one more or less may be the same number.
    path = store / "zarr.json"
    text = path.read_text()
    assert "0.3333333333333333," in text or "0.3333333333333333\n" in text
    path.write_text(text.replace("0.3333333333333333", "0.33333333333333331"))
    with pytest.raises(bj.FileError, match=r"is damaged: its metadata \(zarr\.json\)"):
        bj.optimize.open_exploration(store)


def test_damage_in_two_places_is_one_line(store, whole):
    flip(store / "a" / "zarr.json")
    cut(store / "a/c/3")
    says = (
        r"is damaged or incomplete: its metadata \(a/zarr\.json\), batch 4; 6 of 7 batches are "
        r"intact; repeat"
    )
    with pytest.raises(bj.FileError, match=says):
        bj.optimize.open_exploration(store)
    assert finish(store) == ([3], "was damaged; made anew: its metadata, batch 4 (of 7)")
    assert files(store) == files(whole)


def test_chunk_of_another_exploration_is_found(store, whole, tmp_path):
    other = tmp_path / "other.zarr"
    finish(other, RECORD | {"drive": {"of": 2.0}})
    assert (other / "a/c/3").read_bytes() == (store / "a/c/3").read_bytes()
    for name in ("a/c/3", "result/c/3", "gap%2Fb/c/3/0", "done/c/3"):
        shutil.copy(other / name, store / name)
    with pytest.raises(bj.FileError, match=r"incomplete: batch 4; 6 of 7"):
        bj.optimize.open_exploration(store)
    assert finish(store)[0] == [3]


def test_metadata_of_another_exploration_are_not_written_over(store):
    flip(store / "zarr.json")
    before = files(store)
    with pytest.raises(bj.FileError, match=r"are damaged, and it was begun by another command; re"):
        begun(store, RECORD | {"drive": {"of": 2.0}})
    assert files(store) == before
    finish(store)  # the refused one holds no lock


def test_store_from_before_there_were_checksums_is_refused(tmp_path):
    old = tmp_path / "old.zarr"
    group = zarr.open_group(old, mode="w", zarr_format=3)
    group.attrs["exploration"] = RECORD
    group.create_array("done", shape=(7,), chunks=(1,), dtype="uint8", fill_value=0)
    before = files(old)
    says = r"old\.zarr: has no valid checksum: it is of an earlier version of beltjax, or damaged; "
    with pytest.raises(bj.FileError, match=says + "give another path"):
        begun(old)
    with pytest.raises(bj.FileError, match=says + r"`xarray\.open_zarr` may read it, unchecked"):
        bj.optimize.open_exploration(old)
    assert files(old) == before


def test_path_that_holds_no_store_is_one_line(tmp_path):
    with pytest.raises(bj.FileError, match=r"nothing: is not there; give the path of a store"):
        bj.optimize.open_exploration(tmp_path / "nothing")
    with pytest.raises(bj.FileError, match=r"is no exploration"):
        bj.optimize.open_exploration(tmp_path)


def test_unfinished_store_is_read_as_far_as_it_is_done(tmp_path):
    path = tmp_path / "s.zarr"
    with begun(path) as store:
        store.write(0, answered(0, store))
        # A reader meets the writer between a batch's data and its mark.
        columns = answered(2, store)
        for name in ("a", "result"):
            store._group[name][16:24] = columns[name]
        data = bj.optimize.open_exploration(path)
        assert np.isnan(data["gap%2Fb"].values).all(axis=1).sum() == 42
        assert (data.result.values == -1).sum() == 34
    # The writer is gone, and whether what it left without a mark is whole is not known.
    with pytest.raises(bj.FileError, match=r"incomplete: batch 3; 1 of 7 batches are"):
        bj.optimize.open_exploration(path)
    assert finish(path) == ([1, 2, 3, 4, 5, 6], "")


def test_any_reader_of_zarr_sees_a_flipped_bit(store):
    flip(store / "a/c/3", 0.9)
    with pytest.raises(ValueError, match=r"checksum do not match"):
        zarr.open_group(store, mode="r")["a"][:]


def test_directory_in_place_of_a_chunk_is_one_line(store):
    (store / "a/c/3").unlink()
    (store / "a/c/3").mkdir()
    with pytest.raises(bj.FileError, match=r"incomplete: batch 4; 6 of 7"):
        bj.optimize.open_exploration(store)
    says = r"failed when batch 4 of 7 was written \(.*\); 6 batches \(42 designs\) are intact"
    with pytest.raises(bj.FileError, match=says):
        finish(store)


KINDS = ("deleted", "cut", "flipped", "zeroed", "exchanged")


def damaged_at_random(store, rng):
    """Damage one to three files; says how and which, and how many batches that can touch."""
    paths = sorted(path for path in store.rglob("*") if path.is_file())
    # Chunks outnumber metadata, which are damaged as often here.
    documents = [path for path in paths if path.name == "zarr.json"]
    done, batches = [], set()
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.choice(KINDS)
        path = rng.choice(rng.choice((paths, documents)))
        other = rng.choice([p for p in paths if p != path])
        if not path.exists() or not other.exists():
            continue
        touched = [path]
        if kind == "deleted":
            path.unlink()
        elif kind == "cut":
            cut(path, rng.random())
        elif kind == "flipped":
            flip(path, rng.random(), rng.randrange(8))
        elif kind == "zeroed":
            path.write_bytes(bytes(path.stat().st_size))
        else:
            exchange(path, other)
            touched.append(other)
        for at in touched:
            place = at.relative_to(store).parts
            batches |= {int(place[2])} if len(place) > 2 else set()
        done.append(f"{kind} {'/'.join(path.relative_to(store).parts)}")
    return done, batches


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_hundred_random_damages_are_told_and_mended(tmp_path, capsys):
    whole = tmp_path / "whole.zarr"
    explored(whole)
    right = files(whole)
    lines, refused = [], 0
    for seed in range(100):
        store = shutil.copytree(whole, tmp_path / f"{seed}.zarr")
        damages, touched = damaged_at_random(store, random.Random(seed))
        before = files(store)
        if before != right:  # equal chunks may have been exchanged
            with pytest.raises(bj.FileError, match=r"^[^\n]+$") as told:
                bj.optimize.open_exploration(store)
            assert re.search(
                r"repeat the command|no valid checksum|no exploration", str(told.value)
            )
        done, refusal = [], ""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", bj.optimize.DamageWarning)
                explored(store, advance=lambda stage, n, total, done=done: done.append(n))
        except bj.FileError as error:
            refusal = str(error)
        if refusal:  # both copies of what was asked are lost: nothing is touched
            assert sum("zarr.json" in damage for damage in damages) >= 2
            assert "\n" not in refusal
            assert files(store) == before
        else:
            assert files(store) == right
            assert len(done) - 1 <= len(touched)  # batches computed
        refused += bool(refusal)
        end = "refused" if refusal else f"mended, {len(done) - 1} computed"
        lines.append(f"{seed:3d}  {end:18s}  {'; '.join(damages)}")
        shutil.rmtree(store)
    with capsys.disabled():
        print("\n" + "\n".join(lines))
        print(f"{100 - refused} mended to the bit, {refused} refused; 0 silent, 0 tracebacks")
    assert refused <= 5


def test_the_checksum_is_left_out_of_itself_alone(whole):
    found = json.loads((whole / "zarr.json").read_text())["attributes"]
    assert re.fullmatch("[0-9a-f]{64}", found["checksum"])
    assert found["exploration"] == RECORD
