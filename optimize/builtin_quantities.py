"""The quantities that beltjax brings along; see `quantity` for adding others."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.entry_angles import entry_angles
from beltjax.analysis.periodic import stability_margin as margin_of
from beltjax.analysis.steady import of_single
from beltjax.drive.buildable import clearances

from .drive_analyses import DriveAnalyses
from .quantities import quantity

Scalar = Float[Array, ""]
Many = Float[Array, " parts"]


@quantity("coupling")
def coupling(analyses: DriveAnalyses) -> Scalar:
    """Coupling indicator Gamma, summed over the spans."""
    return jnp.sum(analyses.steady.coupling)


@quantity("coupling", place="span")
def span_coupling(analyses: DriveAnalyses, span: int) -> Scalar:
    """Coupling indicator Gamma of one span."""
    return analyses.steady.coupling[span]


@quantity("tensioner_effectiveness", needs="tensioner")
def tensioner_effectiveness(analyses: DriveAnalyses) -> Scalar:
    """Tensioner effectiveness eta."""
    return analyses.steady.effectiveness


@quantity("wraps", unit="rad", many=True)
def wraps(analyses: DriveAnalyses) -> Many:
    """Wrap of every pulley, with the contact points of a string."""
    return analyses.steady.reference.layout.wraps


@quantity("wrap", unit="rad", place="pulley")
def wrap(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Wrap of one pulley, with the contact points of a string."""
    return analyses.steady.reference.layout.wraps[pulley]


@quantity("clearance", unit="m", many=True)
def clearance(analyses: DriveAnalyses) -> Many:
    """Every gap between two rims, and between a rim and the belt."""
    gaps = clearances(analyses.drive, analyses.steady.reference.layout)
    return jnp.concatenate([gaps.rims, gaps.belt.ravel()])


@quantity("tightness", many=True)
def tightness(analyses: DriveAnalyses) -> Many:
    """Span tensions at rest and effective tensions running, over P0; a slack span has none."""
    steady = analyses.steady
    return jnp.concatenate([steady.groups.tensions, steady.effective_tensions])


@quantity("speed_ratio", place="pulley")
def speed_ratio(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Speed of one pulley over that of the driver."""
    drive = analyses.drive
    return (drive.drives @ drive.radii) / drive.pulleys[pulley].radius


@quantity("tension", unit="N", place="span")
def tension(analyses: DriveAnalyses, span: int) -> Scalar:
    """Tension of one span of the running drive."""
    return analyses.steady.running_tensions[span]


@quantity("tension_reserve", unit="N", needs="allowable tension", many=True)
def tension_reserve(analyses: DriveAnalyses) -> Many:
    """What is left of the belt's allowable tension in every span, at rest and running."""
    steady, loops = analyses.steady, analyses.drive.loops
    limits = [belt.allowable_tension for belt in analyses.drive.belts]
    limit = loops.spread(jnp.stack([jnp.asarray(one) for one in limits]))
    return jnp.concatenate([limit - steady.reference.tensions, limit - steady.running_tensions])


@quantity("hub_load", unit="N", place="pulley")
def hub_load(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Force of the running belt on the hub of one pulley."""
    # Parallel spans of equal tension round an idler leave no load; its direction is then free.
    return jnp.sqrt(jnp.sum(analyses.steady.hub_loads[pulley] ** 2) + 1e-30)


@quantity("slip_margin", place="pulley", needs="pulley friction")
def slip_margin(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Friction times wrap of one pulley, less the logarithm of the ratio of its tensions."""
    friction = analyses.drive.pulleys[pulley].holding
    assert friction is not None  # because it is needed
    wrap = analyses.steady.reference.layout.wraps[pulley]
    return friction * wrap - analyses.steady.slip_exponents[pulley]


@quantity("path_length", unit="m")
def path_length(analyses: DriveAnalyses) -> Scalar:
    """Length of the belt's path at rest."""
    return analyses.steady.reference.layout.path_length


@quantity("belt_length", unit="m")
def belt_length(analyses: DriveAnalyses) -> Scalar:
    """Length of the belt without tension."""
    return analyses.steady.reference.unstretched_length


@quantity("span_length", unit="m", place="span")
def span_length(analyses: DriveAnalyses, span: int) -> Scalar:
    """Length of one span."""
    return analyses.steady.reference.layout.span_lengths[span]


@quantity("efficiency", needs="friction")
def efficiency(analyses: DriveAnalyses) -> Scalar:
    """Power that the driven pulleys take over that of the driver, by contact mechanics."""
    return analyses.contact.efficiency


@quantity("adhesion", unit="rad", place="pulley", needs="friction")
def adhesion(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Arc of one pulley on which the belt adheres, by contact mechanics."""
    return analyses.contact.adhesions[pulley]


@quantity("contact_wrap", unit="rad", place="pulley", needs="friction")
def contact_wrap(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Arc of one pulley that a stiff belt touches, by contact mechanics."""
    return analyses.contact.wraps[pulley]


@quantity("groove_efficiency", needs="groove")
def groove_efficiency(analyses: DriveAnalyses) -> Scalar:
    """Power that the driven pulleys take over that of the driver, of a belt in grooves."""
    return analyses.groove.efficiency


@quantity("slip", place="pulley", needs="groove")
def slip(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Part by which one pulley's rim is slower than the driver's, of a belt in grooves."""
    return analyses.groove.slip[pulley]


@quantity("penetration", unit="m", place="pulley", needs="groove")
def penetration(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Greatest depth of the belt in the groove of one pulley."""
    return analyses.groove.penetrations[pulley]


@quantity("torque_factor", needs="friction")
def torque_factor(analyses: DriveAnalyses) -> Scalar:
    """Factor on all torques at which the first pulley slips fully."""
    return analyses.slipping.torque_factor


@quantity("maximum_moment", unit="N m", needs="friction")
def maximum_moment(analyses: DriveAnalyses) -> Scalar:
    """Moment of the driver at which the first pulley slips fully."""
    return analyses.slipping.driver_moment


@quantity("span_lengths", unit="m", many=True)
def span_lengths(analyses: DriveAnalyses) -> Many:
    """Length of every span."""
    return analyses.steady.reference.layout.span_lengths


@quantity("arm_rotation", unit="rad")
def arm_rotation(analyses: DriveAnalyses) -> Scalar:
    """Rotation of the tensioner arm from rest to the running drive."""
    return analyses.steady.arm_rotation


@quantity("frequency", unit="rad/s", place="mode", needs="inertia")
def frequency(analyses: DriveAnalyses, mode: int) -> Scalar:
    """The K-th natural frequency, counted from 1."""
    return analyses.modes.frequencies[mode]


@quantity("order_distance", unit="rad/s", place="order", needs="inertia", many=True)
def order_distance(analyses: DriveAnalyses, order: float) -> Many:
    """Distance of each of the lowest natural frequencies from order N of the driver's speed."""
    return jnp.abs(analyses.modes.frequencies - order * analyses.driver_speed)


@quantity("order_margin", place="order", needs="inertia", many=True)
def order_margin(analyses: DriveAnalyses, order: float) -> Many:
    """Distance of each natural frequency from order N, over that frequency of excitation."""
    return order_distance(analyses, order) / (order * analyses.driver_speed)


@quantity("span_amplitude", unit="m", place="span", needs="excitation")
def span_amplitude(analyses: DriveAnalyses, span: int) -> Scalar:
    """Largest deflection of one span in forced vibration, zero to peak."""
    return analyses.response.span_peaks[0, span]


@quantity("arm_amplitude", unit="rad", needs="excitation")
def arm_amplitude(analyses: DriveAnalyses) -> Scalar:
    """Amplitude of the tensioner arm in forced vibration, zero to peak."""
    turning = analyses.response.arm_rotation[0]
    return jnp.sqrt(turning.real**2 + turning.imag**2 + 1e-60)


@quantity("arm_travel", unit="rad", needs="excitation")
def arm_travel(analyses: DriveAnalyses) -> Scalar:
    """Travel of the tensioner arm in periodic motion of finite amplitude, peak to peak."""
    return of_single(analyses.periodic.measures.travels)


@quantity("rotation", unit="rad", place="pulley", needs="excitation")
def rotation(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Amplitude of one pulley's rotation in periodic motion, half peak to peak."""
    return analyses.periodic.measures.rotation_amplitudes[pulley]


@quantity("tension_min", unit="N", needs="excitation", many=True)
def tensions_min(analyses: DriveAnalyses) -> Many:
    """Least tension of every span in periodic motion: above 0 none goes slack."""
    return analyses.periodic.measures.tension_min


@quantity("tension_min", unit="N", place="span", needs="excitation")
def tension_min(analyses: DriveAnalyses, span: int) -> Scalar:
    """Least tension of one span in periodic motion."""
    return analyses.periodic.measures.tension_min[span]


@quantity("tension_max", unit="N", place="span", needs="excitation")
def tension_max(analyses: DriveAnalyses, span: int) -> Scalar:
    """Greatest tension of one span in periodic motion."""
    return analyses.periodic.measures.tension_max[span]


@quantity("span_deflection", unit="m", place="span", needs="excitation")
def span_deflection(analyses: DriveAnalyses, span: int) -> Scalar:
    """Largest deflection of one span in periodic motion."""
    return analyses.periodic.measures.span_peaks[span]


@quantity("hub_load_max", unit="N", place="pulley", needs="excitation")
def hub_load_max(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Greatest force of the belt on the hub of one pulley in periodic motion."""
    return analyses.periodic.measures.hub_load_max[pulley]


@quantity("friction_use", place="pulley", needs="excitation")
def friction_use(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """What periodic motion uses of one pulley's friction; above 1 it slips, 0 without friction."""
    return analyses.periodic.friction_use[pulley]


@quantity("friction_work", unit="J", needs="excitation", many=True)
def friction_work(analyses: DriveAnalyses) -> Many:
    """Work of each tensioner's dry friction over a period of periodic motion."""
    return analyses.periodic.measures.friction_work


@quantity("parametric_margin", needs="excitation", many=True)
def parametric_margin(analyses: DriveAnalyses) -> Many:
    """Factors by which [excitation] may grow before parametric resonance, 600 to 6000 rpm."""
    return jnp.minimum(analyses.tongues.factors, _FAR)


_FAR = 100.0  # factor above which a tongue does not matter


@quantity("stability_margin", needs="excitation")
def stability_margin(analyses: DriveAnalyses) -> Scalar:
    """1 less the largest Floquet multiplier of periodic motion; negative where it is unstable."""
    return margin_of(analyses.periodic)


@quantity("squeal_speed", unit="m/s", place="pulley", needs="falling friction")
def squeal_speed(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Sliding speed above which the belt does not squeal on one pulley; 0: at none."""
    return analyses.squeal(pulley).onset_speed


@quantity("critical_damping", unit="N s/m", place="pulley", needs="falling friction")
def critical_damping(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Damping of the belt from which on it does not squeal on one pulley at any sliding speed."""
    return analyses.squeal(pulley).critical_damping


@quantity("dynamic_slip_margin", place="pulley", needs="excited friction")
def dynamic_slip_margin(analyses: DriveAnalyses, pulley: int) -> Scalar:
    """Least over a period of friction times wrap, less the logarithm of the ratio of tensions."""
    margin = analyses.margins.dynamic
    assert margin is not None  # because an excitation is needed
    return margin[pulley]


@quantity("entry_angle", unit="rad", place="span", needs="offset")
def entry_angle(analyses: DriveAnalyses, span: int) -> Scalar:
    """Angle at which one span enters its pulleys, whose planes are apart."""
    lengths = analyses.steady.reference.layout.span_lengths
    return entry_angles(analyses.drive, lengths)[span]
