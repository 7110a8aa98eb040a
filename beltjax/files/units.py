"""Numbers with units, as they stand in files: SI numbers, or strings such as "90 mm"."""

import functools
import math
import re
from decimal import Decimal
from fractions import Fraction
from typing import Any

_LONGEST = 60  # characters of a number with its unit
_PLAIN = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
# A unit is a product or quotient of names with whole powers. Nothing else reaches the units
# library, which would compute what looks like arithmetic. Names are taken whole (`++`), so that
# a text that is none is refused without trying all ways to split it.
_NAME = r"[A-Za-zµμΩ°%_]++"  # the micro sign, and the Greek letter that keyboards give for it
_POWER = r"(?:\s*(?:\^|\*\*)\s*\(?[-+]?[0-9]{1,2}(?:\.[0-9]+)?\)?|⁻?[¹²³⁴]|[0-9](?![0-9.]))?"
_FACTOR = rf"(?:{_NAME}{_POWER}|1(?=\s*/))"
_UNIT = re.compile(rf"/?[\s(]*+{_FACTOR}(?:[\s)]*+[*/·⋅]?[\s(]*+{_FACTOR})*[\s)]*+")
_NUMBER_WITH_UNIT = re.compile(rf"\s*({_PLAIN})\s*(.*)")
_BARE_POWER = re.compile(r"(?<=[A-Za-z])(?=[0-9])")  # "m2", to the units library a name
_LONE_NUMBER = re.compile(rf"\s*(?:{_PLAIN}|[-+]?(?:inf|nan))\s*")
_DECIMAL_COMMA = re.compile(r"\s*([-+]?[0-9]+),([0-9]+)(?![,.0-9])(.*)")
_MIXED_FRACTION = re.compile(r"\s*(?:([0-9]{1,6})[ -])?\s*([0-9]{1,6})/([0-9]{1,6})(?![0-9])(.*)")
# Words that make a unit one of angle. To a units library an angle has no dimension, so that
# hertz, "1/min" and a bare number would all pass for angles and differ by 2 pi or 60, and
# degrees for a coefficient of friction. Prefixes stand before them.
_ANGLE_UNITS = (
    "radian",
    "degree",
    "turn",
    "revolution",
    "cycle",
    "arcminute",
    "arcsecond",
    "grade",
    "revolutions_per_minute",
    "revolutions_per_second",
)
_DEFINITIONS = (
    "Nm = newton * meter",
    "@alias revolutions_per_minute = RPM",
    "@alias turn = rev",
    "@alias kilogram_force = kp",
    "PS = metric_horsepower",
)
# What was found in place of what is wanted, as units of those dimensions, and what leads on.
# The first row that fits is taken.
_HINTS = (
    ("N", "kg", "that is a mass; a force is in N, lbf or kgf"),
    ("N m", "kg m", 'that is a mass times a length; write a force for the mass, as in "1 lbf in"'),
    ("N m", "W", "that is a power; what a pulley takes is power in [operation.load.NAME]"),
    ("W", "N m", "that is a torque; what holds at any speed is operation.torque.NAME"),
    ("N m", "N", "that is a force; times its arm it is a torque"),
    ("N", "Pa", "that is a modulus; times the belt's cross section it is a stiffness in N"),
    ("N m^2", "Pa", "that is a modulus; times the second moment of area it is a stiffness"),
    ("N m/rad", "N/m", "that is a linear spring; times the square of its arm it is N m/rad"),
    ("rad/s", "m/s", "that is no angular speed; operation.belt_speed takes it"),
    ("m/s", "rad/s", "that is no speed in m/s; operation.driver_speed takes rpm"),
    ("kg/m", "kg/m^3", "that is a density; times the belt's cross section it is kg/m"),
    ("kg m^2", "kg", "that is a mass; an inertia is in kg m^2"),
)
# Units as they are written, for those who take other letters.
_WRITTEN = (
    *("kW", "W", "kN", "N", "mm", "cm", "m", "rpm", "rad/s", "deg", "kg", "g", "kg/m", "g/m"),
    *("N m", "N mm", "N m/rad", "N m/deg", "N/m", "N/mm", "N m^2", "kg m^2", "kg mm^2"),
)
# The units library, which takes long to load, is left alone where these do.
_FACTORS = {("m", "mm"): 1e3, ("rad", "deg"): 180 / math.pi, ("rad/s", "rpm"): 30 / math.pi}


@functools.cache
def _units() -> Any:
    import pint  # here, because most files are plain SI and a unit registry takes long to build

    registry = pint.UnitRegistry()
    for definition in _DEFINITIONS:
        registry.define(definition)
    return registry


def to_si(value: Any, unit: str) -> float:
    """`value`, an SI number or a string with its unit, in `unit`.

    Raises `ValueError` with a text that says what was found and what is expected.
    """
    wanted = f"a number in {unit}" if unit else "a plain number"
    given = _parsed(value, unit) if isinstance(value, str) else value
    if isinstance(given, bool) or not isinstance(given, int | float):
        raise ValueError(f"found {shown(value)}; give {wanted}")
    try:
        number = float(given)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"found {shown(value)}, which is not finite; give {wanted}")
    return number


def decimal_meters(value: Any) -> Decimal | None:
    """A length in m with every digit that is written; None for what is no length."""
    try:
        to_si(value, "m")
        if not isinstance(value, str):
            # The shortest text that reads back the same has the digits written, up to 15.
            return Decimal(repr(value))
        parts = _NUMBER_WITH_UNIT.fullmatch(value)
        factor = to_si(f"1 {parts[2]}", "m") if parts else 0.0
    except ValueError:
        return None
    return Decimal(parts[1]) * Decimal(repr(factor)) if parts else None


def si_of_text(text: str, unit: str) -> float:
    """`to_si` of a command's argument, in which a bare number is SI; raises `ValueError` too."""
    bare = len(text) <= _LONGEST and _LONE_NUMBER.fullmatch(text)
    return to_si(float(text) if bare else text.strip(), unit)


def unit_written(value: Any) -> str:
    """The unit that a file gives with a number; empty where it gives none."""
    parts = _NUMBER_WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
    return parts[2].strip() if parts else ""


def in_unit(value: float, si: str, unit: str) -> float:
    """A value in the unit `si` in another unit of its kind, as `unit_written` gives it."""
    factor = 1.0 if unit == si else _FACTORS.get((si, unit))
    if factor is not None:
        return value * factor
    registry = _units()
    named = registry.Unit(_BARE_POWER.sub("^", unit))
    return value * float(registry.Quantity(1.0, si or "dimensionless").to(named).magnitude)


def is_quoted(value: Any, kind: type) -> bool:
    """Whether `value` is the text of a list, a table (`dict`) or a `bool`, which take no quotes."""
    text = value.strip() if isinstance(value, str) else ""
    if kind is bool:
        return text in ("true", "false")
    first, last = "{}" if kind is dict else "[]"
    return len(text) > 1 and text[0] == first and text[-1] == last


def shown(value: Any) -> str:
    """`value` as it is shown in a message, long ones cut."""
    if isinstance(value, int) and abs(value) >= 10**30:
        return "an integer of more than 30 digits"
    if isinstance(value, dict | list):
        return f"a {'table' if isinstance(value, dict) else 'list'} of {len(value)}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _parsed(text: str, unit: str) -> float:
    example = f'a number in {unit}, or a string such as "1.0 {unit}"' if unit else "a plain number"
    found = f"found {shown(text)}"
    parts = _NUMBER_WITH_UNIT.fullmatch(text) if len(text) <= _LONGEST else None
    written = parts[2].strip() if parts else ""
    if not parts or (written and not _UNIT.fullmatch(written)):
        lead = _other_notation(text[:_LONGEST]) or f"give {example}"
        raise ValueError(f"{found}, which is not a number with a unit; {lead}")
    number = float(parts[1])
    if unit and not written:
        raise ValueError(f"{found}, which has no unit; give {example}")
    registry = _units()
    try:
        named = registry.Unit(_BARE_POWER.sub("^", written))
        quantity = registry.Quantity(number, named)
        converted = float(quantity.to(unit or "dimensionless").magnitude)
    except Exception as error:  # its parser passes on whatever Python's tokenizer raises
        unfit = f"whose unit is not {unit}" if unit else "which is a pure number"
        lead = _lead(written, parts[1], unit) or f"give {example}"
        raise ValueError(f"{found}, {unfit}; {lead}") from error
    turns = any(name.endswith(_ANGLE_UNITS) for name, _ in quantity.unit_items())
    if unit.startswith("rad") and not turns:
        lead = _frequency(number, named, unit) or "give rad, deg, rad/s or rpm"
        raise ValueError(f"{found}, whose unit is no angle; {lead}")
    if turns and "rad" not in unit:
        lead = _lead(written, parts[1], unit) or f"give {example}"
        raise ValueError(f"{found}, which is an angle or turns; {lead}")
    return converted


def _other_notation(text: str) -> str:
    """A hint for a decimal comma, a fraction of an inch or a list; empty where there is none."""
    comma = _DECIMAL_COMMA.fullmatch(text)
    if comma:
        return f'write a point: "{comma[1]}.{comma[2]}{comma[3].rstrip()}"'
    mixed = _MIXED_FRACTION.fullmatch(text)
    if mixed and int(mixed[3]):
        number = int(mixed[1] or 0) + Fraction(int(mixed[2]), int(mixed[3]))
        return f'write decimals: "{f"{float(number)!r} {mixed[4].strip()}".rstrip()}"'
    if is_quoted(text, list):
        return f"a list stands without quotes: {text.strip()}"
    if text.rstrip().endswith(('"', "''")):
        return f'write "{text.strip().rstrip(chr(34) + chr(39))} in"'
    return ""


def _frequency(number: float, named: Any, unit: str) -> str:
    """Say how a frequency is written as an angular speed; empty where it is none."""
    if unit != "rad/s" or named.dimensionality != _units().Unit("Hz").dimensionality:
        return ""
    rpm = 60 * number * _units().Quantity(1.0, named).to("1/s").magnitude
    return f'for that many turns write "{rpm:.6g} rpm"'


def _lead(written: str, number: str, unit: str) -> str:
    """A hint for a unit of another kind; empty where there is none."""
    if written.lower().replace(" ", "") in ("u/min", "/min"):
        return f'write "{number} rpm"' if unit == "rad/s" else ""
    registry = _units()
    spelled = _spelled(written)
    if spelled and spelled != written and registry.Unit(spelled).is_compatible_with(unit):
        return f'write "{number} {spelled}"'
    try:
        dimension = registry.Unit(written).dimensionality
    except Exception:  # as above
        return ""
    for wanted, other, text in _HINTS:
        if wanted == unit and registry.Unit(other).dimensionality == dimension:
            return text.format(number)
    return ""


def _spelled(written: str) -> str:
    """A usual unit of the same letters, small or large; empty where there is none."""
    letters = written.casefold().replace(" ", "")
    return next((unit for unit in _WRITTEN if unit.casefold().replace(" ", "") == letters), "")
