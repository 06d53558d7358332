"""A picture of what a scene is computed on: regions, mesh, boundaries with their roles, the profile at the inlet."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from ffsi.files.arrays import Floats, RawMesh
from ffsi.result.fields import FLUID
from ffsi.result.views import INK, SOLID_COLOURS, WIDTH
from ffsi.scene import Scene, boundaries
from ffsi.scene.geometry import ChannelGeometry

WATER = "#e3eef7"
ROLES = {
    "inlet": "#1f77b4",
    "outlet": "#17a2a2",
    "no-slip": INK,
    "interface": "#d9591c",
    "clamped": "#7b3fa0",
    "free": "#3b8f3e",
    "loaded": "#c2187a",
    "supported": "#9a7b00",
    "slip": "#7f7f7f",
}
_PLACES = (0.5, 0.35, 0.65, 0.2, 0.8, 0.08, 0.92)  # of a name along its boundary, the first without another name wins
_SLENDER = 12.0  # ratio of the sides from which on the shorter one is stretched


def sketch(scene: Scene, mesh: RawMesh, title: str = "") -> Figure:
    """Draw the reference domain."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    width, height = (high - low).tolist()
    stretched = max(width / height, height / width) > _SLENDER
    figure = Figure(layout="constrained")
    axes = figure.add_subplot()
    if not stretched:
        axes.set_aspect("equal")
    handles: list[Artist] = _regions(axes, scene, mesh)
    sides = _boundaries(axes, scene, mesh)
    handles += [
        Line2D([], [], color=colour, linewidth=2.2, label=f"{role}: {', '.join(names)}")
        for role, colour in ROLES.items()
        if (names := [name for name, (its, _) in sides.items() if its == role])
    ]
    _inlet(axes, scene, 0.12 * max(width, height))
    if scene.tip is not None:
        tip = axes.plot(*scene.tip, "x", color="#d9591c", markersize=7, markeredgewidth=1.8, linestyle="none", zorder=6)
        tip[0].set_label("tip, where tip_ux and tip_uy are taken")
        handles += tip
    axes.margins(0.03, 0.08)
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m (stretched)" if stretched and width > height else "y in m")
    axes.set_title(title or scene.heading, fontsize=11, color=INK, loc="left", wrap=True)
    axes.tick_params(labelsize=9)
    # Heights of the domain (beside it the profile and the numbers take room), of the legend, of title and axis.
    drawn = 2.5 if stretched else 0.8 * WIDTH * min(height / width, 0.85)
    figure.set_size_inches(WIDTH, drawn + 0.2 * -(-len(handles) // 2) + 1.1)
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    figure.canvas.draw()
    _name(axes, sides)
    return figure


def _regions(axes: Axes, scene: Scene, mesh: RawMesh) -> list[Artist]:
    found: list[Artist] = []
    for number, name in enumerate(scene.exact_areas(), start=FLUID if scene.fluid is not None else FLUID + 1):
        colour = WATER if number == FLUID else SOLID_COLOURS[(number - 2) % len(SOLID_COLOURS)]
        corners = mesh.vertices[mesh.triangles[mesh.region == number]]
        axes.add_collection(PolyCollection(list(corners), facecolors=colour, edgecolors="#9fb0bd", linewidths=0.25))
        found.append(Patch(facecolor=colour, edgecolor="#9fb0bd", label=name))
    return found


def _boundaries(axes: Axes, scene: Scene, mesh: RawMesh) -> dict[str, tuple[str, Floats]]:
    """Draw the boundaries; return role and edges (n, 2, 2) in m of each."""
    found: dict[str, tuple[str, Floats]] = {}
    for boundary in boundaries(scene):
        edges = mesh.vertices[mesh.edges[mesh.label == boundary.label]]
        axes.add_collection(LineCollection(list(edges), colors=ROLES[boundary.role], linewidths=2.2, zorder=4))
        found[boundary.name] = (boundary.role, edges)
    axes.autoscale_view()
    return found


def _inlet(axes: Axes, scene: Scene, longest: float) -> None:
    """Draw the profile of the inflow at the inlet, outside of the domain."""
    if scene.inflow is None or not isinstance(scene.geometry, ChannelGeometry):
        return
    inlet = scene.geometry.inlet
    inward = np.array(inlet.inward)
    along = np.array([-inward[1], inward[0]])
    s = np.linspace(0.0, inlet.height, 60)
    velocity = scene.inflow_profile()(s)
    largest = float(np.abs(velocity).max())
    if not largest > 0:
        return
    feet = np.array(inlet.start) + s[:, None] * along - 1.1 * longest * inward
    heads = feet + (longest * velocity / largest)[:, None] * inward
    axes.plot(*heads.T, color=ROLES["inlet"], linewidth=1.2)
    axes.plot(*feet[[0, -1]].T, color=ROLES["inlet"], linewidth=0.8)
    for foot, head in zip(feet[4:-1:8], heads[4:-1:8], strict=True):
        axes.annotate("", head, foot, arrowprops={"arrowstyle": "->", "color": ROLES["inlet"], "linewidth": 0.9})


def _name(axes: Axes, sides: dict[str, tuple[str, Floats]]) -> None:
    """Write the name of each boundary beside it where there is room."""
    taken: list[Bbox] = []
    for name, (role, edges) in sides.items():
        if not len(edges):
            continue
        middles = edges.mean(axis=1)
        # Along the longer extent: the edges of a boundary come in no order.
        upright = int(np.ptp(middles, axis=0).argmax()) == 1
        order = np.argsort(middles[:, int(upright)], kind="stable")
        inwards = "right" if middles[:, 0].mean() > np.mean(axes.get_xlim()) else "left"
        side = inwards if upright else "center"
        for place in _PLACES:
            text = _label(axes, name, middles[order[int(place * len(order))]], ROLES[role], side)
            box = text.get_window_extent().expanded(1.05, 1.1)
            if not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            text.remove()


def _label(axes: Axes, name: str, at: Floats, colour: str, side: str) -> Annotation:
    frame = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    text: Annotation = axes.annotate(
        name,
        (float(at[0]), float(at[1])),
        ({"left": 5, "right": -5}.get(side, 0), 0),
        textcoords="offset points",
        ha=side,
        va="center",
        fontsize=8,
        color=colour,
        bbox=frame,
        zorder=7,
    )
    return text
