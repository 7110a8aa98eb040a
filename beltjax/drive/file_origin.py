"""Coordinates of a drive file that lie far from their origin, as those of a site do.

Beside an easting of 481250 m a double has no digits left for what a belt stretches. Such
coordinates are counted anew from a point near the drive, in decimals, so that every digit that is
written counts.
"""

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Any

from beltjax.files.units import decimal_meters

_FAR = 1e4  # times the size of the drive: of 16 digits 12 are left for what is smaller
OF_TENSIONERS = ("pivot", "mass_center")
Origin = tuple[float, float]


def near_the_origin(content: dict[str, Any]) -> tuple[dict[str, Any], Origin]:
    """`content` with its points counted from an origin near them, and that origin [m].

    The origin is (0, 0) where the points are near it, or where the file has an `origin`: then they
    are counted from that. What is no point is left for the file's own rules to refuse.
    """
    if "origin" in content:
        return content, (0.0, 0.0)
    points: list[list[Decimal]] = []
    _with_points(content, lambda point: points.append(_decimals(point)) or point)
    known = [point for point in points if point]
    if not known:
        return content, (0.0, 0.0)
    size = max(float(max(axis) - min(axis)) for axis in zip(*known, strict=True))
    farthest = max(abs(float(part)) for point in known for part in point)
    if not farthest > _FAR * size or not math.isfinite(farthest):
        return content, (0.0, 0.0)
    whole = [Decimal(math.floor(part)) for part in known[0]]

    def moved(point: Any) -> Any:
        parts = _decimals(point)
        return [float(a - b) for a, b in zip(parts, whole, strict=True)] if parts else point

    return _with_points(content, moved), (float(whole[0]), float(whole[1]))


def _with_points(content: dict[str, Any], change: Callable[[Any], Any]) -> dict[str, Any]:
    """`content` with every point of its drawing changed."""

    def table(value: Any, keys: tuple[str, ...]) -> Any:
        if isinstance(value, list):
            return [table(item, keys) for item in value]
        if not isinstance(value, dict):
            return value
        return {key: change(item) if key in keys else item for key, item in value.items()}

    places = {"pulley": ("center",), "tensioner": OF_TENSIONERS}
    return {
        key: table(value, places[key]) if key in places else value for key, value in content.items()
    }


def _decimals(point: Any) -> list[Decimal]:
    """The two coordinates of a point in meters, as they are written; none where it is no point."""
    if not isinstance(point, list) or len(point) != 2:
        return []
    found = [decimal_meters(part) for part in point]
    return [part for part in found if part is not None] if None not in found else []
