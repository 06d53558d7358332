"""A problem on its mesh: mapped triangles per region, boundary sides, rows and prescribed values."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, Ints, RawMesh, RawState, distinct
from ffsi.reference.conditions import Inflow, Load, Outlet
from ffsi.reference.curves import off_chords
from ffsi.reference.elements import Elements, gauss_rule, p2_basis
from ffsi.reference.problem import FLUID_REGION, Boundary, Fluid, MeshMotion, Problem, Solid
from ffsi.reference.slip import node_normals
from ffsi.reference.step import Increment, Step

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Sides:
    """Sides of a region's triangles on the boundary of the region.

    ``element`` (n,) number of the triangle in its region, ``side`` (n,) its local side 0..2, ``nodes`` (n, 3) the P2
    nodes at the start, the end and the middle, ``label`` (n,) the edge's label or 0, ``tangent`` (n, 2) metres from
    start to end, with the region on its left.
    """

    element: Ints
    side: Ints
    nodes: Ints
    label: Ints
    tangent: Floats

    @property
    def normal(self) -> Floats:
        """Normals outward from the region with the length of the side, (n, 2) metres."""
        return np.column_stack([self.tangent[:, 1], -self.tangent[:, 0]])

    def select(self, which: Mask) -> "Sides":
        """Return the sides where ``which`` (n,) is true."""
        return Sides(self.element[which], self.side[which], self.nodes[which], self.label[which], self.tangent[which])


@dataclass(frozen=True)
class Rows:
    """Which nodes have a row of an equation, and which values are prescribed.

    ``momentum``, ``mesh_motion``, ``kinematics`` (n2,), ``continuity`` (nv,) and ``incompressibility`` (number of mixed
    solids, nv) are true where the equation has a row; ``u_given`` to ``ps_given``, (n2,) to (number of mixed solids,
    nv), where ``prescribed`` holds a value that the solution must have. Every node has either a value or a row for each
    of u, v, p and each pressure of a mixed solid. Nodes slide along boundaries with the normals ``u_normal`` and
    ``v_normal`` (n2, 2): there u . N = 0, v . N = 0 in the place of the part of the equations along N.
    """

    momentum: Mask
    continuity: Mask
    kinematics: Mask
    mesh_motion: Mask
    incompressibility: Mask
    u_given: Mask
    v_given: Mask
    p_given: Mask
    ps_given: Mask
    prescribed: RawState
    u_normal: Floats
    v_normal: Floats

    @property
    def given(self) -> tuple[Mask, Mask, Mask, Mask]:
        """Where u, v, p, ps are prescribed."""
        return self.u_given, self.v_given, self.p_given, self.ps_given


@dataclass(frozen=True)
class FluidPart:
    """The fluid's triangles, its boundary and mesh motion (None where u is given) with stiffness ``alpha`` (n,)."""

    law: Fluid
    elements: Elements
    sides: Sides
    motion: MeshMotion | None
    alpha: Floats


@dataclass(frozen=True)
class SolidPart:
    """The triangles of a solid, its law and the row ``pressure`` of its pressure in ``RawState.ps``, if it has one."""

    law: Solid
    elements: Elements
    pressure: int | None


@dataclass(frozen=True)
class System:
    """The discrete system of docs/theory.md on one mesh: the steady one, or that of one time step.

    ``solids`` by region number; ``rows`` the equations and conditions per node; ``increment`` the time step and the
    state that it starts from, None for the steady system; ``loaded`` the sides of solids with a load of their own.
    """

    problem: Problem
    mesh: RawMesh
    fluid: FluidPart | None
    solids: dict[int, SolidPart]
    rows: Rows
    increment: Increment | None = None
    loaded: tuple[tuple[Load, Sides], ...] = ()

    @property
    def outlets(self) -> list[tuple[Outlet, Sides]]:
        """The outlets, each with its sides of the fluid; together where they have the problem's one condition."""
        if self.fluid is None:
            return []
        sides = self.fluid.sides
        own = {b.label: b.outlet for b in self.problem.boundaries if b.role == "outlet" and b.outlet is not None}
        found = [(outlet, sides.select(sides.label == label)) for label, outlet in own.items()]
        if self.problem.outlet is not None:
            common = [label for label in self.problem.labels("outlet") if label not in own]
            found.append((self.problem.outlet, sides.select(np.isin(sides.label, common))))
        return found

    @classmethod
    def build(cls, problem: Problem, mesh: RawMesh) -> "System":
        """Prepare the steady ``problem`` on ``mesh``.

        Raises ``ValueError`` if regions or labels of the mesh do not fit the problem or a triangle is degenerate.
        """
        regions = ({FLUID_REGION} if problem.fluid else set()) | set(problem.solids)
        if (found := set(distinct(mesh.region).tolist())) != regions:
            raise ValueError(f"{problem.name}: the mesh has the regions {sorted(found)}, expected {sorted(regions)}")
        _check_labels(problem, mesh)
        fluid = None
        if problem.fluid:
            elements, motion = _elements(mesh, FLUID_REGION), problem.mesh_motion
            alpha = _mesh_stiffness(motion, problem, mesh, elements) if motion else np.ones(len(elements))
            fluid = FluidPart(problem.fluid, elements, outline(mesh, FLUID_REGION), motion, alpha)
        pressures = {region: row for row, region in enumerate(problem.mixed_regions)}
        solids = {
            region: SolidPart(law, _elements(mesh, region), pressures.get(region))
            for region, law in problem.solids.items()
        }
        pressed = [boundary for boundary in problem.boundaries if boundary.load is not None]
        around = [outline(mesh, region) for region in solids] if pressed else []
        loaded = tuple((b.load, sides.select(sides.label == b.label)) for b in pressed if b.load for sides in around)
        return cls(problem, mesh, fluid, solids, _rows(problem, mesh, fluid, solids, None), None, loaded)

    def stepping(self, old: RawState, step: Step, reservoir: float | Mapping[str, float] = 0.0) -> "System":
        """Return the system of one step from the state ``old`` and the ``reservoir`` pressures of its outlets by name.

        A number is that of the only outlet.
        """
        reservoirs = reservoir if isinstance(reservoir, Mapping) else {"": reservoir}
        rows = _rows(self.problem, self.mesh, self.fluid, self.solids, step.time)
        return replace(self, rows=rows, increment=Increment(old, step, reservoirs))


def _elements(mesh: RawMesh, region: int) -> Elements:
    inside = mesh.region == region
    return Elements.build(mesh.vertices, mesh.triangles[inside], mesh.p2[inside])


def _check_labels(problem: Problem, mesh: RawMesh) -> None:
    """Refuse a mesh whose outer boundary or interface is not covered by the problem's labels."""
    keys, count = np.unique(mesh.sides, return_counts=True)
    known = np.isin(mesh.label, [boundary.label for boundary in problem.boundaries])
    bare = [*set(keys[count == 1].tolist()).difference(mesh.edge_keys[known].tolist())]
    if bare:
        labels = np.unique(mesh.label[np.isin(mesh.edge_keys, bare)]).tolist()
        raise ValueError(
            f"{problem.name}: {len(bare)} edges of the outer boundary have no boundary of the problem, labels {labels}"
        )
    missing = {boundary.label for boundary in problem.boundaries} - set(mesh.label.tolist())
    if missing:
        raise ValueError(f"{problem.name}: no edge of the mesh has the label {sorted(missing)}")
    inside = mesh.region == FLUID_REGION
    keys, count = np.unique(
        np.concatenate([distinct(mesh.sides[each]) for each in (inside, ~inside)]), return_counts=True
    )
    interface = mesh.edge_keys[np.isin(mesh.label, problem.labels("interface"))]
    if dry := set(keys[count == 2].tolist()).difference(interface.tolist()):
        raise ValueError(f"{problem.name}: {len(dry)} edges between fluid and solid are no interface of the problem")


def _mesh_stiffness(motion: MeshMotion, problem: Problem, mesh: RawMesh, elements: Elements) -> Floats:
    """Stiffness alpha (n,) of the fluid triangles: (A_max/A_K)^m times (d_max/d_K)^n."""
    alpha: Floats = (elements.area.max() / elements.area) ** motion.stiffness_exponent
    if motion.distance_exponent:
        from scipy.spatial import KDTree  # takes a fifth of a second to load

        nodes = np.unique(mesh.edge_nodes[np.isin(mesh.label, problem.labels("interface"))])
        centroids = mesh.vertices[elements.vertices].mean(axis=1)
        distance = np.asarray(KDTree(mesh.p2_coordinates[nodes]).query(centroids)[0])
        alpha *= (distance.max() / distance) ** motion.distance_exponent
    return alpha


def outline(mesh: RawMesh, region: int) -> Sides:
    """Find the sides that belong to exactly one triangle of a region."""
    inside = mesh.region == region
    keys, p2 = mesh.sides[inside], mesh.p2[inside]
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    element, side = np.divmod(first[count == 1], 3)
    start, end = (side + 1) % 3, (side + 2) % 3
    corners = mesh.triangles[inside]
    nodes = np.column_stack([p2[element, start], p2[element, end], p2[element, 3 + side]])
    tangent = mesh.vertices[corners[element, end]] - mesh.vertices[corners[element, start]]
    return Sides(element, side, nodes, _labels_of(mesh, keys[element, side]), tangent)


def _labels_of(mesh: RawMesh, keys: Ints) -> Ints:
    """Label of the edge with each key, 0 where no edge has it."""
    if not mesh.edge_keys.size:
        return np.zeros(len(keys), dtype=np.int64)
    order = np.argsort(mesh.edge_keys)
    ranked = mesh.edge_keys[order]
    position = np.minimum(np.searchsorted(ranked, keys), len(ranked) - 1)
    return np.where(ranked[position] == keys, mesh.label[order[position]], 0)


def _mask(size: int, numbers: Ints) -> Mask:
    mask = np.zeros(size, dtype=np.bool_)
    mask[numbers.ravel()] = True
    return mask


def _rows(
    problem: Problem, mesh: RawMesh, fluid: FluidPart | None, solids: dict[int, SolidPart], time: float | None
) -> Rows:
    """Return the rows at a time, or of the steady system (None), where v is no unknown of a solid alone."""
    inside = mesh.region == FLUID_REGION
    in_fluid, in_solid = _mask(mesh.n_p2, mesh.p2[inside]), _mask(mesh.n_p2, mesh.p2[~inside])
    wet = _mask(len(mesh.vertices), mesh.triangles[inside])
    normal, corner = node_normals(mesh, problem.labels("slip"))
    held_u, held_v, prescribed = _conditions(problem, mesh, time, corner, in_solid)
    v_normal = normal.copy()
    for boundary in problem.boundaries:
        if boundary.still is not None:
            v_normal[mesh.edge_nodes[mesh.label == boundary.label]] = boundary.still
    none = np.zeros_like(in_solid)
    moving = fluid is not None or time is not None
    nv = len(mesh.vertices)
    pressed = [_mask(nv, mesh.triangles[mesh.region == region]) for region in problem.mixed_regions]
    incompressibility = np.array(pressed, dtype=np.bool_).reshape(-1, nv)
    moves = bool(solids) or problem.mesh_motion is not None
    u_given = held_u if moves else np.ones_like(held_u)
    v_given = held_v if moving else np.ones_like(held_v)
    return Rows(
        momentum=~held_v,
        continuity=wet,
        kinematics=in_solid & ~held_v if moving else none,
        mesh_motion=in_fluid & ~in_solid & ~held_u if moves else none,
        incompressibility=incompressibility,
        u_given=u_given,
        v_given=v_given,
        p_given=~wet,
        ps_given=~incompressibility,
        prescribed=prescribed,
        u_normal=np.where(u_given[:, None], 0.0, normal),
        v_normal=np.where(held_v[:, None], 0.0, v_normal),
    )


def _conditions(
    problem: Problem, mesh: RawMesh, time: float | None, corner: Mask, in_solid: Mask
) -> tuple[Mask, Mask, RawState]:
    """Nodes whose u, and whose v, a boundary prescribes, and the values at a time (None: steady); zero elsewhere.

    Corners (n2,) of slip boundaries rest, and nodes of solids at inlets and outlets.
    At a common node walls win over an inlet, those at rest over those that move along themselves, and of these the last
    one; walls with a displacement win over all others.
    """
    n2, nv = mesh.n_p2, len(mesh.vertices)
    held_u, held_v = corner.copy(), corner.copy()
    u, v, shift = np.zeros((3, n2, 2))
    told = np.ones_like(corner)

    def weight(boundary: Boundary) -> tuple[bool, bool, bool, int]:
        displaced = boundary.displacement is not None
        return displaced, boundary.role != "inlet", boundary.motion is None, boundary.label

    for boundary in sorted(problem.boundaries, key=weight):
        nodes = mesh.edge_nodes[mesh.label == boundary.label]
        if boundary.role in ("inlet", "outlet", "no-slip", "clamped"):
            held_u[nodes] = True
            held_v[nodes] |= in_solid[nodes]
        if boundary.role in ("inlet", "no-slip", "clamped"):
            held_v[nodes] = True
            v[nodes] = 0.0
        if boundary.role == "inlet" and (inflow := boundary.inflow or problem.inflow) is not None:
            walls = [b.label for b in problem.boundaries if b.role in ("no-slip", "clamped") and b.motion is None]
            resting = np.isin(nodes, mesh.edge_nodes[np.isin(mesh.label, walls)], kind="table") | in_solid[nodes]
            v[nodes] = _entering(inflow, mesh.p2_coordinates[nodes], resting, time or 0.0)
        if boundary.role == "no-slip" and boundary.circle is not None:
            if not problem.chords:
                _check_circle(boundary.name, boundary.circle, mesh.p2_coordinates[nodes[:, :2]])
            bent = nodes if problem.chords else nodes[:, 2:]
            u[bent] = _onto_circle(boundary.circle, mesh.p2_coordinates[bent])
        elif boundary.role == "no-slip" and boundary.curved:
            place_of = np.flatnonzero(mesh.label == boundary.label)
            if not problem.chords:
                u[nodes[:, 2]] = off_chords(mesh.vertices, mesh.edges[place_of])
            else:  # the halves of an edge are as far apart in the list as there are edges of the mesh before
                first, second = np.split(place_of, 2)
                whole = np.column_stack([mesh.edges[first, 0], mesh.edges[second, 1]])
                u[mesh.vertex_nodes[mesh.edges[first, 1]]] = way = off_chords(mesh.vertices, whole)
                for half in (first, second):  # a parabola at its quarters
                    u[mesh.edge_nodes[half, 2]] = 0.75 * way
        told[nodes] = boundary.motion is None
        if boundary.motion is not None:
            nodes = nodes.ravel()
            points = (mesh.p2_coordinates + u)[nodes]
            v[nodes] = boundary.motion(points, time or 0.0)
            if boundary.displacement is not None:
                shift[nodes] = boundary.displacement(points, time or 0.0)
    u += shift
    if (exact := problem.manufactured) is not None:
        # A fluid alone has no equation for u: it has the value everywhere.
        where = told & (held_u if problem.solids else True)
        u[where] = exact.displacement(mesh.p2_coordinates[where], time or 0.0)
        where = told & held_v
        v[where] = exact.velocity(mesh.p2_coordinates[where], time or 0.0)
    return held_u, held_v, RawState(u, v, np.zeros(nv), np.zeros((len(problem.mixed_regions), nv)))


def _entering(inflow: Inflow, points: Floats, resting: Mask, time: float) -> Floats:
    """Velocities (n, 3, 2) at the ends and middles (n, 3, 2) of an inlet's edges, of which some rest, (n, 3)."""
    values = inflow.at(points.reshape(-1, 2), time).reshape(points.shape)
    if not inflow.kept:
        return values
    values[resting] = 0.0
    start, along = points[:, None, 0], (points[:, 1] - points[:, 0])[:, None]
    length, inward = np.hypot(*along[:, 0].T), np.array(inflow.inward)
    s, gauss = gauss_rule(5)
    wanted = inflow.at((start + s[:, None] * along).reshape(-1, 2), time).reshape(-1, len(s), 2) @ inward
    through = length @ (values @ inward @ (np.array([1.0, 1.0, 4.0]) / 6.0))
    if abs(through) <= 0.01 * length.sum() * np.abs(values @ inward).max():
        return values
    return np.asarray(values * (length @ (wanted @ gauss) / through))


def _onto_circle(circle: tuple[float, float, float], points: Floats) -> Floats:
    """Displacement (..., 2) of ``points`` (..., 2) along the ray onto the circle."""
    *centre, radius = circle
    ray = points - np.array(centre)
    return np.asarray(ray * (radius / np.hypot(ray[..., :1], ray[..., 1:]) - 1.0))


def _check_circle(name: str, circle: tuple[float, float, float], points: Floats) -> None:
    """Refuse edges whose ends (n, 2, 2) do not lie on the circle."""
    *centre, radius = circle
    distance = np.hypot(*(points - np.array(centre)).reshape(-1, 2).T)
    if not (off := np.abs(distance / radius - 1.0).max()) <= 1e-8:
        raise ValueError(f"{name}: a vertex is {off:.1e} radii off the circle {circle}")


def place_in_solids(system: System, point: tuple[float, float]) -> tuple[Ints, Floats]:
    """Return the P2 nodes (6,) of the triangle in which, or nearest to which, a point of the solids lies; their values.

    The second array (6,) are the basis functions at the point.
    """
    best, found = -np.inf, (np.zeros(0, dtype=np.int64), np.zeros(0))
    for solid in system.solids.values():
        elements = solid.elements
        offset = np.array(point) - system.mesh.vertices[elements.vertices[:, 0]]
        unit = np.einsum("nij,nj->ni", elements.inverse, offset)
        inside = np.min([unit[:, 0], unit[:, 1], 1.0 - unit.sum(axis=1)], axis=0)
        triangle = int(inside.argmax())
        if inside[triangle] > best:
            best = inside[triangle]
            found = elements.nodes[triangle], p2_basis(unit[[triangle]])[0]
    return found
