"""The collocation solver against SciPy's `solve_bvp`, every row with both solvers' true errors.

    python benchmarks/bvp.py

Prints: the three-pulley steady state (single, batched, with gradient, memory, compile time and
what the persistent cache saves); twelve test problems, single and batched; cost against the
number of nodes and of spans as fitted exponents; many different problems in one process, with
memory and memory maps, and problems that Newton's method fails on. Times are medians, but for
first calls, most of which is compiling.
"""

import dataclasses
import resource
import sys
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import scipy.integrate
import scipy.optimize

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402
from beltjax.analysis.steady import steady_model  # noqa: E402
from beltjax.numerics.bvp.gauss import gauss  # noqa: E402
from beltjax.physics import steady_collocation  # noqa: E402
from beltjax.validation import cash_mazzia as cm  # noqa: E402

ROOT = Path(__file__).parents[1]

BATCH = 256
TOL = 1e-6


def median_time(run, repeat=9):
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(run())
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def compiled(function, *args):
    """(compiled, seconds to trace and compile)."""
    start = time.perf_counter()
    program = jax.jit(function).lower(*args).compile()
    return program, time.perf_counter() - start


def row(what, **values):
    cells = "  ".join(f"{name} {value}" for name, value in values.items())
    print(f"{what:34s} {cells}", flush=True)


def ms(seconds):
    return f"{1e3 * seconds:9.3f} ms"


# (a) The steady state of the three-pulley drive.


def scipy_steady(model, tol):
    """SciPy on the standard form (3.48)-(3.55): 5 states a span, and T and theta_t."""
    m = jax.tree.map(np.asarray, model)
    n = len(m.P)
    e = m.eps / m.lam
    pull = m.lam / m.rho * m.a
    at_start = np.where(m.w_start != 0)[0]

    def rhs(x, y):
        _, v, k, q, _ = np.split(y[: 5 * n], 5)
        Q = (m.P - m.s**2)[:, None] + y[-2]
        slopes = [v, k, q / e[:, None], Q * k / e[:, None], v**2 / 2]
        return np.vstack([*slopes, np.zeros((2, len(x)))])

    def bc(ya, yb):
        T, th = ya[-2:]
        wa, va, ka, qa, Ia = np.split(ya[: 5 * n], 5)
        wb, vb, kb, qb, Ib = np.split(yb[: 5 * n], 5)
        Q = m.P - m.s**2 + T
        force = np.where(np.isin(np.arange(n), at_start), -Q * va + e * qa, -Q * vb + e * qb)
        return np.hstack(
            [
                wa - m.w_start * th,
                wb - (m.w_start + m.a) * th,
                ka - m.kap_s,
                kb - m.kap_e,
                Ia,
                np.sum(m.lam * (T / m.gam - Ib)) + m.rho * m.D * th,
                np.sum(pull * force) + (T - m.s**2) * m.D - m.k_s * th,
            ]
        )

    x = np.linspace(0, 1, 41)
    guess = np.zeros((5 * n + 2, 41))
    guess[2 * n : 3 * n] = m.kap_s[:, None] * (1 - x) + m.kap_e[:, None] * x
    return scipy.integrate.solve_bvp(rhs, bc, x, guess, tol=tol, max_nodes=20000)


def steady_total(numbers, drive, point, method):
    stiffness, stretch, radii, centers = numbers
    belt = dataclasses.replace(drive.belt, bending_stiffness=stiffness, axial_stiffness=stretch)
    pulleys = tuple(
        dataclasses.replace(pulley, radius=radius, center=center)
        for pulley, radius, center in zip(drive.pulleys, radii, centers, strict=True)
    )
    drive = dataclasses.replace(drive, belt=belt, pulleys=pulleys)
    steady = bj.steady_state(drive, point, method, throw=False)
    return steady.coupling.sum() + steady.tension_change


def batched_drives(arrays, count):
    keys = jax.random.split(jax.random.key(0), count)

    def varied(key):
        leaves, tree = jax.tree.flatten(arrays)
        parts = jax.random.split(key, len(leaves))
        shaken = [
            leaf * (1 + 0.01 * jax.random.normal(part, leaf.shape))
            for leaf, part in zip(leaves, parts, strict=True)
        ]
        return jax.tree.unflatten(tree, shaken)

    return jax.vmap(varied)(keys)


def steady_rows():
    print("(a) three-pulley steady state, eps = 0.02")
    drive, point = bj.load_drive(ROOT / "examples" / "three_pulley.toml")
    arrays = (drive.belt.bending_stiffness, drive.belt.axial_stiffness, drive.radii, drive.centers)

    model = steady_model(bj.steady_state(drive, point).groups)
    reference = bj.steady_state(drive, point)
    times = {}
    for tol in (1e-3, 1e-6):
        start = time.perf_counter()
        found = scipy_steady(model, tol)
        times[tol] = time.perf_counter() - start
        n = len(drive.pulleys)
        error = abs(found.y[-2, 0] - float(reference.tension_change))
        curvature = found.sol(np.linspace(0, 1, 20001))[2 * n : 3 * n]
        gamma = np.trapezoid(curvature**2, dx=1 / 20000, axis=1).sum()
        error_gamma = abs(gamma - float(reference.coupling.sum()))
        row(
            f"  SciPy, tolerance {tol:.0e}",
            run=ms(times[tol]),
            nodes=len(found.x),
            error_T=f"{error:.1e}",
            error_Gamma=f"{error_gamma:.1e}",
            status=found.status,
        )

    method = bj.Collocation()

    def value(a):
        return steady_total(a, drive, point, method)

    def both(a):
        return jax.value_and_grad(value)(a)

    ours = bj.steady_state(drive, point, method)
    program, seconds = compiled(value, arrays)
    single = median_time(lambda: program(arrays))
    row(
        "  Collocation()",
        run=ms(single),
        nodes=method.intervals + 1,
        error_T=f"{abs(float(ours.tension_change - reference.tension_change)):.1e}",
        error_Gamma=f"{abs(float(ours.coupling.sum() - reference.coupling.sum())):.1e}",
        compile=f"{seconds:.1f} s",
        times_faster=f"{times[TOL] / single:.0f} (aim 5)",
    )
    with_gradient, seconds = compiled(both, arrays)
    gradient = median_time(lambda: with_gradient(arrays))
    row(
        "  value and gradient",
        run=ms(gradient),
        ratio=f"{gradient / single:.2f} (aim <= 2.5)",
        compile=f"{seconds:.1f} s (aim < 15)",
    )

    many = batched_drives(arrays, BATCH)
    program, seconds = compiled(jax.vmap(value), many)
    run = median_time(lambda: program(many), 5)
    row(
        f"  batch of {BATCH}",
        run=ms(run),
        each=ms(run / BATCH),
        compile=f"{seconds:.1f} s",
        throughput=f"{times[TOL] / (run / BATCH):.0f} x SciPy (aim 100)",
    )
    values = program(many)
    truth = jax.jit(jax.vmap(lambda a: steady_total(a, drive, point, bj.Exact())))(many)
    row("", largest_error=f"{float(jnp.max(jnp.abs(values - truth))):.1e}")
    program, seconds = compiled(jax.vmap(both), many)
    gradient = median_time(lambda: program(many), 5)
    row("  the same with gradients", run=ms(gradient), ratio=f"{gradient / run:.2f} (aim <= 2.5)")

    many = batched_drives(arrays, 1024)
    program, _ = compiled(jax.vmap(both), many)
    usage = program.memory_analysis()
    assert usage is not None
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    jax.block_until_ready(program(many))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    row(
        "  batch of 1024 with gradients",
        temporaries=f"{usage.temp_size_in_bytes / 1e9:.3f} GB",
        process_peak=f"{peak / 1e6:.2f} GB (aim < 2)",
        before=f"{before / 1e6:.2f} GB",
    )
    cached_compile(both, arrays)


def cached_compile(function, arrays):
    with tempfile.TemporaryDirectory() as folder:
        jax.config.update("jax_compilation_cache_dir", folder)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        seconds = []
        for _ in range(2):
            jax.clear_caches()
            seconds.append(compiled(function, arrays)[1])
        jax.config.update("jax_compilation_cache_dir", None)
    row("  compile with gradient", first=f"{seconds[0]:.1f} s", from_cache=f"{seconds[1]:.1f} s")


# (b) Test problems.

PROBLEMS = [
    (1, 1e-4), (2, 1e-2), (4, 1e-2), (6, 1e-3), (7, 1e-3), (8, 1e-2),
    (10, 1e-3), (12, 1e-4), (14, 1e-4), (17, 1e-4), (20, 0.05), (21, 1e-4),
]  # fmt: skip


def true_error(case, eps, evaluate):
    x = np.linspace(case.interval[0], case.interval[1], 4001)
    exact = case.exact(x, eps)
    return np.max(np.abs(np.asarray(evaluate(x))[0] - exact)) / (1 + np.max(np.abs(exact)))


def scipy_problem(case, eps, x, y):
    a, b = case.ends(eps)
    forms = {  # NumPy forms of the same right-hand sides: SciPy must not pay for JAX's dispatch
        case.number: lambda x, y, d: np.asarray(case.second(x, y, d, eps)),
        1: lambda x, y, d: y / eps,
        2: lambda x, y, d: d / eps,
        4: lambda x, y, d: (-d + (1 + eps) * y) / eps,
        8: lambda x, y, d: -d / eps,
        10: lambda x, y, d: -x * d / eps,
        17: lambda x, y, d: -3 * eps * y / (eps + x**2) ** 2,
        20: lambda x, y, d: (1 - d**2) / eps,
        21: lambda x, y, d: (y + y**2 - np.exp(-2 * x / np.sqrt(eps))) / eps,
        6: lambda x, y, d: (-x * d - eps * np.pi**2 * np.cos(np.pi * x)
                            - np.pi * x * np.sin(np.pi * x)) / eps,
        7: lambda x, y, d: (-x * d + y - (1 + eps * np.pi**2) * np.cos(np.pi * x)
                            - np.pi * x * np.sin(np.pi * x)) / eps,
        12: lambda x, y, d: (y - (1 + eps * np.pi**2) * np.cos(np.pi * x)) / eps,
        14: lambda x, y, d: (y - (1 + eps * np.pi**2) * np.cos(np.pi * x)) / eps,
    }  # fmt: skip
    second = forms[case.number]
    start = time.perf_counter()
    found = scipy.integrate.solve_bvp(
        lambda x, y: np.vstack([y[1], second(x, y[0], y[1])]),
        lambda ya, yb: np.array([ya[0] - a, yb[0] - b]), x, y, tol=TOL, max_nodes=20000,
    )  # fmt: skip
    return found, time.perf_counter() - start


def problem_rows():
    print(f"(b) twelve test problems, tolerance {TOL:.0e}, no continuation, 64 nodes")

    def solve(x, y, a, b, args):
        return bj.solve_bvp(cm.rhs, cm.bc, (a, b), (x, y), args=args, nodes=64, throw=False)

    programs = None
    for number, eps in PROBLEMS:
        case = cm.CASES[cm.BY_NUMBER[number]]
        x, y = cm.line(number, eps)
        x_many = np.linspace(x[0], x[1], 65)
        y_many = np.array([np.interp(x_many, x, line) for line in y])
        ends = case.ends(eps)
        args = (jnp.array(cm.BY_NUMBER[number]), *map(jnp.asarray, (eps, *map(float, ends))))
        given = (x_many, y_many, float(x[0]), float(x[1]), args)
        if programs is None:
            program, seconds = compiled(solve, *given)
            axes = (None, None, None, None, (None, 0, None, None))
            spread = jnp.ones(BATCH)
            batch, seconds_batch = compiled(
                jax.vmap(solve, in_axes=axes), *given[:4], (args[0], eps * spread, *args[2:])
            )
            row(
                "  compile, all twelve in one",
                single=f"{seconds:.1f} s",
                batched=f"{seconds_batch:.1f} s",
            )
            programs = program, batch
        program, batch = programs
        ours = program(*given)
        run = median_time(lambda run=program, given=given: run(*given), 5)
        epses = eps * jnp.linspace(0.9, 1.1, BATCH)
        many = (*given[:4], (args[0], epses, *args[2:]))
        each = median_time(lambda run=batch, many=many: run(*many), 3) / BATCH
        found, seconds = scipy_problem(case, eps, x_many, y_many)
        row(
            f"  problem {number}, eps = {eps:g}",
            ours=ms(run),
            batched=ms(each),
            error=f"{true_error(case, eps, ours):.1e}",
            estimate=f"{float(ours.error):.1e}",
            solved=bool(ours.result == bj.RESULTS.successful),
            SciPy=ms(seconds),
            nodes=len(found.x),
            error_SciPy=f"{true_error(case, eps, found.sol):.1e}",
            status=found.status,
            faster=f"{seconds / run:.1f}/{seconds / each:.0f}",
        )


# Cost against size.


def exponent(sizes, times):
    return np.polyfit(np.log(sizes), np.log(times), 1)[0]


def scaling_rows():
    print("(c) cost against size")
    case = cm.CASES[cm.BY_NUMBER[1]]
    x, y = cm.line(1, 1e-2)
    sizes, times = [257, 513, 1025, 2049], []
    for nodes in sizes:

        def solve(eps, nodes=nodes):
            return bj.solve_bvp(
                lambda x, y, p, e: jnp.stack([y[1], y[0] / e]), lambda ya, yb, p, e: jnp.stack(
                    [ya[0] - 1.0, yb[0]]), case.interval, (x, y), args=eps, nodes=nodes,
                sweeps=1, throw=False)(0.5)[0]  # fmt: skip

        program, seconds = compiled(solve, 1e-2)
        times.append(median_time(lambda program=program: program(1e-2)))
        row(f"  {nodes} nodes", run=ms(times[-1]), compile=f"{seconds:.1f} s")
    row("  exponent in nodes", fitted=f"{exponent(sizes, times):.2f} (aim 1.0)")

    drive, point = bj.load_drive(ROOT / "examples" / "seven_pulley.toml")
    model = steady_model(bj.steady_state(drive, point).groups)
    times, sizes = [], [56, 112, 224, 448]
    scheme, finer = gauss(4), gauss(5)
    for spans in sizes:
        repeat = spans // len(model.P)
        bigger = jax.tree.map(
            lambda leaf, repeat=repeat: jnp.tile(leaf, repeat) if leaf.ndim else leaf, model
        )
        program, seconds = compiled(
            lambda m: steady_collocation.collocated(m, scheme, finer, 24, jnp.asarray(1e-9)).T,
            bigger,
        )
        times.append(median_time(lambda program=program, bigger=bigger: program(bigger)))
        row(f"  {spans} spans", run=ms(times[-1]), compile=f"{seconds:.1f} s")
    row("  exponent in spans", fitted=f"{exponent(sizes, times):.2f} (aim 1.0)")


# Many problems in one process, and poor guesses.

PROBLEMS_IN_ONE_PROCESS = 300
FLAT = (np.array([0.0, 1.0]), np.zeros((2, 2)))


def memory():
    """Memory in use, and how many maps of the 65,530 that Linux gives to a process by default."""
    status = Path("/proc/self/status").read_text()
    kilobytes = int(status.split("VmRSS:")[1].split()[0])
    maps = len(Path("/proc/self/maps").read_text().splitlines())
    return {"memory": f"{kilobytes / 1e3:.0f} MB", "maps": maps}


def bratu_peak(factor):
    """y(1/2) of y'' = -factor e^y, y(0) = y(1) = 0, in closed form."""

    def excess(z):
        return 8 * z**2 / np.cosh(z) ** 2 - factor

    root = scipy.optimize.root_scalar(excess, bracket=(0.0, 1.1996), xtol=1e-15).root
    return 2 * np.log(np.cosh(root))


def many_rows():
    print(f"(d) {PROBLEMS_IN_ONE_PROCESS} different right sides in one process")
    programs = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, duration_secs, **_: (
            programs.append(event) if "backend_compile" in event else None
        )
    )
    row("  before", **memory())
    seconds, errors = [], []
    for k in range(PROBLEMS_IN_ONE_PROCESS):
        factor = 1.0 + 2.0 * k / PROBLEMS_IN_ONE_PROCESS

        def rhs(x, y, p, args, factor=factor):
            return jnp.stack([y[1], -factor * jnp.exp(y[0])])

        def bc(ya, yb, p, args):
            return jnp.stack([ya[0], yb[0]])

        programs.clear()
        start = time.perf_counter()
        solution = bj.solve_bvp(rhs, bc, (0.0, 1.0), FLAT)
        seconds.append(time.perf_counter() - start)
        errors.append(abs(float(solution(0.5)[0]) - bratu_peak(factor)))
        if k in (0, 1, 9, 29, 99, 199, PROBLEMS_IN_ONE_PROCESS - 1):
            row(f"  problem {k + 1}", took=ms(seconds[-1]), programs=len(programs), **memory())
    row("  all but the first", each=ms(np.median(seconds[1:])), largest_error=f"{max(errors):.1e}")


def poor_guess_rows():
    print("(e) constant guesses from which Newton's method fails, compiling included")

    def stagnation(x, y, p, args):
        return jnp.stack([y[1], y[2], -y[0] * y[2] + y[1] ** 2 - 1])

    def wall(ya, yb, p, args):
        return jnp.stack([ya[0], ya[1], yb[1] - 1])

    def disk(x, y, p, args):
        F, F1, G, G1, H = y
        return jnp.stack([F1, F**2 - G**2 + H * F1, G1, 2 * F * G + H * G1, -2 * F])

    def rest(ya, yb, p, args):
        return jnp.stack([ya[0], ya[2] - 1, ya[4], yb[0], yb[2]])

    def bratu(x, y, p, factor):
        return jnp.stack([y[1], -factor * jnp.exp(y[0])])

    def clamped(ya, yb, p, args):
        return jnp.stack([ya[0], yb[0]])

    rows = [
        ("stagnation flow", stagnation, wall, 10.0, (0, 0, 1), None, {2: 1.2325876568}),
        ("rotating disk", disk, rest, 20.0, (1,) * 5, None, {1: 0.510233, 3: -0.615922}),
        ("Bratu beyond its fold", bratu, clamped, 1.0, (0, 0), 4.0, {}),
    ]
    for name, rhs, bc, b, values, args, known in rows:
        guess = (np.array([0.0, b]), np.repeat(np.array(values, float)[:, None], 2, axis=1))
        start = time.perf_counter()
        found = bj.solve_bvp(rhs, bc, (0.0, b), guess, args=args, throw=False)
        seconds = time.perf_counter() - start
        error = [f"{abs(float(found.y[j, 0]) - value):.0e}" for j, value in known.items()]
        solved = bool(found.result == bj.RESULTS.successful)
        row(f"  {name}", took=ms(seconds), solved=solved, errors=", ".join(error) or "none")


PARTS = {
    "a": steady_rows,
    "b": problem_rows,
    "c": scaling_rows,
    "d": many_rows,
    "e": poor_guess_rows,
}

if __name__ == "__main__":
    which = sys.argv[1:] or list(PARTS)
    for name, rows in PARTS.items():
        if name in which:
            rows()
