"""A start for a problem that Newton's method does not solve from its guess: a growing interval.

On a short enough interval the conditions nearly determine the solution and almost any guess
will do. Its solution, stretched, is the guess for a longer one (Ascher, Mattheij and Russell,
1995, section 8.3, on problems posed up to infinity). Runs on the host, in programs that are
compiled already.
"""

from jaxtyping import Array, Float

from beltjax.numerics.bvp.arguments import as_double, first_start
from beltjax.numerics.bvp.collocation import Interval, Problem, Unknowns
from beltjax.numerics.bvp.compiled_parts import part
from beltjax.numerics.bvp.fixed_nodes import Start, is_solved, search

SHARES = (1 / 4, 1 / 16, 1 / 64, 1 / 256)  # of the interval, where growing may begin
GROWTH = 2.0  # of the interval in a step; its root is taken where a step fails
LEAST_GROWTH = 1.05
ROUGHLY = 1e-3  # error wanted of solutions that only lead to the last
AT_MOST = 0.1  # error allowed to them: a coarse mesh must not lead to what is no solution
SWEEPS = 3


def start_from_shorter(
    problem: Problem,
    x: Float[Array, " m"],
    y: Float[Array, "n m"],
    p: Float[Array, " k"],
    *,
    nodes: int,
    stages: int,
) -> Start | None:
    """A start on `nodes` nodes near a solution, or None where growing the interval ends early."""

    def solved(share: float, start: Start) -> Start | None:
        shorter = _shorter(problem, share)
        z, evidence = search(shorter, start, as_double(ROUGHLY), SWEEPS)
        good = bool(is_solved(evidence)) and float(evidence.estimate.error) < AT_MOST
        return Start(evidence.mesh, z) if good else None

    for share in SHARES:
        interval = _shorter(problem, share).interval
        found = solved(share, first_start(interval, x, y, p, nodes, stages))
        if found is not None:
            break
    else:
        return None

    growth = GROWTH
    while share < 1.0 and growth > LEAST_GROWTH:
        growth = min(growth, 1.0 / share)
        longer = solved(share * growth, _stretched(found, as_double(growth)))
        if longer is None:
            growth = growth**0.5
        else:
            found, share, growth = longer, share * growth, min(growth**2, GROWTH)
    return found if share >= 1.0 else None


def _shorter(problem: Problem, share: float) -> Problem:
    a, length = problem.interval.a, problem.interval.length
    interval = Interval(a, as_double(a + share * length))
    return Problem(problem.rhs, problem.bc, interval, problem.args, problem.singular)


@part
def _stretched(start: Start, growth: Float[Array, ""]) -> Start:
    z = start.z
    return Start(start.mesh, Unknowns(z.y, z.K / growth, z.p))
