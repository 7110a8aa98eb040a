"""Coupling Gamma of the three-pulley drive and its derivative with respect to every number.

One claim: a design costs microseconds, with its exact gradient. Three ways to the same Gamma, in
one run, each with its true error against a collocation converged to 1e-10:

  beltjax        value, and value and gradient, of a whole drive under `vmap`
  NumPy          the same closed form, vectorized by hand: values only. What is gained over the
                 next row is due to the formula; what beltjax gains over this one is due to JAX.
  SciPy          `solve_bvp` (tolerance 1e-6) on the 17-state standard form, one design at a time

Two more drives have two arms, and two belts. Their Gamma is held against the stored reference of
the same drive (tests/data/bodies.json), and all slopes against differences of the peer that they
are compared with: `beltjax.validation.peers.bodies`, by SciPy's `root`, one design at a time.

    python benchmarks/coupling.py [--batch 10000] [--references 6]
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from timing import Row, best_time, compiled, show  # noqa: E402

import beltjax as bj  # noqa: E402
from beltjax.analysis.steady import steady_model  # noqa: E402
from beltjax.drive.numbers import named_numbers  # noqa: E402
from beltjax.validation.peers import bodies  # noqa: E402
from beltjax.validation.peers.standard_form import solve_standard_form  # noqa: E402

DRIVE = Path(__file__).parents[1] / "examples" / "three_pulley.toml"
CASES = Path(__file__).parents[1] / "tests" / "data" / "bodies.json"
WITHOUT_EFFECT = ("inertia", "friction", "isolator")  # on a steady state
LARGER = {"two arms, seven pulleys": "04", "two belts, ten pulleys": "18"}


def total_coupling(numbers):
    """Gamma of a drive at an operating point."""
    return jnp.sum(bj.steady_state(*numbers, throw=False).coupling)


def varied(numbers, batch, spread=0.03):
    """A batch of designs in which every number differs by a few per cent."""
    rng = np.random.default_rng(0)
    leaves, structure = jax.tree.flatten(numbers)
    flags = {1.0, -1.0, 0.0}  # faces, senses, which pulley drives: the same in all designs

    def vary(leaf):
        factor = rng.uniform(1 - spread, 1 + spread, (batch, *leaf.shape))
        keep = np.array([float(x) in flags for x in np.ravel(leaf)]).reshape(leaf.shape)
        return jnp.asarray(np.where(keep, leaf, leaf * factor))

    return jax.tree.unflatten(structure, [vary(leaf) for leaf in leaves])


def numpy_coupling(c):
    """Gamma of a batch, closed form in NumPy, for k > 2 and a torque-free reference state.

    `c` holds the numbers by their file keys, each with a leading batch axis.
    """
    names = ("crankshaft", "tensioner", "accessory")
    z = np.stack([c[f"pulley.{n}.center"] @ [1, 1j] for n in names], axis=-1)
    signed = np.stack([c[f"pulley.{n}.radius"] for n in names], axis=-1) * [1, -1, 1]
    arm = z[:, 1] - c["tensioner.pivot"] @ [1, 1j]
    P0 = c["installation.tension"][:, None]

    apart, rise = np.roll(z, -1, 1) - z, np.roll(signed, -1, 1) - signed
    length = np.sqrt(np.abs(apart) ** 2 - rise**2)
    e = apart * (length - 1j * rise) / np.abs(apart) ** 2
    side = np.array([1, -1, 0]) * (1j * arm / np.abs(arm))[:, None]
    rt = np.abs(arm)[:, None]
    a = (np.conj(1j * e) * side).real * rt / length
    D = -np.sum((np.conj(e) * side).real, axis=1, keepdims=True)

    mean = length.mean(1, keepdims=True)
    lam, rho, gam = length / mean, rt / mean, c["belt.axial_stiffness"][:, None] / P0
    eps = np.sqrt(c["belt.bending_stiffness"][:, None] / P0) / mean
    s2 = c["operation.belt_speed"][:, None] ** 2 * c["belt.mass_per_length"][:, None] / P0
    k_s = c["tensioner.stiffness"][:, None] / (P0 * rt)
    ks, ke = length / signed, length / np.roll(signed, -1, 1)
    stiff, F = (
        (eps / lam) ** 2,
        np.sum(lam / rho * a * (ke - ks) * (eps / lam) ** 2, 1, keepdims=True),
    )
    weight = lam / rho * a**2

    def residual(T):
        Q = 1 - s2 + T
        u = np.sqrt(stiff / Q)
        decay = np.exp(-1 / u)
        csch, coth = 2 * decay / (1 - decay**2), (1 + decay**2) / (1 - decay**2)
        same = u**3 * coth / 2 - u**4 + (u * csch) ** 2 / 2
        cross = u**4 - u**2 * (coth + u) * csch / 2
        th = ((T - s2) * D + F) / (k_s + np.sum(weight * Q, 1, keepdims=True))
        taken = ((a * th) ** 2 + (ks**2 + ke**2) * same + 2 * ks * ke * cross) / 2
        return np.sum(lam * (T / gam - taken), 1, keepdims=True) + rho * D * th, (u, coth, csch)

    T, last = 0.8 * s2, 0.8 * s2 + 1e-3  # secant: no derivative to write by hand
    value_last, _ = residual(last)
    for _ in range(9):
        value, _ = residual(T)
        step = value * (T - last) / np.where(value == value_last, 1.0, value - value_last)
        T, last, value_last = T - step, T, value
    _, (u, coth, csch) = residual(T)
    same, cross = (u * coth - csch**2) / 2, (coth - u) * csch / 2
    return np.sum((ks**2 + ke**2) * same + 2 * ks * ke * cross, axis=1)


def gradient_error(columns, gradient):
    """Largest relative difference to central differences of the NumPy form, per number."""
    worst = 0.0
    for name, slopes in gradient.items():
        values, slopes = columns[name], np.asarray(slopes)
        for place in np.ndindex(values.shape[1:]):
            at = (slice(None), *place)
            h = 1e-4 * np.maximum(np.abs(values[at]), 0.05)

            def shifted(by, name=name, at=at, values=values):
                moved = values.copy()
                moved[at] += by
                return numpy_coupling(columns | {name: moved})

            wide, narrow = (shifted(c * h) - shifted(-c * h) for c in (2, 1))
            difference = (8 * narrow - wide) / (12 * h)
            size = np.maximum(np.abs(slopes[at]), 1e-2)
            worst = max(worst, float(np.max(np.abs(difference - slopes[at]) / size)))
    return worst


def stored(number):
    """The drive of the stored case whose name begins so, at its point, and its Gamma."""
    cases = json.loads(CASES.read_text())["cases"]
    case = next(case for name, case in cases.items() if name.startswith(number))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.toml"
        path.write_text(case["file"])
        drive, point = bj.load_drive(path)
    model = bj.Model(arm_curvature=float(case["arm_curvature"]))
    drive = eqx.tree_at(lambda d: d.model, drive, model)
    return (drive, point), float(np.sum(case["steady"]["coupling"]))


def peer_numbers(named, drive):
    """The numbers of a drive by file keys as the peer takes them; who carries what is fixed."""
    own = ["pulley." + name for name in drive.pulley_names]
    arms = ["tensioner." + body.name for body in drive.tensioners]
    belts = ["belt." + belt.name for belt in drive.belts] if len(drive.belts) > 1 else ["belt"]
    torques = [named.get("operation.torque." + name, 0.0) for name in drive.pulley_names]
    radii = np.array([named[f"{name}.radius"] for name in own])
    one = "installation.tension"
    tension = [named[one]] if one in named else [named[f"{one}.{b.name}"] for b in drive.belts]
    return {
        "centers": [named[f"{name}.center"] for name in own],
        "radii": radii,
        "faces": drive.faces,
        "on": [pulley.on for pulley in drive.pulleys],
        "housed": [pulley.housed for pulley in drive.pulleys],
        "torques": torques,
        "pivots": [named[f"{name}.pivot"] for name in arms],
        "directions": [body.direction for body in drive.tensioners],
        "kind": [body.kind for body in drive.tensioners],
        "stiffness": [named[f"{name}.stiffness"] for name in arms],
        "locked": [body.locked for body in drive.tensioners],
        "stops": [body.stops for body in drive.tensioners],
        "seat": [body.on for body in drive.tensioners],
        "between": np.zeros((0, len(arms))),
        "rates": np.zeros(0),
        "EA": [named[f"{name}.axial_stiffness"] for name in belts],
        "EI": [named[f"{name}.bending_stiffness"] for name in belts],
        "mass": [named[f"{name}.mass_per_length"] for name in belts],
        "sense": np.broadcast_to(np.asarray(drive.sense), len(belts)),
        "tension": tension,
        "curvature": drive.model.arm_curvature,
        "speed": named["operation.driver_speed"] * (np.asarray(drive.drives) @ radii),
        "travel": 1.0,
    }


def larger_rows(name, number, batch):
    """A drive with two arms, or with two belts: values, values with slopes, and its peer."""
    numbers, gamma = stored(number)
    drive = numbers[0]
    designs = varied(numbers, batch, spread=0.005)
    named = {key: np.asarray(x) for key, x in named_numbers(*numbers).items()}

    def by_peer(named):
        return bodies.coupling(peer_numbers(named, drive), drive.loop_sizes)

    def difference(key, place):
        h = 1e-5 * max(abs(float(named[key][place])), 0.05)
        moved = [named[key].copy() for _ in range(2)]
        moved[0][place] += h
        moved[1][place] -= h
        up, down = (by_peer(named | {key: x}) for x in moved)
        return (up - down) / (2 * h)

    slopes = named_numbers(*jax.grad(total_coupling)(numbers), of=numbers)
    count, wrong_slope = sum(x.size for x in slopes.values()), 0.0
    felt = {key: x for key, x in slopes.items() if not any(word in key for word in WITHOUT_EFFECT)}
    assert all(np.all(slopes[key] == 0) for key in slopes.keys() - felt.keys())
    for key, found in felt.items():
        for place in np.ndindex(found.shape):
            size = max(abs(float(found[place])), 1e-2)
            off = abs(difference(key, place) - float(found[place])) / size
            wrong_slope = max(wrong_slope, off)
    start = time.perf_counter()
    peer = by_peer(named)
    seconds = time.perf_counter() - start

    wrong, rows = abs(float(total_coupling(numbers)) / gamma - 1), []
    for way, function, slope in (
        ("beltjax, value", total_coupling, None),
        (f"beltjax, value and {count} slopes", jax.value_and_grad(total_coupling), wrong_slope),
    ):
        run, wait = compiled(jax.vmap(function), designs)
        rows.append(Row(way, batch, wrong, slope, wait, best_time(run, designs) / batch))
    rows.append(Row("SciPy root, value", 1, abs(peer / gamma - 1), None, None, seconds))
    show(f"Coupling Gamma, {name}", "design", rows)


def main() -> None:
    """Print one row a way."""
    parser = argparse.ArgumentParser(description="Gamma and its gradient: beltjax, NumPy, SciPy.")
    parser.add_argument("--batch", type=int, default=10_000)
    # Designs that SciPy solves, both to time it and to 1e-10 for the true error.
    parser.add_argument("--references", type=int, default=6)
    given = parser.parse_args()
    batch, references = given.batch, given.references
    numbers = bj.load_drive(DRIVE)
    designs = varied(numbers, batch)
    count = sum(x.size for x in named_numbers(*numbers).values())

    value, value_compile = compiled(jax.vmap(total_coupling), designs)
    both, both_compile = compiled(jax.vmap(jax.value_and_grad(total_coupling)), designs)
    columns = {name: np.asarray(x) for name, x in named_numbers(*designs).items()}
    # The bare closed form has no reference state, so it cannot know these.
    absent = ("torque", "inertia")

    few = jax.tree.map(lambda x: x[:references], designs)
    groups = jax.vmap(lambda n: bj.steady_state(*n, throw=False).groups)(few)
    models = [steady_model(jax.tree.map(lambda x, i=i: x[i], groups)) for i in range(references)]
    truth = np.array([solve_standard_form(m, tol=1e-10).coupling.sum() for m in models])
    start = time.perf_counter()
    peers = [solve_standard_form(m, tol=1e-6) for m in models]
    scipy_time = (time.perf_counter() - start) / references

    def error(values):
        return float(np.max(np.abs(np.asarray(values)[:references] / truth - 1)))

    gamma, gradient = both(designs)
    slopes = {
        name: x
        for name, x in named_numbers(*gradient, of=designs).items()
        if not any(w in name for w in absent)
    }
    small = {name: x[:200] for name, x in columns.items()}
    slope_error = gradient_error(small, {name: x[:200] for name, x in slopes.items()})
    by_hand = best_time(numpy_coupling, columns) / batch
    show(
        "Coupling Gamma",
        "design",
        [
            Row("beltjax, value", batch, error(value(designs)), None, value_compile, best_time(value, designs) / batch),
            Row(f"beltjax, value and {count} slopes", batch, error(gamma), slope_error, both_compile, best_time(both, designs) / batch),
            Row("NumPy closed form, value", batch, error(numpy_coupling(columns)), None, None, by_hand),
            Row("SciPy solve_bvp 1e-6, value", 1, error([p.coupling.sum() for p in peers]), None, None, scipy_time),
        ],
    )  # fmt: skip
    for name, number in LARGER.items():
        larger_rows(name, number, batch)


if __name__ == "__main__":
    main()
