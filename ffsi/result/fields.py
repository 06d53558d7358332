"""The finite element fields of one point: quadratic triangles with displacement, velocity and pressure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ffsi.files.arrays import Floats, Ints, RawMesh, RawState, distinct
from ffsi.result.locating import Finder

FLUID = 1  # region number of the fluid; the solids are 2, 3, ...
_SPLIT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])  # a quadratic triangle as four linear ones


@dataclass(frozen=True)
class Fields:
    """Nodal values on quadratic triangles.

    Attributes:
        points: (n, 2) P2 nodes of the reference mesh, metres.
        cells: (n_triangles, 6) node numbers in VTK's order: vertices 0, 1, 2, then the middle of edges 01, 12, 20.
        region: (n_triangles,) 1 in the fluid, 2 and on in the solids.
        displacement: (n, 2) metres.
        velocity: (n, 2) m/s.
        pressure: (n,) Pa, linear on each triangle; zero at nodes that belong to solids only.
        solid_pressure: (n,) Pa, the pressures of mixed solids, linear on each of their triangles, zero outside of them,
            at a node of two of them that of the later one; None if there is no mixed solid.
    """

    points: Floats
    cells: Ints
    region: Ints
    displacement: Floats
    velocity: Floats
    pressure: Floats
    solid_pressure: Floats | None = None

    @classmethod
    def from_raw(cls, mesh: RawMesh, state: RawState, mixed_regions: Sequence[int] = ()) -> Fields:
        """Build the fields from the arrays that a FreeFEM script wrote.

        `mixed_regions` are the regions of the mixed solids, in the order of the state's pressures.

        Raises:
            ValueError: the state has the pressures of another number of mixed solids.
        """
        cells = np.asarray(mesh.p2, dtype=np.int64)[:, [0, 1, 2, 5, 3, 4]]
        triangles = np.asarray(mesh.triangles, dtype=np.int64)
        count = len(state.u)
        return cls(
            points=_at_nodes(np.asarray(mesh.vertices, dtype=float), triangles, cells, count),
            cells=cells,
            region=np.asarray(mesh.region, dtype=np.int64),
            displacement=np.asarray(state.u, dtype=float),
            velocity=np.asarray(state.v, dtype=float),
            pressure=_at_nodes(np.asarray(state.p, dtype=float), triangles, cells, count),
            solid_pressure=_solid_pressure(mesh, state, mixed_regions, cells),
        )

    @property
    def deformed(self) -> Floats:
        """(n, 2) node positions of the current configuration, metres."""
        return self.points + self.displacement

    @property
    def has_fluid(self) -> bool:
        """Whether any triangle is fluid."""
        return bool((self.region == FLUID).any())

    @property
    def has_solid(self) -> bool:
        """Whether any triangle is solid."""
        return bool((self.region != FLUID).any())

    def linear_triangles(self, selected: NDArray[np.bool_] | None = None) -> Ints:
        """Split each (selected) quadratic triangle into four linear ones: (4 n_triangles, 3) node numbers."""
        cells = self.cells if selected is None else self.cells[selected]
        return cells[:, _SPLIT].reshape(-1, 3)

    def sample(self, points: ArrayLike) -> dict[str, Floats]:
        """Evaluate the fields (P2 displacement and velocity, P1 pressure) at (m, 2) reference coordinates, metres.

        Returns:
            `region`, `ux`, `uy` (m), `vx`, `vy` (m/s), `p` (Pa), each (m,); NaN outside of the mesh, and `p` also
            inside a solid. On an interface the fluid's side is taken.

        Raises:
            ValueError: `points` has another shape.
        """
        at = np.asarray(points, dtype=float)
        if at.ndim != 2 or at.shape[1] != 2:
            raise ValueError(f"points must have shape (m, 2), not {at.shape}")
        cell, shape = self._locate(at)
        nodes = self.cells[cell]
        outside = cell < 0
        region = np.where(outside, np.nan, self.region[cell].astype(float))
        values = {"region": region}
        for name, nodal in zip(
            ("ux", "uy", "vx", "vy", "p"), (*self.displacement.T, *self.velocity.T, self.pressure), strict=True
        ):
            values[name] = np.where(outside, np.nan, np.einsum("ij,ij->i", nodal[nodes], shape))
        values["p"][region != FLUID] = np.nan
        return values

    def _locate(self, at: Floats) -> tuple[Ints, Floats]:
        cell = np.full(len(at), -1, dtype=np.int64)
        barycentric = np.zeros((len(at), 3))
        for fluid in (True, False):
            rest = np.flatnonzero(cell < 0)
            numbers = np.flatnonzero((self.region == FLUID) == fluid)
            if len(rest) and len(numbers):
                found, barycentric[rest] = self._finders[fluid].find(at[rest])
                cell[rest] = np.where(found < 0, -1, numbers[found])
        return cell, _quadratic_shapes(barycentric)

    @cached_property
    def _finders(self) -> dict[bool, Finder]:
        """Those of the fluid's triangles and of the others."""
        return {fluid: Finder(self.points[self.cells[(self.region == FLUID) == fluid, :3]]) for fluid in (True, False)}


def _solid_pressure(mesh: RawMesh, state: RawState, mixed_regions: Sequence[int], cells: Ints) -> Floats | None:
    """Return the pressures of the mixed solids at the P2 nodes of their own triangles, zero elsewhere; None without."""
    if len(state.ps) != len(mixed_regions):
        raise ValueError(
            f"the state has the pressures of {len(state.ps)} mixed solids, the scene has {len(mixed_regions)} of them"
        )
    if not mixed_regions:
        return None
    values = np.zeros(len(state.u))
    for region, pressure in zip(mixed_regions, state.ps, strict=True):
        inside = mesh.region == region
        nodes = distinct(cells[inside])
        values[nodes] = _at_nodes(pressure, mesh.triangles[inside], cells[inside], len(values))[nodes]
    return values


def _at_nodes(at_vertices: Floats, triangles: Ints, cells: Ints, count: int) -> Floats:
    """Carry values from the mesh's vertices to its P2 nodes, linearly along each edge."""
    values = np.zeros((count, *at_vertices.shape[1:]))
    corner = at_vertices[triangles]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        values[cells[:, i]] = corner[:, i]
        values[cells[:, 3 + i]] = 0.5 * (corner[:, i] + corner[:, j])
    return values


def _quadratic_shapes(barycentric: Floats) -> Floats:
    l0, l1, l2 = barycentric.T
    return np.stack(
        [l0 * (2 * l0 - 1), l1 * (2 * l1 - 1), l2 * (2 * l2 - 1), 4 * l0 * l1, 4 * l1 * l2, 4 * l2 * l0], axis=1
    )
