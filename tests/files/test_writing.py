"""Outputs: complete or absent, alone or together, and never on top of what is read."""

import errno
import os
import shutil
import stat

import pytest
from drives import EXAMPLES

from beltjax.files import writing
from beltjax.files.writing import made_private, write_together, write_whole


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_a_link_is_kept_and_what_it_names_is_written(tmp_path):
    (tmp_path / "far").mkdir()
    for name, target in (("one", "far/one"), ("new", "far/new"), ("two", "one")):
        (tmp_path / name).symlink_to(target)
    (tmp_path / "far" / "one").write_text("old")
    write_whole(tmp_path / "two", b"1")
    write_whole(tmp_path / "new", b"2")
    assert all((tmp_path / name).is_symlink() for name in ("one", "new", "two"))
    assert (tmp_path / "far" / "one").read_text() == "1"
    assert (tmp_path / "far" / "new").read_text() == "2"
    assert sorted(os.listdir(tmp_path / "far")) == ["new", "one"]


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="one file system only")
def test_a_link_to_another_file_system_is_kept(tmp_path):
    far = f"/dev/shm/beltjax-{os.getpid()}"
    try:
        (tmp_path / "link").symlink_to(far)
        write_whole(tmp_path / "link", b"1")
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "link").read_text() == "1"
    finally:
        os.unlink(far)


def test_a_file_keeps_its_mode_and_a_new_one_gets_the_usual(tmp_path):
    before = os.umask(0o027)
    try:
        for wanted in (0o600, 0o664, 0o755):
            (tmp_path / "old").write_text("old")
            (tmp_path / "old").chmod(wanted)
            write_whole(tmp_path / "old", b"new")
            assert mode(tmp_path / "old") == wanted
        write_whole(tmp_path / "new", b"")
        assert mode(tmp_path / "new") == 0o640
    finally:
        os.umask(before)


def test_a_read_only_file_is_refused(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "old").chmod(0o444)
    with pytest.raises(PermissionError, match="read-only") as caught:
        write_together([(tmp_path / "new", b"new"), (tmp_path / "old", b"new")])
    assert caught.value.filename == str(tmp_path / "old")
    assert os.listdir(tmp_path) == ["old"]
    assert (tmp_path / "old").read_text() == "old"


@pytest.mark.parametrize("fails", [1, 2])
def test_a_full_disk_names_the_file_and_leaves_no_part_of_a_set(fails, tmp_path, monkeypatch):
    (tmp_path / "one").write_text("old")
    sync, calls = os.fsync, []

    def full(handle):
        calls.append(handle)
        if len(calls) == fails:
            raise OSError(errno.ENOSPC, "No space left on device")
        sync(handle)

    monkeypatch.setattr(writing.os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_together([(tmp_path / "one", b"1"), (tmp_path / "two", b"2")])
    assert caught.value.filename == str(tmp_path / ("one", "two")[fails - 1])
    assert os.listdir(tmp_path) == ["one"]
    assert (tmp_path / "one").read_text() == "old"


def test_data_are_on_the_disk_before_the_move(tmp_path, monkeypatch):
    done = []
    sync, move = os.fsync, os.replace
    monkeypatch.setattr(writing.os, "fsync", lambda handle: (done.append("sync"), sync(handle)))
    monkeypatch.setattr(writing.os, "replace", lambda a, b: (done.append("move"), move(a, b)))
    write_together([(tmp_path / "one", b"1"), (tmp_path / "two", b"2")])
    assert done[:3] == ["sync", "sync", "move"]


def test_a_folder_is_private_where_its_owner_alone_may_write(tmp_path):
    new = tmp_path / "a" / "b"
    assert made_private(new)
    assert mode(new) == 0o700
    for bits, private in ((0o755, True), (0o775, False), (0o757, False), (0o700, True)):
        new.chmod(bits)
        assert made_private(new) is private
    (tmp_path / "file").write_text("")
    assert not made_private(tmp_path / "file")
    if os.getuid() == 0:
        os.chown(new, 12345, -1)
        assert not made_private(new)


@pytest.fixture
def files(tmp_path):
    """A study and its drive, each under a second name, a hard link and a symbolic one."""
    for source, name in (("three_pulley_study.toml", "study"), ("three_pulley.toml", "drive")):
        shutil.copy(EXAMPLES / source, tmp_path / source)
        os.link(tmp_path / source, tmp_path / f"{name}_hard.png")
        (tmp_path / f"{name}_soft.png").symlink_to(source)
    return {path.name: path.read_bytes() for path in tmp_path.iterdir()}


STUDY = "optimize", "three_pulley_study.toml"
DRIVE = "analyze", "three_pulley.toml"
READ = "is a file that is read; give another"
TWICE = "is given for two outputs"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((*STUDY, "--out", "three_pulley.toml"), f"three_pulley.toml: {READ}"),
        ((*STUDY, "--json", "./three_pulley_study.toml"), READ),
        ((*STUDY, "--figure", "drive_hard.png"), f"drive_hard.png: {READ}"),
        ((*STUDY, "--report", "drive_soft.png"), READ),
        ((*STUDY, "--checkpoint", "study_hard.png"), READ),
        ((*STUDY, "--json", "x", "--checkpoint", "x"), f"x: {TWICE}; give two"),
        ((*STUDY, "--json", "x", "--out", "../{here}/x"), f"{TWICE}, also as x"),
        (("pareto", STUDY[1], "--figure", "drive_soft.png"), READ),
        ((*DRIVE, "--json", "x.png", "--figure", "x.png"), TWICE),
        ((*DRIVE, "--figure", "drive_hard.png"), READ),
        (("contact", DRIVE[1], "--figure", "x.png", "--compare", "x.png"), TWICE),
        (("sweep", DRIVE[1], "--over", "a=1:2:3", "--netcdf", "drive_soft.png"), READ),
        (("response", DRIVE[1], "--json", "drive_hard.png"), READ),
        (("robust", DRIVE[1], "--json", "drive_hard.png"), READ),
        (("explore", DRIVE[1], "--over", "a=1:2:3", "--out", DRIVE[1]), READ),
        (("explore", DRIVE[1], "--over", "a=1:2:3", "--out", "x", "--json", "x"), TWICE),
    ],
)
def test_outputs_that_would_destroy_something_are_refused(words, says, run, files, tmp_path):
    status, out, err = run(*(word.format(here=tmp_path.name) for word in words))
    assert (status, out) == (1, "")
    assert says in err
    assert err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files


def test_a_read_only_output_is_refused_before_the_work(run, files, tmp_path):
    (tmp_path / "out.json").write_text("{}")
    (tmp_path / "out.json").chmod(0o400)
    status, _, err = run(*DRIVE, "--json", "out.json")
    assert status == 1
    assert "out.json: is read-only" in err
