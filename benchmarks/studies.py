"""A design study from many starts: the batched search against SciPy's SLSQP, one start a time.

    python benchmarks/studies.py [--starts 256] [--differences 16]

Every line: optimizer, starts, starts that reached the best optimum, its error against the best of
all (relative), time to compile, time to run, and time for one start. SLSQP gets exact derivatives
first, then only values, whose differences it takes itself, from fewer starts.
"""

import argparse
import dataclasses
import time
from pathlib import Path

import jax
import numpy as np
from scipy.optimize import minimize as scipy_minimize

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402

EXAMPLES = Path(__file__).parents[1] / "examples"
LOST = 1e3
problem, results = bj.optimize.problem, bj.optimize.search.results  # pyright: ignore[reportAttributeAccessIssue]
batched_search = bj.optimize.search.batched


def timed(function):
    start = time.perf_counter()
    return function(), time.perf_counter() - start


def batched(study, begin, look):
    """The augmented Lagrangian on all starts; compiled first, then run."""
    batched_search.FEW = 0  # compiled to run quickly, however few the starts
    tools = results.SearchTools(look, lambda *_: None, None, None)
    default = batched_search.AugmentedLagrangian()
    _, first = timed(lambda: default.search(study, begin, tools))
    found, again = timed(lambda: default.search(study, begin, tools))
    ends = [(e.objective, e.violation <= 1e-6 and e.converged) for e in found.outcomes]
    return ends, first - again, again


def one_by_one(look, points, exact):
    """SLSQP from every point; without `exact` it takes differences of values."""

    def values(x):
        at = look(np.clip(x, 0, 1))
        n = len(x)
        return (LOST, np.full(1, LOST)) if at is None else (at.f, at.c[: -2 * n])

    def run(x):
        n = len(x)
        rows = len(look(x).c) - 2 * n
        more = {"jac": lambda x: look(np.clip(x, 0, 1)).df} if exact else {}
        limit = {"type": "ineq", "fun": lambda x: -np.resize(values(x)[1], rows)}
        if exact:
            limit["jac"] = lambda x: -look(np.clip(x, 0, 1)).dc[: -2 * n]
        end = scipy_minimize(
            lambda x: values(x)[0], x, bounds=[(0, 1)] * n, constraints=limit, method="SLSQP",
            options={"ftol": 1e-10, "maxiter": 200}, **more,
        )  # fmt: skip
        f, c = values(end.x)
        return f, bool(np.max(c) <= 1e-6)

    ends, seconds = timed(lambda: [run(x) for x in points if look(x) is not None])
    return ends, seconds


def line(name, ends, best, compiling, running):
    reached = [f for f, good in ends if good and f <= best * (1 + 1e-6) + 1e-12]
    error = min((f for f, good in ends if good), default=np.inf) / best - 1
    print(
        f"{name:34s} {len(ends):6d} {len(reached):8d} {error:10.1e} {compiling:10.1f} s"
        f" {running:9.2f} s {1e3 * running / len(ends):10.2f} ms"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=256)
    parser.add_argument("--differences", type=int, default=16)
    parser.add_argument("--study", default="seven_pulley_study")
    asked = parser.parse_args()
    loaded = bj.optimize.load_study(EXAMPLES / f"{asked.study}.toml")
    study = problem.with_implied_constraints(dataclasses.replace(loaded, starts=asked.starts))
    begin = problem.starting_points(study)
    look = results.local_models(study, begin.scales, problem.limited_rows(study, begin.parts))
    points = np.asarray(begin.points)
    _, compiling = timed(lambda: look(points[0] + 1e-9))

    batch, compiled, running = batched(study, begin, look)
    exact, exactly = one_by_one(look, points, exact=True)
    few, roughly = one_by_one(look, points[: asked.differences], exact=False)
    best = min(f for ends in (batch, exact, few) for f, good in ends if good)
    columns = "starts  at best      error     compile       run   one start"
    print(f"{'optimizer':34s} {columns}")
    line("beltjax, one batch", batch, best, compiled, running)
    line("SLSQP, exact derivatives", exact, best, compiling, exactly)
    line("SLSQP, finite differences", few, best, compiling, roughly)
    each = running / len(batch)
    print(f"ratio to exact derivatives {exactly / len(exact) / each:.0f}")
    print(f"ratio to finite differences {roughly / len(few) / each:.0f}")


if __name__ == "__main__":
    main()
