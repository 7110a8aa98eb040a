"""Belt in contact: the closed-form elastica against SciPy's `solve_bvp` inside root finders.

    python benchmarks/contact.py [--batch 1000] [two_pulley_table_5_1 seven_pulley]

The peer is `beltjax.validation.peers.contact` at its default tolerance, 1e-6; errors are those of
all tensions and
wraps, relative, against the peer at 1e-7 and 1e-11. "with slopes" is a value and the derivative of
the efficiency by every number of the drive, in reverse mode; its rate is compared with the
peer's for a value alone.
"""

import argparse
import resource
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from timing import Row, best_time, compiled, show

import beltjax as bj
from beltjax.analysis.contact import contact_solution
from beltjax.physics.belt_law import find_belt_law
from beltjax.validation.peers import contact as peer

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from contact_drives import peer_of  # noqa: E402

jax.config.update("jax_enable_x64", True)
NUMBERS = ("two_pulley_table_5_1", "seven_pulley")


def split(drive, point):
    """Numbers and the function that puts the drive together again."""
    numbers, rest = eqx.partition((drive, point), eqx.is_inexact_array)
    return numbers, lambda new: eqx.combine(new, rest)


def answer(drive, point, maximum):
    found = contact_solution(drive, point, find_belt_law("kong"), maximum)
    return found.efficiency, (jnp.concatenate([found.tensions.ravel(), found.wraps]), found.result)


def of_peer(state, order, spans):
    """The same numbers, of a belt that travels as listed."""
    assert np.all(order == spans)
    tensions = np.stack([state.tension_start, state.tension_middle, state.tension_end], axis=1)
    return np.concatenate([tensions.ravel(), state.wraps])


def timed(function, *arguments):
    start = time.perf_counter()
    result = function(*arguments)
    return result, time.perf_counter() - start


def rows(name: str, maximum: bool, size: int) -> list[Row]:
    drive, point = bj.load_drive(ROOT / "examples" / f"{name}.toml")
    question = jnp.asarray(float(maximum))
    theirs, order, spans = peer_of(drive, point)
    solve = peer.maximum_moment if maximum else peer.contact_state
    true = of_peer(solve(theirs, 1e-7, 1e-11), order, spans)
    loose, seconds = timed(solve, theirs)
    numbers, together = split(drive, point)

    def value(numbers):
        return answer(*together(numbers), maximum=question)

    def both(numbers):
        return jax.value_and_grad(value, has_aux=True)(numbers)

    def error(values):
        return float(np.max(np.abs(np.asarray(values) / true - 1)))

    table = []
    stretch = jnp.linspace(0.9, 1.1, size)
    many = jax.tree.map(lambda x: jnp.broadcast_to(x, (size, *x.shape)), numbers)
    many = eqx.tree_at(
        lambda n: n[0].belt.bending_stiffness,
        many,
        many[0].belt.bending_stiffness * stretch,
    )
    for way, function, given, batch in (
        ("one", value, numbers, 1),
        ("one with slopes", both, numbers, 1),
        ("batch", jax.vmap(value), many, size),
        ("batch with slopes", jax.vmap(both), many, size),
    ):
        program, wait = compiled(function, given)
        found = program(given)
        result = found[0][1] if "slopes" in way else found[1]
        wrong = error(result[0]) if batch == 1 else None
        table.append(Row(way, batch, wrong, None, wait, best_time(program, given) / batch))
        print(f"{name} {way}: compile {wait:.1f} s, run {1e6 * table[-1].run:.0f} us", flush=True)
    table.append(Row("SciPy", 1, error(of_peer(loose, order, spans)), None, None, seconds))
    return table


def main() -> None:
    """Print one row a way, for each drive."""
    parser = argparse.ArgumentParser(description="Belts in contact, against SciPy.")
    parser.add_argument("drives", nargs="*", default=NUMBERS)
    parser.add_argument("--batch", type=int, default=1000)
    given = parser.parse_args()
    for name in given.drives:
        for maximum in (False, True):
            title = f"{name}, {'maximum' if maximum else 'regular'}"
            show(title, "drive", rows(name, maximum, given.batch))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"peak memory {peak / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
