"""How the curves of the studies look."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from ffsi.result.pictures import FAINT, INK


def dress(axes: Axes, which: str = "major", width: float = 0.7) -> None:
    """Draw a faint grid behind the curves, and two sides of the frame."""
    axes.grid(True, which=which, color="#e3e6ea", linewidth=width)  # type: ignore[arg-type]
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=9, width=0.6)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FAINT)


def over_seconds(axes: Axes) -> None:
    """Name the script's seconds along x; where there are curves, both axes are logarithmic."""
    axes.set_xlabel("seconds of the FreeFEM script, one thread", color=INK)
    if axes.lines:
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
