"""Natural modes of a drive about its steady state, and their derivatives."""

import functools
from typing import Literal, NamedTuple, overload

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from beltjax.analysis.cushion_vibration import CushionLinearization, CushionModes, cushion_modes
from beltjax.analysis.damping import Damping, damping_matrix
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.steady import of_single
from beltjax.compiling.quick import boundary_jit, usual_promotion
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.readable import Readable
from beltjax.numerics.bases import Products
from beltjax.numerics.counted_roots import Counted, counted_derivative, counted_root
from beltjax.numerics.gyroscopic import (
    Eigen,
    Forms,
    eigenvalues,
    eigenvectors,
    forms,
    general_modes,
    hermitian_modes,
    repeated,
)
from beltjax.physics.exact_vibration import Characteristic, characteristic
from beltjax.physics.vibration import VibrationModel, forms_of_spans, lift_products
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

Route = Literal["auto", "hermitian", "general"]
Matrix = Float[Array, "size size"]
# The model, and the places of the rotors that turn.
CharacteristicArguments = tuple[VibrationModel, Int[Array, " turning"]]

# Kinetic energy of rotors and tensioners above which a mode is rotational, below which the spans'.
_MOSTLY = 0.6


class Modes(Readable):
    """Natural modes z = Re(shape e^{(growth + i frequency) t}), with the lowest frequency first.

    Shapes are amplitudes, zero to peak, of a motion that stores 1 joule. In each shape the
    coordinate with the largest kinetic energy is real and positive.
    """

    frequencies: Float[Array, " count"]  # [rad/s]
    growth_rates: Float[Array, " count"]  # [1/s]; 0 for undamped stable drives, > 0: unstable
    dimensionless: Float[Array, " count"]  # frequencies times `linearization.scales.time`
    coordinates: Complex[Array, "count size"]  # in the linearization's basis
    rotations: Complex[Array, "count pulleys"]  # of the hubs [rad], in the direction of travel
    rotor_rotations: Complex[Array, "count rotors"]  # [rad]; rims and rings after the hubs
    tensioner_motions: Complex[Array, "count tensioners"]  # [rad] or [m]
    span_shares: Float[Array, "count spans"]  # of the mode's kinetic energy
    rotor_shares: Float[Array, "count rotors"]
    tensioner_shares: Float[Array, " count"]
    error: Float[Array, " count"]  # relative, of the frequencies, estimated
    linearization: Linearization
    result: RESULTS

    @property
    def arm_rotations(self) -> Complex[Array, " count"]:
        """Rotations of a single arm [rad], counterclockwise; 0 without a tensioner."""
        return of_single(self.tensioner_motions)

    @usual_promotion
    def deflection(self, k: int, i: int, x: Array) -> Array:
        """Deflection of span i in mode k [m, zero to peak, complex], positive inwards.

        x runs from 0 at the span's first listed pulley to 1 at its second. Raises `IndexError`
        for a mode or a span that is not there.
        """
        lin = self.linearization
        if not 0 <= k < len(self.frequencies):
            raise IndexError(f"mode {k} of {len(self.frequencies)}: modes count from 0.")
        if not 0 <= i < lin.spans:
            raise IndexError(f"span {i} of {lin.spans}: spans count from 0.")
        shape = lin.deflection(self.coordinates[k], i, jnp.asarray(x))
        return shape * lin.model.lam[i] * lin.scales.length

    @property
    def labels(self) -> tuple[str, ...]:
        """'rotational', 'span 0', 'spans' or 'coupled', by the shares of kinetic energy."""
        rigid = np.sum(np.asarray(self.rotor_shares), axis=1) + np.asarray(self.tensioner_shares)
        return tuple(
            mode_label(float(share), spans)
            for share, spans in zip(rigid, self.span_shares.tolist(), strict=True)
        )


def mode_label(rigid: float, spans: list[float]) -> str:
    """Name of the part that moves most.

    `rigid` is the share of the kinetic energy in rotors and tensioners, `spans` that in each span.
    """
    if rigid > _MOSTLY:
        return "rotational"
    largest = max(range(len(spans)), key=lambda i: spans[i])
    if spans[largest] > _MOSTLY:
        return f"span {largest}"
    return "spans" if rigid < 1 - _MOSTLY else "coupled"


@overload
def modes(
    linearization: Linearization,
    count: int = 8,
    *,
    exact: bool = False,
    damping: Damping | None = None,
    route: Route = "auto",
    throw: bool = True,
) -> Modes: ...


@overload
def modes(
    linearization: CushionLinearization, count: int = 8, *, throw: bool = True
) -> CushionModes: ...


def modes(
    linearization: Linearization | CushionLinearization,
    count: int = 8,
    *,
    exact: bool = False,
    damping: Damping | None = None,
    route: Route = "auto",
    throw: bool = True,
) -> Modes | CushionModes:
    """The `count` natural modes of lowest frequency of a linearized drive.

    Kong (2003), chapter 4; docs/theory/vibration.md. A rigid rotation (of a free drive) is left
    out. Second derivatives exist for `exact` frequencies alone; all others are NaN.

    The result is that of the linearization where it failed, `drive_diverges` or `drive_flutters`
    for an unstable drive, and `frequencies_not_isolated` where `exact` could not isolate a
    frequency. With `throw=False` read `.result`: the values of an unstable drive are right under
    "auto" and "general", and placeholders under "hermitian".

    Args:
        linearization: the drive about its steady state, as `linearize` returns it.
        count: number of modes, at least 1 and at most the size of the linearization.
        exact: polish each frequency with the drive's own characteristic function, which has no
            discretization error, and prove by counting that none is missing or found twice.
            Shapes remain those of the basis.
        damping: find the modes with this damping; none is counted unless given, not even that
            of the drive's own dampers.
        route: "hermitian" solves the Hermitian problem, which needs a positive definite stiffness
            matrix and no damping; "general" solves the general eigenproblem; "auto" decides by the
            numbers, which in a batch costs both.
        throw: raise where the result is a failure.

    Returns:
        Frequencies and growth rates of shape [count], shapes and shares of energy.

    Raises:
        ValueError: `count` or `route` is not available, or `exact` is set beside damping,
            `route="general"`, or a linearization with `fixed_steady` or `fixed_bending`.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> modes = bj.modes(bj.linearize(bj.steady_state(drive, point)), 4, exact=True)
        >>> modes.frequencies, modes.labels  # [rad/s], what moves most
    """
    if isinstance(linearization, CushionLinearization):
        if exact or damping is not None or route != "auto":
            raise ValueError(
                "modes: exact, damping and route are not for a belt on a cushion; leave them out."
            )
        on_cushion = cushion_modes(linearization, int(count))
        return raise_unless_successful(on_cushion, on_cushion.result, throw)
    found = _modes(strongly_typed(linearization), int(count), exact, strongly_typed(damping), route)
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _modes(
    linearization: Linearization, count: int, exact: bool, damping: Damping | None, route: Route
) -> Modes:
    lin = linearization
    _require_askable(lin, count, len(lin.mass) - _rigid(lin), exact, damping, route)
    C = lin.gyroscopic
    if damping is not None:
        C, route = C + damping_matrix(lin, damping), "general"
    found = found_modes(lin, C, count, exact, route)
    eigen = found.eigen
    if damping is None:
        held = _forms(lin, causes(lin), eigen)
    else:
        held = forms(lin.mass, C, lin.stiffness, eigen.left, eigen.vectors)
    values = eigenvalues(eigen.values, held)
    vectors = eigenvectors(lin.mass, C, lin.stiffness, eigen.values, eigen.vectors)
    frequencies = values.imag if found.polished is None else exact_frequencies(lin, found)
    result = _result(lin, found, route)
    answer = described(lin, found, frequencies, values.real, vectors, result)
    return frozen_where_failed(answer, RESULTS.where(found.usable, RESULTS.successful, result))


class FoundModes(NamedTuple):
    """Modes as the search found them, without derivatives."""

    eigen: Eigen
    polished: Counted | None  # exact frequencies; None without `exact`
    definite: Bool[Array, ""]  # whether K is
    usable: Bool[Array, ""]  # whether the values mean anything


def found_modes(lin: Linearization, C: Array, count: int, exact: bool, route: Route) -> FoundModes:
    """Solve the eigenproblem of M, C and K, and polish its frequencies if `exact`."""
    lin, C = jax.lax.stop_gradient((lin, C))
    good = succeeded(lin.result)
    eigen, definite = _eigen((lin.mass, C, lin.stiffness), count, _rigid(lin), route)
    usable = good & (definite | (route != "hermitian"))
    if not exact:
        return FoundModes(eigen, None, definite, usable)
    polished = _polished(lin, eigen.values.imag, definite & good)
    return FoundModes(eigen, polished, definite, usable & (jnp.all(polished.converged) | ~definite))


def _rigid(lin: Linearization) -> int:
    """Number of rigid rotations."""
    return 1 if lin.free else 0


def _result(lin: Linearization, found: FoundModes, route: Route) -> RESULTS:
    isolated = True if found.polished is None else jnp.all(found.polished.converged)
    unsolved = ~found.definite & (route == "hermitian")
    return first_failure(
        (~succeeded(lin.result), lin.result),
        (found.definite & ~jnp.asarray(isolated), RESULTS.frequencies_not_isolated),
        (found.eigen.flutters, RESULTS.drive_flutters),
        (unsolved | found.eigen.diverges, RESULTS.drive_diverges),
    )


def _require_askable(
    lin: Linearization, count: int, size: int, exact: bool, damping: Damping | None, route: Route
) -> None:
    """Raise `ValueError` for options that are not available, or not together."""
    if not 1 <= count <= size:
        raise ValueError(f"count: found {count}; give 1 to {size}, or a larger basis.")
    if route not in ("auto", "hermitian", "general"):
        raise ValueError(f"route: found {route!r}; give 'auto', 'hermitian' or 'general'.")
    if exact and (lin.mixed or damping is not None or route == "general"):
        raise ValueError(
            "exact: applies to undamped modes of one steady state; leave out damping, "
            "route='general', fixed_steady and fixed_bending."
        )


def _eigen(
    matrices: tuple[Matrix, Matrix, Matrix], count: int, rigid: int, route: Route
) -> tuple[Eigen, Bool[Array, ""]]:
    """Eigenvalues and vectors, and whether the stiffness matrix is positive definite.

    The Hermitian form is used where it applies and the route admits it.
    """
    M, C, K = matrices
    if route == "general":
        # This route does not need a definite matrix; growth rates show an unstable drive.
        return general_modes(M, C, K, count, rigid), jnp.array(True)
    hermitian, definite = hermitian_modes(M, C, K, count, rigid)
    if route == "hermitian":
        return hermitian, definite

    def general(_: None) -> Eigen:
        return general_modes(M, C, K, count, rigid, after=hermitian.vectors)

    return jax.lax.cond(definite, lambda _: hermitian, general, None), definite


def _safe_model(lin: Linearization, wanted: Bool[Array, ""]) -> CharacteristicArguments:
    """Arguments of the characteristic function, with a harmless model where not `wanted`."""
    bare = _bare(lin.model)
    return jax.tree.map(lambda a, b: jnp.where(wanted, a, b), lin.model, bare), lin.rotors


def _at(omega: Float[Array, ""], args: CharacteristicArguments) -> Characteristic:
    model, rotors = args
    return characteristic(model, rotors, omega)


def _value(omega: Float[Array, ""], args: CharacteristicArguments) -> Float[Array, ""]:
    return _at(omega, args).value


def _polished(
    lin: Linearization, guesses: Float[Array, " count"], wanted: Bool[Array, ""]
) -> Counted:
    """Frequencies as roots of the characteristic function, each identified by its number."""
    args = _safe_model(lin, wanted)
    guesses = jnp.where(wanted, guesses, 1.0)
    numbers = _rigid(lin) + 1 + jnp.arange(len(guesses))

    def polish(number: Int[Array, ""], guess: Float[Array, ""]) -> Counted:
        at = functools.partial(_at, args=args)
        return counted_root(at, number, guess, wanted=wanted)

    return jax.vmap(polish)(numbers, guesses)


def exact_frequencies(lin: Linearization, found: FoundModes) -> Float[Array, " count"]:
    """The polished frequencies with their derivatives; those of the basis where K is not definite.

    Those of the basis have no derivatives here.
    """
    assert found.polished is not None
    wanted = found.definite & succeeded(lin.result)
    args = _safe_model(lin, wanted)
    roots = found.polished.root
    twice = repeated(roots)
    exact = jax.vmap(lambda root, two: counted_derivative(_value, args, root, two))(roots, twice)
    return jnp.where(wanted, exact, found.eigen.values.imag)


def _bare(model: VibrationModel) -> VibrationModel:
    """A model for which all arithmetic stays finite, for lanes whose own model does not."""
    ones, none = jnp.ones_like(model.lam), jnp.zeros_like(model.lam)
    bodies, unit = jnp.zeros_like(model.a), jnp.eye(len(model.movable))
    return VibrationModel(
        eps=0.1 * ones, s=none, tau=ones, gam=ones, mu=ones, lam=ones, Q=ones, kap_s=none,
        kap_e=none, u=0.1 * ones, z=jnp.inf * ones, drop=none, a=bodies, W0=bodies, pull=bodies,
        H=jnp.zeros_like(model.H), K=unit, M=unit, movable=jnp.ones_like(model.movable),
        turns=jnp.ones_like(model.turns), K_r=jnp.zeros_like(model.K_r),
        M_r=jnp.eye(len(model.M_r)),
    )  # fmt: skip


def _tail(lin: Linearization, vectors: Array) -> Float[Array, " count"]:
    """Largest share of a span's slope energy in its last two functions: the error of a basis."""
    fields, *_ = lin.split(vectors)
    energy = jnp.abs(fields) ** 2  # the functions are orthonormal in slope
    whole = jnp.sum(energy, axis=(1, 2))
    return jnp.max(jnp.sum(energy[..., -2:], axis=-1), axis=-1) / jnp.where(whole > 0, whole, 1.0)


def described(
    lin: Linearization,
    found: FoundModes,
    dimensionless: Float[Array, " count"],
    growth: Float[Array, " count"],
    vectors: Complex[Array, "count size"],
    result: RESULTS,
) -> Modes:
    """Frequencies and vectors in physical units, with their shares of energy."""
    error = _tail(lin, found.eigen.vectors)
    if found.polished is not None:
        width = found.polished.upper - found.polished.lower
        error = jnp.where(found.definite, width / found.polished.root, error)
    fields, rotations, moved = lin.split(vectors)
    m, of = lin.model, lin.basis.products()
    spans = m.mu * m.lam**3 * _span_squares(lin, fields, moved, of)
    # The belt's own motion along its path couples rotors; each is counted with half of a coupling.
    rotors = jnp.abs(jnp.conj(rotations) * (rotations @ m.M_r))
    bodies = jnp.sum(jnp.conj(moved) * (moved @ m.M), axis=1).real
    whole = jnp.sum(spans, axis=1) + jnp.sum(rotors, axis=1) + bodies
    whole = jnp.where(whole > 0, whole, 1.0)
    # A shape of unit Hermitian energy stores a quarter of the unit of energy.
    joule = 2 / jnp.sqrt(lin.scales.energy)
    time = lin.scales.time
    return Modes(
        frequencies=dimensionless / time,
        growth_rates=growth / time,
        dimensionless=dimensionless,
        coordinates=joule * vectors,
        rotations=joule * lin.of_pulleys(rotations),
        rotor_rotations=joule * rotations,
        tensioner_motions=joule * moved * lin.units,
        span_shares=spans / whole[:, None],
        rotor_shares=rotors / whole[:, None],
        tensioner_shares=bodies / whole,
        error=error,
        linearization=lin,
        result=result,
    )


def _span_squares(
    lin: Linearization,
    fields: Complex[Array, "count spans n"],
    moved: Complex[Array, "count coordinates"],
    of: Products,
) -> Float[Array, "count spans"]:
    """Integrals of |w|^2 over each span, with the lift by the tensioners."""
    lift, square = lift_products(lin.model, of)
    own = jnp.einsum("ksa,ab,ksb->ks", jnp.conj(fields), of.value, fields).real
    cross = jnp.einsum("ksa,saq,kq->ks", jnp.conj(fields), lift, moved)
    return own + 2 * cross.real + jnp.einsum("kp,spq,kq->ks", jnp.conj(moved), square, moved).real


class Causes(NamedTuple):
    """Numbers on which the frequencies of a linearization depend; with a leading axis, slopes."""

    model: VibrationModel
    elongations: Float[Array, "spans size"]
    time: Float[Array, ""]  # [s]


def causes(lin: Linearization) -> Causes:
    """The numbers on which the frequencies of `lin` depend."""
    return Causes(lin.model, lin.elongations, lin.scales.time)


def _forms(lin: Linearization, at: Causes, eigen: Eigen) -> Forms:
    """Forms of the undamped matrices, as functions of `at`."""
    return forms_of_spans(
        at.model, lin.basis, at.elongations, lin.rotors, eigen.left, eigen.vectors
    )


def modes_with_slopes(lin: Linearization, count: int) -> tuple[Modes, Causes]:
    """Undamped modes, and the derivative of each frequency by the numbers it depends on.

    The modes are those of `modes`. Derivatives of the shapes are left out, which saves most of the
    compiling.
    """
    found = found_modes(lin, lin.gyroscopic, count, False, "hermitian")
    eigen = found.eigen
    result = _result(lin, found, "hermitian")

    def frequencies(at: Causes) -> Float[Array, " count"]:
        raw = eigenvalues(eigen.values, _forms(lin, at, eigen)).imag / at.time
        return frozen_where_failed(raw, RESULTS.where(found.usable, RESULTS.successful, result))

    _, pull = jax.vjp(frequencies, causes(lin))
    (slopes,) = jax.vmap(pull)(jnp.eye(count))
    values = eigen.values
    return described(lin, found, values.imag, values.real, eigen.vectors, result), slopes
