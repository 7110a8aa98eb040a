"""Sweeps against closed forms, exact crossings and the spectrum at single points."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj
from beltjax.analysis.tracking import ModeShapes, agreement, aligned, linked
from beltjax.compiling.quick import quickly_compiled
from beltjax.results import explanation

BASIS = bj.Legendre(12)
FINE = bj.Legendre(20)  # where frequencies are compared with closed forms


@pytest.fixture(scope="module")
def strings():
    """Three pulleys with locked centers and a belt without bending: its spans do not interact."""
    drive, point = example("three_pulley")
    locked = tuple(eqx.tree_at(lambda p: p.on, pulley, jnp.zeros(0)) for pulley in drive.pulleys)
    # Heavy pulleys put the rotations far below the spans.
    heavy = tuple(eqx.tree_at(lambda p: p.inertia, pulley, jnp.array(10.0)) for pulley in locked)
    belt = bj.Belt(drive.belt.axial_stiffness, 0.0, drive.belt.mass_per_length)
    return bj.Drive(belt, heavy, drive.installation, sense=drive.sense), point


@pytest.fixture(scope="module")
def loaded(strings):
    return bj.sweep(*strings, "operation.torque.accessory", np.linspace(0, 4, 9), basis=FINE)


def _loaded(drive, point, torques):
    def state(torque):
        return bj.steady_state(drive, eqx.tree_at(lambda p: p.torque["accessory"], point, torque))

    return jax.vmap(state)(torques)


def of_strings(drive, point, torques):
    """n c (1 - v^2/c^2)/(2 l) of the first modes of each span [Hz], from the tensions alone."""
    steady = quickly_compiled(_loaded)(drive, point, jnp.asarray(torques))
    m, speed = float(drive.belt.mass_per_length), float(point.belt_speed)
    c = np.sqrt(np.asarray(steady.running_tensions) / m)
    first = (c - speed**2 / c) / (2 * np.asarray(steady.reference.layout.span_lengths))
    return first[:, :, None] * np.arange(1, 5)  # [points, spans, n]


def test_lines_of_uncoupled_spans_cross_rather_than_veer(strings, loaded):
    forms = of_strings(*strings, loaded.values).reshape(len(loaded.values), -1)
    hertz = loaded.frequencies / (2 * np.pi)
    spans = [k for k, label in enumerate(loaded.labels) if label.startswith("span")]
    crossed = 0
    for k in spans:
        # One closed form fits the whole column, on both sides of every crossing.
        misfit = np.max(np.abs(hertz[:, [k]] / forms - 1), axis=0)
        assert misfit.min() < 1e-8
        ranks = np.sum(hertz < hertz[:, [k]], axis=1)
        crossed += len(set(ranks)) > 1
    assert len(spans) >= 5
    assert crossed >= 2
    assert loaded.veerings == ()
    np.testing.assert_allclose(loaded.mac, 1.0, atol=2e-3)


def test_crossing_exactly_on_a_point(strings):
    def difference(torque):  # second mode of span 1, third of span 2
        forms = of_strings(*strings, [torque])[0]
        return forms[1, 1] - forms[2, 2]

    low, high = 0.0, 4.0
    assert difference(low) > 0 > difference(high)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if difference(middle) > 0 else (low, middle)
    values = [low - 0.4, low - 0.2, low, low + 0.2, low + 0.4]
    found = bj.sweep(*strings, "operation.torque.accessory", values, basis=FINE)
    forms = of_strings(*strings, found.values) * 2 * np.pi
    meeting = np.abs(found.frequencies[2] / forms[2, 1, 1] - 1) < 1e-9
    assert meeting.sum() == 2
    for form in (forms[:, 1, 1], forms[:, 2, 2]):
        misfit = np.max(np.abs(found.frequencies[:, meeting] / form[:, None] - 1), axis=0)
        assert misfit.min() < 1e-8
    assert len(found.values) == 5  # nothing to refine


def test_a_repeated_frequency_takes_the_shapes_it_had_before():
    eye = np.eye(3)
    before = ModeShapes(np.array([1.0, 1.1, 2.0]), eye + 0j, eye, np.diag([1.0, 1.21, 4.0]))
    angle = 0.7
    turn = np.array([[np.cos(angle), 1j * np.sin(angle)], [1j * np.sin(angle), np.cos(angle)]])
    mixed = np.array(eye + 0j)
    mixed[:2, :2] = turn
    here = ModeShapes(np.array([1.05, 1.05, 2.0]), mixed, eye, np.diag([1.05**2, 1.05**2, 4.0]))
    assert agreement(before, here)[0, 1] > 0.3
    np.testing.assert_allclose(agreement(before, aligned(before, here)), eye, atol=5e-3)


@pytest.mark.slow
def test_modes_of_one_gyroscopic_system_are_orthogonal():
    found = bj.sweep(*example("three_pulley"), "operation.belt_speed", [50.0, 50.1], basis=BASIS)
    assert np.nanmin(found.mac) > 0.9999
    drive, point = example("three_pulley")
    modes = quickly_compiled(_modes_at)(drive, point, jnp.array(50.0))
    lin = modes.linearization
    parts = (modes.dimensionless, modes.coordinates, lin.mass, lin.stiffness)
    one = ModeShapes(*(np.asarray(part) for part in parts))
    np.testing.assert_allclose(agreement(one, one), np.eye(8), atol=1e-12)
    in_mass = np.abs(one.vectors.conj() @ one.mass @ one.vectors.T) ** 2
    sizes = np.sqrt(np.diag(in_mass))
    assert np.max(in_mass / np.outer(sizes, sizes) - np.eye(8)) > 1e-2  # mass alone would not do


def _modes_at(drive, point, speed):
    moved = eqx.tree_at(lambda p: p.belt_speed, point, speed)
    lin = bj.linearize(bj.steady_state(drive, moved), BASIS, throw=False)
    return bj.modes(lin, route="hermitian", throw=False)


@pytest.fixture(scope="module")
def veered():
    values = np.linspace(-0.1, 0.1, 9)
    return bj.sweep(*example("three_pulley"), "pulley.accessory.center.x", values, basis=BASIS)


def test_grid_is_refined_where_modes_veer(veered):
    coarse, fine = np.linspace(-0.1, 0.1, 9), veered.values
    assert set(coarse) <= set(fine)
    assert len(fine) > len(coarse)
    assert np.all(np.diff(fine) > 0)
    assert veered.mac.shape == (len(fine) - 1, veered.frequencies.shape[1])
    assert np.nanmin(veered.mac) >= 0.9
    for veering in veered.veerings:
        assert veering.resolved
        low, high = veering.modes
        assert np.all(veered.frequencies[:, high] > veered.frequencies[:, low])


def test_gap_of_a_veering_is_that_of_a_fine_grid(veered):
    drive, point = example("three_pulley")
    veering = min(veered.veerings, key=lambda veering: veering.gap)
    near = veering.value + np.linspace(-0.01, 0.01, 64)
    fine = bj.sweep(drive, point, veered.name, near, basis=BASIS, depth=0)
    gaps = np.min(np.diff(np.sort(fine.frequencies, axis=1), axis=1)[:, veering.modes[0]])
    assert veering.gap == pytest.approx(gaps, rel=0.03)


def test_a_veering_too_sharp_for_the_grid_is_listed_as_unresolved(veered):
    drive, point = example("three_pulley")
    values = np.linspace(-0.1, 0.1, 4)
    coarse = bj.sweep(drive, point, veered.name, values, basis=BASIS, depth=0)
    assert len(coarse.values) == 4
    assert np.nanmin(coarse.mac) < 0.9
    assert any(not veering.resolved for veering in coarse.veerings)


def test_every_point_has_the_lowest_modes_of_that_point(veered):
    drive, point = example("three_pulley")
    for p in (0, len(veered.values) // 2, -1):
        center = drive.pulleys[2].center.at[0].set(veered.values[p])
        there = eqx.tree_at(lambda d: d.pulleys[2].center, drive, center)
        modes = quickly_compiled(_modes_at)(there, point, point.belt_speed)
        column = np.sort(veered.frequencies[p])
        np.testing.assert_allclose(column[:8], modes.frequencies, rtol=1e-9)


def test_a_mode_that_leaves_and_one_that_enters_are_not_taken_for_each_other():
    # Two of three oscillators are seen; the last seen falls out as the unseen one drops.
    def shapes(places):
        vectors = np.eye(3)[places] + 0j
        return ModeShapes(np.array([1.0, 2.0]), vectors, np.eye(3), np.eye(3))

    links, _ = linked([shapes([0, 1]), None, shapes([2, 0])], 2)
    assert links.names.tolist() == [[0, 1], [-1, -1], [2, 0]]
    assert links.mac[2].tolist() == pytest.approx([0.0, 0.9])  # the frequencies differ
    assert np.isnan(links.weakest).all()


def test_failed_points_say_why_and_leave_their_neighbors_alone(strings):
    found = bj.sweep(*strings, "operation.belt_speed", [30.0, 40.0, 50.0, 60.0, 90.0], basis=BASIS)
    assert found.good.tolist()[0]
    assert not found.good[-1]
    assert found.outcomes[-1] == explanation(bj.RESULTS.span_slack)
    assert np.isnan(found.frequencies[~found.good]).all()
    assert np.isnan(found.coupling[~found.good]).all()
    assert np.isfinite(found.frequencies[found.good][:, :8]).all()


def test_turning_the_tensioner_starts_from_the_drawn_layout():
    drive, point = example("three_pulley")
    found = bj.sweep(drive, point, "tensioner.angle", [-0.1, 0.0, 0.1], basis=BASIS)
    drawn = quickly_compiled(_modes_at)(drive, point, point.belt_speed)
    np.testing.assert_allclose(np.sort(found.frequencies[1])[:8], drawn.frequencies, rtol=1e-10)
    turned = bj.optimize.with_values(drive, {"tensioner.angle": jnp.array(0.1)})
    modes = quickly_compiled(_modes_at)(turned, point, point.belt_speed)
    np.testing.assert_allclose(np.sort(found.frequencies[-1])[:8], modes.frequencies, rtol=1e-10)


def test_dataset_carries_units_and_survives_a_file(veered, tmp_path):
    import xarray

    data = veered.to_xarray()
    assert data.frequency.attrs["units"] == "rad/s"
    assert data["value"].attrs == {"long_name": "pulley.accessory.center.x", "units": "m"}
    data.to_netcdf(tmp_path / "sweep.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="scipy") as again:
        np.testing.assert_array_equal(again.frequency, veered.frequencies)
        assert again.sel(mode=1).label.item() == veered.labels[0]
        assert set(again.outcome.values) == {"found"}


@pytest.mark.parametrize(
    ("name", "values", "options", "says"),
    [
        ("operation.belt_sped", [1, 2], {}, r"no number .* operation\.belt_speed"),
        ("pulley.gone.radius", [1, 2], {}, r"no number .* give for instance"),
        ("operation.torque.crankshaft", [1, 2], {}, "no number"),
        ("operation.belt_speed", [], {}, "values: .* at least 2"),
        ("operation.belt_speed", [1.0], {}, "values: .* at least 2"),
        ("operation.belt_speed", [2.0, 1.0], {}, "values: must be finite and increasing"),
        ("operation.belt_speed", [0.0, np.nan], {}, "values: must be finite and increasing"),
        ("operation.belt_speed", [1, 2], {"count": 0, "basis": BASIS}, "found 0; give 1 to 39"),
        ("operation.belt_speed", [1, 2], {"limit": 1.0}, "limit, depth: found 1.0"),
    ],
)  # fmt: skip
def test_bad_input(name, values, options, says):
    with pytest.raises(ValueError, match=says):
        bj.sweep(*example("three_pulley"), name, values, **options)
