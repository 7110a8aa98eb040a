"""A figure made again: its picture, its data and the numbers that it prints or shows."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from beltjax.draw.layouts import picture_bytes
from beltjax.validation.verdicts import Line

# Okabe and Ito's palette, which people with any color vision can tell apart.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
PICTURES = ("svg", "png")
STYLE: Any = {"font.size": 12, "axes.grid": True, "grid.linewidth": 0.3, "lines.linewidth": 1.8,
         "svg.hashsalt": "beltjax"}  # fmt: skip


class Plate(NamedTuple):
    """One figure of the source."""

    number: str  # "3.10"
    picture: Figure
    data: xarray.Dataset
    lines: tuple[Line, ...] = ()

    @property
    def stem(self) -> str:
        """Its files' name without ending."""
        chapter, place = self.number.split(".")
        return f"figure_{chapter}_{int(place):02d}"

    def files(self) -> dict[str, bytes]:
        """Picture and data, by file name."""
        with matplotlib.rc_context(STYLE):
            pictures = {
                f"{self.stem}.{kind}": picture_bytes(self.picture, f"x.{kind}") for kind in PICTURES
            }
        data: Any = self.data.to_netcdf(engine="scipy")
        return {**pictures, f"{self.stem}.nc": bytes(data)}


def panels(
    rows: int, columns: int, wide: float = 6.4, high: float = 4.2, **options: Any
) -> tuple[Figure, Any]:
    """A figure of equal panels, and their axes in reading order."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(wide * columns, high * rows), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False, **options).ravel()
    return figure, axes


def surfaces(
    grids: list[tuple[np.ndarray, np.ndarray, np.ndarray]], labels: list[tuple[str, str, str]]
) -> Figure:
    """Surfaces below each other: x [n], y [m] and z [m, n], with what their axes mean."""
    with matplotlib.rc_context(STYLE | {"font.size": 10}):
        figure = Figure(figsize=(6.4, 5.2 * len(grids)))
        FigureCanvasAgg(figure)
        for place, ((x, y, z), named) in enumerate(zip(grids, labels, strict=True)):
            axes = figure.add_subplot(len(grids), 1, place + 1, projection="3d")
            assert isinstance(axes, Axes3D)
            # Faces one by one would make an SVG of megabytes.
            axes.plot_surface(
                *np.meshgrid(x, y), z, cmap="viridis", rcount=40, ccount=40, linewidth=0.2,
                edgecolor="#444444", rasterized=True,
            )  # fmt: skip
            axes.set_xlabel(named[0], labelpad=6)
            axes.set_ylabel(named[1], labelpad=8)
            axes.set_zlabel(named[2], labelpad=14)
            axes.view_init(elev=28, azim=-52)
            axes.set_box_aspect(None, zoom=0.9)  # pyright: ignore[reportArgumentType]
        figure.subplots_adjust(left=0.0, right=0.92, bottom=0.04, top=1.0, hspace=0.02)
    return figure


def named(axes: Axes, x: str, y: str, legend: bool = True) -> None:
    """What the axes mean, and which curve is which."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if legend:
        axes.legend(frameon=False, fontsize=10)


def legend_above(axes: Axes) -> None:
    """Which curve is which, where it hides none."""
    axes.legend(frameon=False, fontsize=10, ncols=2, loc="lower left", bbox_to_anchor=(0, 1))


Variable = tuple[tuple[str, ...] | str, Any, str]


def dataset(
    title: str, coordinates: Mapping[str, tuple[Any, str]], variables: Mapping[str, Variable]
) -> xarray.Dataset:
    """Arrays with named axes and units; "1" is a pure number."""
    return xarray.Dataset(
        {name: (axes, np.asarray(x), {"units": unit}) for name, (axes, x, unit) in
         variables.items()},
        coords={name: (name, np.asarray(x), {"units": unit}) for name, (x, unit) in
                coordinates.items()},
        attrs={"title": title},
    )  # fmt: skip
