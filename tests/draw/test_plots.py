"""`.plot()` and what a notebook shows: pictures of drives and results, tables, no pytree dumps."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj


def test_a_notebook_shows_a_drive_as_a_picture_and_a_table():
    drive, _ = example("three_pulley")
    page = drive._repr_html_()
    assert page.startswith("<svg")
    assert "<caption>Drive</caption>" in page
    assert page == drive._repr_html_()  # one drive gives one text: notebooks are compared
    assert not re.search(r"(src|href)=\"(https?:)?//", page)
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), drive)
    assert batch._repr_html_().startswith("<pre>")
    with pytest.raises(ValueError, match="Drive: a picture is of one object"):
        batch.plot()


def test_a_steady_state_is_drawn_with_its_numbers(tmp_path):
    drive, point = example("three_pulley")
    steady = bj.steady_state(drive, point)
    layout, gamma, tension = steady.plot(drive).figure.axes
    assert [bar.get_width() for bar in gamma.patches] == pytest.approx(np.asarray(steady.coupling))
    drawn = [bar.get_width() for bar in tension.patches]
    assert drawn == pytest.approx(np.asarray(steady.running_tensions))
    load = float(jnp.linalg.norm(steady.hub_loads[2]))
    assert f"accessory\n{load:.0f} N" in [text.get_text() for text in layout.texts]
    assert len(steady.plot().figure.axes) == 2
    steady.plot(drive).save(tmp_path / "steady.svg")
    assert (tmp_path / "steady.svg").read_text().startswith("<?xml")


def test_frequencies_are_drawn_and_print_as_a_table():
    drive, point = example("three_pulley")
    heard = bj.span_frequencies(drive, point, count=1)
    (axes,) = heard.plot(drive).figure.axes
    drawn = [bar.get_width() for bar in axes.patches]
    assert drawn == pytest.approx(np.asarray(heard.hertz[:, 0]))
    assert [text.get_text() for text in axes.get_yticklabels()] == list(drive.span_names)
    assert "<td>result</td><td>successful</td>" in heard._repr_html_()
    assert repr(heard).splitlines()[0] == "SpanFrequencies"
    assert "Array(" not in repr(heard)


def test_what_has_no_picture_says_which_have():
    drive, point = example("three_pulley")
    with pytest.raises(
        TypeError, match=r"no picture of OperatingPoint; there are of .*SteadyState"
    ):
        point.plot()
    with pytest.raises(ValueError, match=r"needs the drive: give .plot\(drive\)"):
        bj.layout(drive).plot()
    assert bj.layout(drive).plot(drive).figure.axes


@pytest.mark.slow
def test_modes_are_drawn_by_whose_energy_they_have():
    drive, point = example("three_pulley")
    modes = bj.modes(bj.linearize(bj.steady_state(drive, point)), 4)
    (axes,) = modes.plot().figure.axes
    widths = np.array([bar.get_width() for bar in axes.patches]).reshape(3, 4)
    assert widths.sum(axis=0) == pytest.approx(np.ones(4))
    hertz = np.asarray(modes.frequencies) / (2 * np.pi)
    labels = [text.get_text() for text in axes.get_yticklabels()]
    assert labels == [f"{k + 1}: {f:.1f} Hz" for k, f in enumerate(hertz)]
