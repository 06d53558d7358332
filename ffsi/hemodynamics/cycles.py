"""The cycles of a pulsatile flow: indices along the walls, on their parts, and from cycle to cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsi.files.arrays import Floats, RawMesh
from ffsi.files.cycles import WallCycle
from ffsi.hemodynamics.parts import over_parts, wall_frame
from ffsi.hemodynamics.walls import at_nodes, wall_labels, wall_points
from ffsi.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

_INDICES = ("tawss", "osi", "rrt")


def cycle_tables(scene: Scene, mesh: RawMesh, cycles: Sequence[WallCycle]) -> pd.DataFrame:
    """Return one row per cycle, of which there is at least one, and point of the walls.

    Columns: `cycle`, those of `parts.wall_frame`, `tawss`, `peak` (Pa), `osi`, `rrt` (1/Pa), and `mean_x`, `mean_y`,
    the mean of the stress over the cycle (Pa).
    """
    import pandas as pd

    points = wall_points(mesh, wall_labels(scene))
    where = wall_frame(scene, points)
    tables = []
    for cycle in cycles:
        at = cycle.at(points.middle)
        x, y = at.integral.T / (at.end - at.start)
        found = where.assign(tawss=at.tawss, peak=at.peak, osi=at.osi, rrt=at.rrt, mean_x=x, mean_y=y)
        tables.append(found.assign(cycle=cycle.number))
    return pd.concat(tables, ignore_index=True)


def cycle_point_data(scene: Scene, mesh: RawMesh, cycle: WallCycle) -> dict[str, Floats]:
    """Return fields for ParaView, NaN off the walls: `tawss` (Pa), `osi` and `rrt` (1/Pa) of a cycle, (n2,) each."""
    points = wall_points(mesh, wall_labels(scene))
    at = cycle.at(points.middle)
    return {name: at_nodes(points, getattr(at, name), mesh.n_p2) for name in _INDICES}


def cycle_summary(scene: Scene, mesh: RawMesh, cycles: Sequence[WallCycle]) -> list[dict[str, Any]]:
    """Return for each cycle its number, start and end (s), its indices by part of the walls, its change.

    `tawss_mean_dome`, ... (Pa), `osi_mean_dome`, ..., `rrt_mean_dome`, ... (1/Pa), `wss_peak_dome` (Pa);
    `tawss_change`: difference of TAWSS to the cycle before, its L2 norm over the walls relative to that of TAWSS;
    `osi_change`: largest difference of OSI.
    """
    points = wall_points(mesh, wall_labels(scene))
    found: list[dict[str, Any]] = []
    before: WallCycle | None = None
    for cycle in cycles:
        at = cycle.at(points.middle)
        row: dict[str, Any] = {"number": at.number, "start": at.start, "end": at.end}
        for name in _INDICES:
            for part, values in over_parts(scene, points, getattr(at, name), points.length).items():
                row |= {f"{name}_{what}_{part}": value for what, value in values.items()}
        for part, values in over_parts(scene, points, at.peak, points.length).items():
            row[f"wss_peak_{part}"] = values["max"]
        if before is not None and before.number == at.number - 1:
            row["tawss_change"] = change(before.tawss, at.tawss, points.length)
            row["osi_change"] = float(np.abs(at.osi - before.osi).max())
        found.append(row)
        before = at
    return found


def change(before: Floats, after: Floats, weight: Floats) -> float:
    """Return the norm over the walls of a difference between two cycles, relative to the norm of the later one.

    All are (n,): the values in both and the lengths of the edges, m.
    """
    size = float(np.sqrt(weight @ after**2))
    return float(np.sqrt(weight @ (after - before) ** 2)) / size if size != 0 else 0.0
