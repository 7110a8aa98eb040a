"""What there is to compile in each public function, and how long that takes.

One claim: a first answer waits seconds, not minutes. For each function, as a value and with its
slopes by every number of the drive (of `solve_bvp` by its argument, of a study by its variables):

  equations      of the program as JAX traced it, those of loops and inner functions included
  bounded        of what is lowered: the same traced again, with bounds to fusion, which
                 `bj.quick_jit` and `bj.thorough_jit` put into it
  instructions   of the program that XLA made of it, after its optimization for `bj.quick_jit`
  trace, lower   seconds of processor time; so is the rest
  quick          to compile as `bj.quick_jit` does
  thorough       to compile as `bj.thorough_jit` does, with --thorough

The error is that of the value against the same function compiled by XLA's own options, or where
--thorough is not given "-". Times are those of the processors, since other work on the machine adds
to any other time.

    python benchmarks/compile.py [--thorough] [--drive seven_pulley] [contact_state steady_state ...]
"""

import argparse
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jax.extend.core import ClosedJaxpr, Jaxpr, jaxpr_as_fun  # noqa: E402
from timing import print_table  # noqa: E402

import beltjax as bj  # noqa: E402
from beltjax.analysis.sensitivity import canonical_sensitivities  # noqa: E402
from beltjax.analysis.sweep import CHUNK, samples  # noqa: E402
from beltjax.compiling.fusion import with_bounded_fusion  # noqa: E402
from beltjax.compiling.quick import flat_call, quick_options, thorough_options  # noqa: E402
from beltjax.drive.canonical import canonical, canonical_name  # noqa: E402

problem = bj.optimize.problem  # pyright: ignore[reportAttributeAccessIssue]
EXAMPLES = Path(__file__).parents[1] / "examples"
BASIS = bj.Legendre(24)
MODES = 8
INSTRUCTION = re.compile(r"^\s*(?:ROOT )?%?[\w.\-]+ = ", re.MULTILINE)


class Case(NamedTuple):
    """A public function: what it is asked, and of which numbers."""

    value: Callable[..., Any]  # one number, or a whole answer where there are no slopes to take
    numbers: tuple[Any, ...]
    slopes: Callable[..., Any] | None  # the transformation that gives them, None without


def drive_cases(name: str) -> dict[str, Case]:
    """The questions about a drive."""
    drive, point = canonical(*bj.load_drive(EXAMPLES / f"{name}.toml"))
    numbers = (drive, point)
    crank = bj.Excitation(crank=0.01)

    def modes(drive, point):
        lin = bj.linearize(bj.steady_state(drive, point, throw=False), BASIS, throw=False)
        return jnp.sum(bj.modes(lin, MODES, route="hermitian", throw=False).frequencies)

    def response(drive, point):
        speeds = jnp.array([100.0, 200.0])
        found = bj.speed_response(drive, point, speeds, crank, basis=BASIS, throw=False)
        return jnp.sum(jnp.abs(found.rotations) ** 2)

    def swept(drive, point):
        radii = jnp.full(CHUNK, drive.pulleys[2].radius)
        key = f"pulley.{canonical_name(2)}.radius"
        return jnp.sum(samples(drive, point, key, radii, MODES, BASIS).frequencies)

    values = {
        "layout": lambda d, p: jnp.sum(bj.layout(d, throw=False).span_lengths),
        "reference_state": lambda d, p: jnp.sum(bj.reference_state(d, p, throw=False).tensions),
        "steady_state": lambda d, p: jnp.sum(bj.steady_state(d, p, throw=False).coupling),
        "modes": modes,
        "speed_response": response,
        "contact_state": lambda d, p: bj.contact_state(d, p, throw=False).efficiency,
        "maximum_moment": lambda d, p: bj.maximum_moment(d, p, throw=False).driver_moment,
        "sweep, 16 points": swept,
    }
    by_all = {name: Case(value, numbers, _by_all) for name, value in values.items()}
    whole = lambda d, p: canonical_sensitivities(d, p, MODES, bj.Legendre(40))  # noqa: E731
    return by_all | {"analyze": Case(whole, numbers, None)}


def other_cases() -> dict[str, Case]:
    """A boundary value problem, one evaluation of a study, and a belt on a cushion."""
    study = bj.optimize.load_study(EXAMPLES / "three_pulley_study.toml")
    scales = problem.starting_points(study).scales

    def bratu(factor):
        found = bj.solve_bvp(
            lambda x, y, p, args: jnp.stack([y[1], -args * jnp.exp(y[0])]),
            lambda ya, yb, p, args: jnp.stack([ya[0], yb[0]]),
            (0.0, 1.0), (np.array([0.0, 1.0]), np.zeros((2, 2))), args=factor,
            nodes=32, throw=False,
        )  # fmt: skip
        return found(0.5)[0]

    def evaluated(x):
        at = problem.evaluation(study.canonical, scales, x)
        return jnp.append(jnp.where(jnp.isfinite(at.constraints), at.constraints, 0), at.objective)

    soft = canonical(*bj.load_drive(EXAMPLES / "three_pulley_cushion.toml"))

    def on_cushion(drive, point):
        return jnp.sum(bj.cushion_state(drive, point, throw=False).coupling)

    middle = jnp.full(len(study.variables.names), 0.4)
    return {
        "solve_bvp": Case(bratu, (jnp.asarray(1.0),), jax.value_and_grad),
        "evaluation of a study": Case(evaluated, (middle,), _with_jacobian),
        "cushion_state, three pulleys": Case(on_cushion, soft, _by_all),
    }


def _by_all(value):
    """`value` of a drive and a point, and its slopes by every number of both."""
    return jax.value_and_grad(value, argnums=(0, 1))


def _with_jacobian(value):
    return lambda x: (value(x), jax.jacfwd(value)(x))


def equations(program: Jaxpr | ClosedJaxpr) -> int:
    """Count the equations of a program, those of the programs in it included."""
    inside = program.jaxpr if isinstance(program, ClosedJaxpr) else program
    return sum(1 + sum(map(equations, _parts(e.params))) for e in inside.eqns)


def _parts(parameters: Any) -> Iterator[Jaxpr | ClosedJaxpr]:
    for found in jax.tree.leaves(
        list(parameters.values()), is_leaf=lambda x: isinstance(x, Jaxpr | ClosedJaxpr)
    ):
        if isinstance(found, Jaxpr | ClosedJaxpr):
            yield found


def spent(work: Callable[[], Any]) -> tuple[Any, float]:
    """What `work` returns, and the processor time that it took [s]."""
    began = time.process_time()
    return work(), time.process_time() - began


def measured(function: Callable, numbers: tuple[Any, ...], thorough: bool) -> list[str]:
    """The columns of one function."""
    jax.clear_caches()
    call = flat_call(function, *numbers)
    plain, trace = spent(lambda: jax.make_jaxpr(call.function)(*call.arrays))
    bounded = jax.jit(with_bounded_fusion(jaxpr_as_fun(plain)))
    traced, again = spent(lambda: bounded.trace(*call.arrays))
    lowered, lower = spent(traced.lower)
    program, quick = spent(lambda: lowered.compile(quick_options()))
    instructions = len(INSTRUCTION.findall(program.as_text() or ""))
    columns = [f"{equations(plain):,}", f"{equations(traced.jaxpr):,}", f"{instructions:,}"]
    columns += [f"{x:.1f}" for x in (trace + again, lower, quick)]
    if not thorough:
        return ["-", *columns, "-", f"{trace + again + lower + quick:.1f}"]
    slow, seconds = spent(lambda: lowered.compile(thorough_options()))
    pairs = zip(program(*call.arrays), slow(*call.arrays), strict=True)
    wrong = max(float(np.max(np.abs(a - b), initial=0) / (np.max(np.abs(b), initial=0) or 1))
                for a, b in pairs if np.issubdtype(a.dtype, np.inexact))  # fmt: skip
    return [f"{wrong:.0e}", *columns, f"{seconds:.1f}", f"{trace + again + lower + quick:.1f}"]


def main() -> None:
    """Print one row for each function, and one for it with its slopes."""
    parser = argparse.ArgumentParser(description="What there is to compile, and its time.")
    parser.add_argument("functions", nargs="*")
    parser.add_argument("--drive", default="seven_pulley", metavar="EXAMPLE")
    parser.add_argument("--thorough", action="store_true", help="Compile by thorough_jit as well.")
    given = parser.parse_args()
    cases = drive_cases(given.drive)
    if not given.functions or any(name not in cases for name in given.functions):
        cases |= other_cases()
    unknown = [name for name in given.functions if name not in cases]
    if unknown:
        parser.error(f"found {', '.join(unknown)}; give some of {', '.join(cases)}")
    rows = []
    for name in given.functions or cases:
        case = cases[name]
        ways = [("", case.value)]
        if case.slopes is not None:
            ways.append((" and slopes", case.slopes(case.value)))
        for what, function in ways:
            rows.append([name + what, *measured(function, case.numbers, given.thorough)])
            print("  ".join(rows[-1]), flush=True)
    columns = ("function", "error", "equations", "bounded", "instructions",
               "trace (s)", "lower", "quick", "thorough", "all, quick")  # fmt: skip
    print_table(f"{given.drive}, {jax.default_backend()}", columns, rows)


if __name__ == "__main__":
    main()
