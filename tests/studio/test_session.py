"""The model of the page, without a browser: what is shown is what the library finds."""

import base64
import dataclasses
import json
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj
from beltjax.studio import described
from beltjax.studio.conversation import Conversation
from beltjax.studio.exports import exported
from beltjax.studio.opened import open_file
from beltjax.studio.page_file import open_any, page_bytes
from beltjax.studio.programs import Readout
from beltjax.studio.session import Session

STUDY = EXAMPLES / "three_pulley_study.toml"
GAMMA = "coupling_total"


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """The study without inertias, whose programs find no frequencies and soon compile."""
    folder = tmp_path_factory.mktemp("still")
    (folder / STUDY.name).write_text(STUDY.read_text())
    lines = (EXAMPLES / "three_pulley.toml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith("inertia")]
    (folder / "three_pulley.toml").write_text("\n".join(kept))
    return open_file(folder / STUDY.name)


@pytest.fixture
def session(still):
    return Session(still)


def shown(answer, name):
    start, size = answer["fields"][name]
    return np.array(answer["values"][start : start + size])


def slopes(session, answer):
    flat = np.frombuffer(base64.b64decode(answer["slopes"]), "<f8")
    return flat.reshape(-1, len(session.names))


def moved(session, values):
    session.set_numbers(values)
    return session.answer()


def test_what_is_shown_is_what_the_library_finds(session):
    answer = moved(session, {"pulley.tensioner.center.x": 0.37, "pulley.accessory.radius": 0.028})
    drive, point = bj.load_drive(EXAMPLES / "three_pulley.toml")
    values = {"pulley.tensioner.center.x": 0.37, "pulley.accessory.radius": 0.028}
    drive = bj.optimize.with_values(drive, jax.tree.map(jnp.asarray, values))
    steady = bj.steady_state(drive, point)
    at, close = steady.reference.layout, {"rel": 1e-12, "abs": 1e-12}
    assert shown(answer, "coupling") == pytest.approx(np.asarray(steady.coupling), **close)
    assert shown(answer, "wraps") == pytest.approx(np.asarray(at.wraps), **close)
    assert shown(answer, "tensions") == pytest.approx(np.asarray(steady.running_tensions), **close)
    loads = np.asarray(steady.hub_loads).ravel()
    assert shown(answer, "hub_loads") == pytest.approx(loads, **close)
    assert shown(answer, "effectiveness")[0] == pytest.approx(float(steady.effectiveness), **close)
    heard = np.asarray(bj.span_frequencies(drive, point, count=1).hertz[:, 0])
    assert shown(answer, "meter") == pytest.approx(heard, **close)
    assert answer["objective"] == pytest.approx(float(jnp.sum(steady.coupling)), **close)
    wrap = next(one for one in answer["limits"] if one["quantity"] == "wrap:tensioner")
    assert wrap["value"] == pytest.approx(float(at.wraps[1]), **close)
    assert wrap["distance"] == pytest.approx(float(at.wraps[1]) - np.radians(35), **close)
    assert sum(size for _, size in answer["fields"].values()) == len(answer["values"])
    assert tuple(answer["fields"]) == Readout._fields


def test_derivatives_say_what_a_small_move_does(session):
    names = ("pulley.tensioner.center.y", "pulley.accessory.radius", "tensioner.angle")
    before = session.answer()
    by, size = slopes(session, before), len(before["values"])
    rows = [*range(size), size, *range(size + 1, len(by))]

    def values(answer):
        limits = [one["value"] for one in answer["limits"]]
        return np.array([*answer["values"], answer["objective"], *limits])[rows]

    for name in names:
        step, ends = 1e-6, []
        for sign in (1, -1):
            at = Session(session.opened)
            ends.append(values(moved(at, {name: before["numbers"][name] + sign * step})))
        difference = (ends[0] - ends[1]) / (2 * step)
        exact = by[rows, session.names.index(name)]
        scale = np.maximum(np.abs(values(before)), np.abs(exact)) + 1e-3
        assert np.max(np.abs(difference - exact) / scale) < 2e-6, name


@pytest.mark.parametrize("key", ["center:1", "rim:2", "pivot:0", "arm:0"])
def test_an_arrow_points_downhill_and_its_length_is_the_gain(session, key):
    answer = session.answer()
    arrow, handle = answer["arrows"][key], next(h for h in session.handles if h.key == key)
    way, far = [arrow["x"], arrow["y"]], 1e-7
    if handle.kind == "arm":  # a meter of its pivot's way
        pivot, center = (shown(answer, n).reshape(-1, 2) for n in ("pivots", "centers"))
        way[0] /= np.linalg.norm(center[1] - pivot[0])
    ends = []
    for sign in (1, -1):
        at = Session(session.opened)
        steps = zip(handle.names, way, strict=False)
        values = {n[0]: answer["numbers"][n[0]] + sign * far * by for n, by in steps}
        ends.append(moved(at, values)["objective"])
    assert (ends[1] - ends[0]) / (2 * far) == pytest.approx(arrow["gain"], rel=1e-5)
    if handle.kind in ("center", "pivot"):  # no other direction gains as much
        across = {handle.names[0][0]: -way[1], handle.names[1][0]: way[0]}
        at = Session(session.opened)
        aside = moved(at, {n: answer["numbers"][n] + far * by for n, by in across.items()})
        assert aside["objective"] == pytest.approx(answer["objective"], abs=1e-11)


def test_a_drag_is_one_step_that_is_undone_and_redone_to_the_bit(session):
    first = session.answer()["values"]
    session.begin()
    for x in (0.36, 0.37, 0.38):
        session.move({"pulley.tensioner.center.x": x})
    session.end("dragged")
    after = session.answer()["values"]
    session.set_numbers({"tensioner.angle": 0.1})
    turned = session.answer()
    assert turned["numbers"]["tensioner.angle"] == pytest.approx(0.1, abs=1e-15)
    assert [session.undo(), session.undo(), session.undo()] == [True, True, False]
    assert session.answer()["values"] == first
    assert session.redo()
    assert session.answer()["values"] == after
    assert session.redo()
    assert session.answer()["values"] == turned["values"]
    assert not session.redo()
    session.undo()
    session.set_numbers({"pulley.accessory.radius": 0.03})
    assert not session.redo()  # a new way has been taken


def test_angles_count_from_the_file_however_often_the_arm_is_turned(session):
    session.set_numbers({"tensioner.angle": 0.2})
    session.set_numbers({"tensioner.angle": -0.1})
    once = Session(session.opened)
    once.set_numbers({"tensioner.angle": -0.1})
    assert session.answer()["values"] == pytest.approx(once.answer()["values"], rel=1e-12)


def test_numbers_that_a_study_ties_follow(session):
    ties = bj.optimize.Ties(
        ("pulley.tensioner.radius",), ("pulley.accessory.radius",), [1.5], [0.005]
    )
    session.study = dataclasses.replace(
        session.study,
        ties=ties,
        variables=bj.optimize.Limits(("pulley.accessory.radius",), [0.02], [0.04]),
    )
    session.set_numbers({"pulley.accessory.radius": 0.028})
    assert float(session.drive.pulleys[1].radius) == pytest.approx(0.047, abs=1e-15)
    session.set_numbers({"tensioner.angle": 0.1})  # what nothing is tied to
    assert float(session.drive.pulleys[1].radius) == pytest.approx(0.047, abs=1e-15)


def test_an_impossible_layout_names_the_pulley_and_the_reason(session):
    missed = moved(session, {"pulley.tensioner.center.y": 0.3})
    assert missed["fault"]["pulley"] == 1
    assert missed["fault"]["text"].startswith("tensioner: the belt does not touch this pulley")
    assert missed["arrows"] == {}
    over = moved(Session(session.opened), {"pulley.tensioner.center.x": 0.5})
    assert over["fault"]["text"].endswith("move them apart")
    with pytest.raises(ValueError, match="cannot be built"):
        exported(session, "toml")
    session.undo()
    assert session.answer()["fault"] is None


def test_numbers_that_are_none_are_refused_and_change_nothing(session):
    before = session.study
    for values, words in (
        ({"pulley.accessory.radius": -1.0}, "must be positive"),
        ({"pulley.accessory.radius": float("nan")}, "finite"),
        ({"pulley.nobody.radius": 1.0}, "there is no number"),
        ({"operation.driver_speed": 100.0}, "the file gives operation.belt_speed"),
    ):
        with pytest.raises(ValueError, match=words):
            session.set_numbers(values)
    assert session.study is before
    assert not session.past


@pytest.mark.slow
def test_a_band_is_the_library_s_linear_scatter(session):
    session.show_bands({"center": 2e-4, "radius": 0.0, "angle": 0.0, "tension": 0.0})
    answer = session.answer()
    names = [n for n in session.names if ".center." in n or ".pivot." in n]
    drive, point = session.drive, session.point

    def total(x):
        there = bj.optimize.with_values(drive, dict(zip(names, x, strict=True)))
        return jnp.sum(bj.steady_state(there, point, throw=False).coupling)

    nominal = jnp.array([answer["numbers"][name] for name in names])
    spread = bj.optimize.linear_moments(
        total, nominal, [bj.optimize.Normal(2e-4)] * len(names)
    ).deviation
    start = answer["fields"][GAMMA][0]
    assert answer["bands"][start] == pytest.approx(float(spread), rel=1e-9)


def test_tolerances_are_of_what_the_page_knows(session):
    with pytest.raises(ValueError, match="tolerance 'mass'"):
        session.show_bands({"mass": 1.0})
    with pytest.raises(ValueError, match="tolerance 'radius': give a number from 0 on"):
        session.show_bands({"radius": -1.0})
    assert session.answer()["bands"] is None


@pytest.mark.slow
def test_frequencies_over_speed_meet_those_at_the_point():
    session = Session(open_file(EXAMPLES / "seven_pulley_duties.toml"))
    assert session.cases == ["parking", "cruise", "top speed"]
    session.show(1)
    session.speeds = session.driver_speeds  # at the duties' own
    curves, answer = session.over_speed("center:3"), session.answer()
    exact = bj.modes(
        bj.linearize(bj.steady_state(session.drive, session.point), bj.Legendre(12)), 8
    )
    hertz = np.asarray(exact.frequencies) / (2 * np.pi)
    assert shown(answer, "frequencies") == pytest.approx(hertz, rel=1e-9)
    assert curves["hertz"][1] == pytest.approx(hertz, rel=2e-3)  # a coarser basis
    step = 1e-6
    session.set_numbers({"pulley.idler.center.x": session.answer()["numbers"]
                         ["pulley.idler.center.x"] + step})  # fmt: skip
    gained = np.array(session.over_speed()["hertz"]) - np.array(curves["hertz"])
    assert gained / step == pytest.approx(np.array(curves["slopes"][0]), rel=1e-2, abs=0.5)


def test_a_page_s_file_reopens_to_the_bit(session, tmp_path):
    session.set_numbers({"pulley.tensioner.center.x": 0.3712345678901234})
    session.set_numbers({"tensioner.angle": 0.0789})
    session.set_numbers({"operation.belt_speed": 21.5})
    view = {"shown": {"show-wraps": False}, "snap": "1", "orders": [2.0, 4.0], "idle": 700.0}
    path = tmp_path / "page.json"
    path.write_bytes(page_bytes(session, view))
    again = Session(open_any(path))
    assert again.answer()["values"] == pytest.approx(session.answer()["values"], rel=1e-13)
    assert again.answer()["numbers"]["tensioner.angle"] == pytest.approx(0.0789, abs=1e-14)
    assert described.drive_of(again)["view"] == view
    assert again.opened.texts == session.opened.texts
    assert page_bytes(again, view) == path.read_bytes()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"files": {}}, "files: is empty"),
        ({"files": {"../../../../../x.toml": ""}}, "lies elsewhere"),
        ({"files": {"x.toml": "belt = 1"}}, "x.toml: belt"),
        ({"case": -1}, "case: input should be greater"),
        ({"more": 1}, "more: extra inputs"),
        ({"case": 5}, "there is no operating point 5"),
        ({"numbers": {"pulley.nobody.radius": 1.0}}, "there is no number 'pulley.nobody.radius'"),
    ],
)
def test_a_damaged_page_is_refused_in_one_line(session, tmp_path, change, words):
    path = tmp_path / "page.json"
    path.write_text(json.dumps(json.loads(page_bytes(session, None)) | change))
    with pytest.raises(bj.FileError, match=words) as told:
        open_any(path)
    assert "\n" not in str(told.value)
    assert "/x/x/" not in str(told.value)  # no folder that the user knows nothing of


def test_a_saved_drive_is_the_one_that_is_shown(session, tmp_path):
    session.set_numbers({"pulley.tensioner.center.x": 0.3712345678901234})
    made = exported(session, "toml")
    assert made.name == "three_pulley_study.toml"
    path = tmp_path / made.name
    path.write_bytes(made.content)
    assert tomllib.loads(made.content.decode())["name"] == "three-pulley prototype"
    again, point = bj.load_drive(path)
    pairs = zip(*map(jax.tree.leaves, (again, session.drive)), strict=True)
    assert all(np.array_equal(one, other) for one, other in pairs)
    assert float(point.belt_speed) == float(session.point.belt_speed)
    for kind, begin in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("compared", b"\x89PNG")):
        assert exported(session, kind).content.startswith(begin)
    with pytest.raises(ValueError, match="there is no file 'exe'"):
        exported(session, "exe")


def test_pages_do_not_disturb_each_other_and_compile_nothing_anew(still):
    one, two = Conversation(still), Conversation(still)
    first = list(two.answers({"do": "hello"}))[1]["values"]
    one.session.set_numbers({"pulley.accessory.radius": 0.03})
    list(one.answers({"do": "end"}))
    assert next(two.answers({"do": "end"}))["values"] == first
    assert two.session._programs == one.session._programs
    assert two.session.judge._program is one.session.judge._program


def test_a_conversation_answers_errors_and_goes_on(still):
    talk = Conversation(still)
    for message, words in (
        ({"do": "fly"}, "nothing to do for 'fly'"),
        ({"do": "set"}, "values"),
        ({"do": "set", "values": {"x": "wide"}}, "wide"),
        ({"do": "set", "values": {"pulley.accessory.radius": 0}}, "must be positive"),
        ({"do": "case", "case": 7}, "no operating point 7"),
        ({"do": "open", "files": {"a.toml": "x"}}, "a.toml"),
        ({"do": "save", "kind": "exe"}, "no file"),
    ):
        (answer,) = [a for a in talk.answers(message) if a["is"] != "status"]
        assert answer["is"] == "error"
        assert words in answer["text"]
    answers = list(talk.answers({"do": "undo"}))
    assert answers[0]["is"] == "answer"
    json.dumps(answers, allow_nan=False)


@pytest.mark.slow
def test_a_drive_file_is_judged_by_what_every_drive_must_meet():
    session = Session(open_file(EXAMPLES / "three_pulley.toml"))
    limits = session.answer()["limits"]
    assert [one["quantity"] for one in limits] == [
        "clearance",
        "span_lengths",
        "wraps",
        "tightness",
    ]
    assert all(one["implied"] for one in limits)
    (told,) = Conversation(session.opened).answers({"do": "optimize"})
    assert "open a study" in told["text"]


@pytest.mark.slow
def test_a_search_from_here_is_that_of_the_library_from_one_start():
    talk, told = Conversation(open_file(STUDY)), []
    talk.listen(told.append)
    talk.session.set_numbers({"tensioner.angle": 0.1})
    list(talk.answers({"do": "optimize"}))
    refused = list(talk.answers({"do": "undo"}))
    talk._thread.join() if talk._thread else None
    assert refused[0]["text"] == "a search runs: stop it first"
    end = next(one for one in told if one.get("state") == "ended")
    assert end["success"]
    # README.md: the optimum of this study.
    after = {one["name"]: one["after"] for one in end["values"]}
    assert after["pulley.tensioner.radius"] == pytest.approx(0.060, abs=1e-9)
    assert after["pulley.accessory.radius"] == pytest.approx(0.03556, abs=1e-8)
    assert end["values"][2]["before"] == pytest.approx(0.1, abs=1e-12)
    assert any(one.get("is") == "answer" and one["moving"] for one in told)  # on the way
    assert talk.session.past[-1].what == "optimized from here"


@pytest.mark.slow
def test_a_search_stops_when_told_and_leaves_a_design_that_runs():
    talk, told = Conversation(open_file(STUDY)), []

    def tell(answer):
        told.append(answer)
        if answer.get("state") == "running" and "iteration 2" in answer["text"]:
            talk.stop()

    talk.listen(tell)
    list(talk.answers({"do": "optimize"}))
    talk._thread.join() if talk._thread else None
    end = next(one for one in told if one.get("state") == "ended")
    assert end["text"].startswith("stopped, and no optimum yet")
    assert not end["success"]
    assert talk.session.answer()["fault"] is None
    assert len(end["path"]) <= 3
