"""Parts of the walls, and what a quantity along the walls comes to on each of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats
from ffsi.hemodynamics.walls import WallPoints, wall_labels
from ffsi.scene import Scene, boundaries
from ffsi.scene.boundaries import DOME_WALL, STRUTS
from ffsi.scene.geometry import Aneurysm

if TYPE_CHECKING:
    import pandas as pd

PARTS = ("dome", "neck", "vessel")
"""Parts of an aneurysm's walls."""
NECK_ZONE = 0.25
"""The neck: the walls within this part of its length from its two ends, where the stress has its singular corners."""
_PIECES = 21  # odd: one of them lies at the point


def part_of(scene: Scene, label: NDArray[np.int64], position: Floats) -> NDArray[np.str_]:
    """Return the part of the wall of reference points (n, 2) in m on boundaries with some labels (n,).

    Of an aneurysm "dome", "neck", "vessel" or "stent", elsewhere the boundary's name.
    """
    if not isinstance(scene.geometry, Aneurysm):
        names = {boundary.label: boundary.name for boundary in boundaries(scene)}
        labels, place = np.unique(label, return_inverse=True)
        return np.array([names[number] for number in labels.tolist()], dtype=np.str_)[place]
    found = np.where(label == DOME_WALL, "dome", np.where(label >= STRUTS, "stent", "vessel"))
    distance = np.min([np.hypot(*(position - end).T) for end in np.array(scene.geometry.neck)], axis=0)
    near = distance < NECK_ZONE * scene.geometry.neck_length
    return np.where(near & (found != "stent"), "neck", found)


def over_parts(scene: Scene, points: WallPoints, values: Floats, length: Floats) -> dict[str, dict[str, float]]:
    """Return `mean`, `max` and `min` of values (n,) at the points, for each part of the walls that has points.

    They are those of the piecewise linear curve through the points, up to the part's border; an aneurysm's parts may
    end within an edge. `length` (n,) m is that of the deformed edges.
    """
    # Every edge in small pieces: its value, its place in the reference mesh and its share of the edge's length.
    share = (np.arange(_PIECES) + 0.5) / _PIECES - 0.5
    tangent = np.column_stack([-points.normal[:, 1], points.normal[:, 0]])
    offset = share * points.length[:, None]
    place = points.position[:, None] + offset[..., None] * tangent[:, None]
    fine = np.empty((len(values), _PIECES))
    for chain in np.unique(points.chain):
        on = points.chain == chain
        fine[on] = np.interp(points.arc[on, None] + offset[on], points.arc[on], values[on])
    label = np.repeat(points.label, _PIECES)
    part = part_of(scene, label, place.reshape(-1, 2))
    weight = np.repeat(length / _PIECES, _PIECES)
    names: Sequence[str] = PARTS
    if not isinstance(scene.geometry, Aneurysm):
        wet = wall_labels(scene)
        names = list(dict.fromkeys(boundary.name for boundary in boundaries(scene) if boundary.label in wet))
    found = {}
    for name in names:
        at = fine.ravel()[part == name]
        if at.size:
            mean = float(np.average(at, weights=weight[part == name]))
            found[name] = {"mean": mean, "max": float(at.max()), "min": float(at.min())}
    return found


def wall_frame(scene: Scene, points: WallPoints) -> pd.DataFrame:
    """Return where the points of the walls lie: `line`, `arc` (m), `x`, `y` (m, reference mesh), `part`.

    Of an aneurysm `line` is "dome" for the outer wall with the dome in its middle, from the inlet to the outlet,
    "inner" for the vessel's inner wall, from the outlet to the inlet, "stent" for the struts. Elsewhere it is the
    number of the connected line of edges, and the part is the boundary's name.
    """
    import pandas as pd

    if isinstance(scene.geometry, Aneurysm):
        with_dome = np.unique(points.chain[points.label == DOME_WALL])
        line = np.where(points.label >= STRUTS, "stent", "inner")
        line = np.where(np.isin(points.chain, with_dome), "dome", line)
    else:
        line = points.chain.astype(str)
    part = part_of(scene, points.label, points.position)
    x, y = points.position.T
    return pd.DataFrame({"line": line, "arc": points.arc, "x": x, "y": y, "part": part})
