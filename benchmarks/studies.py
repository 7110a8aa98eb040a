"""A design study from many starts: the batched searches against SciPy's SLSQP, one start a time.

    python benchmarks/studies.py [--starts 256] [--differences 16] [--exact 256] [--cpu]

Every line: optimizer, starts, starts that reached the best optimum, its error against the best of
all (relative), time to compile, time to run, and time for one start. SLSQP gets exact derivatives
first, then only values, whose differences it takes itself, from fewer starts. `--cpu` counts the
processors' seconds instead of those on the wall, for a machine that does other work as well.
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
search = bj.optimize.search
BATCHED = {
    "SQP, in batches": (search.batched_sqp, "sqp"),
    "augmented Lagrangian, one batch": (search.batched, "augmented-lagrangian"),
}
clock = time.perf_counter


def timed(function):
    start = clock()
    return function(), clock() - start


def batched(module, method, study, begin, look):
    """A search from all starts together; compiled first, then run."""
    module.FEW = 0  # compiled to run quickly, however few the starts
    tools = results.SearchTools(look, lambda *_: None, None, None)
    optimizer = bj.optimize.find_optimizer(method)
    _, first = timed(lambda: optimizer.search(study, begin, tools))
    found, again = timed(lambda: optimizer.search(study, begin, tools))
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
    global clock
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=256)
    parser.add_argument("--exact", type=int, help="starts of SLSQP with exact derivatives")
    parser.add_argument("--differences", type=int, default=16)
    parser.add_argument("--study", default="seven_pulley_study")
    parser.add_argument("--cpu", action="store_true", help="seconds of the processors")
    asked = parser.parse_args()
    clock = time.process_time if asked.cpu else time.perf_counter
    loaded = bj.optimize.load_study(EXAMPLES / f"{asked.study}.toml")
    study = problem.with_implied_constraints(dataclasses.replace(loaded, starts=asked.starts))
    begin = problem.starting_points(study)
    look = results.local_models(study, begin.scales, problem.limited_rows(study, begin.parts))
    points = np.asarray(begin.points)
    _, compiling = timed(lambda: look(points[0] + 1e-9))

    found = {name: batched(*how, study, begin, look) for name, how in BATCHED.items()}
    exact, exactly = one_by_one(look, points[: asked.exact], exact=True)
    few, roughly = one_by_one(look, points[: asked.differences], exact=False)
    all_ends = [*(ends for ends, _, _ in found.values()), exact, few]
    best = min(f for ends in all_ends for f, good in ends if good)
    columns = "starts  at best      error     compile       run   one start"
    print(f"{'optimizer':34s} {columns}")
    for name, (ends, compiled, running) in found.items():
        line(name, ends, best, compiled, running)
    line("SLSQP, exact derivatives", exact, best, compiling, exactly)
    line("SLSQP, finite differences", few, best, compiling, roughly)
    for name, (ends, _, running) in found.items():
        each = running / len(ends)
        ratios = exactly / len(exact) / each, roughly / len(few) / each
        print(f"{name}: SLSQP takes {ratios[0]:.0f} and {ratios[1]:.0f} times as long")


if __name__ == "__main__":
    main()
