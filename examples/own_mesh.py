"""A mesh of one's own: a channel over an elastic floor, written with meshio; Gmsh's files work in the same way."""

from pathlib import Path

import meshio
import numpy as np

import ffsi

NX, FLUID, SOLID = 40, 10, 3  # cells along the channel, across the fluid, across the floor
x = np.linspace(0, 4, NX + 1)
y = np.concatenate([np.linspace(-0.15, 0, SOLID + 1), np.linspace(0, 1, FLUID + 1)[1:]])
points = np.array([(a, b, 0.0) for b in y for a in x])


def node(i: int, j: int) -> int:
    """Return the number of a point."""
    return j * (NX + 1) + i


triangles, regions, edges, sides = [], [], [], []
for j in range(SOLID + FLUID):
    for i in range(NX):
        a, b, c, d = node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)
        triangles += [(a, b, c), (a, c, d)]
        regions += 2 * [2 if j < SOLID else 1]  # 1: fluid, 2: floor
    edges += [(node(0, j), node(0, j + 1)), (node(NX, j), node(NX, j + 1))]
    sides += [13, 13] if j < SOLID else [11, 12]  # 11 inlet, 12 outlet, 13 the floor's ends
edges += [(node(i, SOLID + FLUID), node(i + 1, SOLID + FLUID)) for i in range(NX)]
sides += NX * [14]  # the wall above
meshio.Mesh(
    points, [("triangle", triangles), ("line", edges)], cell_data={"medit:ref": [np.array(regions), np.array(sides)]}
).write("channel.mesh")

Path("floor.toml").write_text("""
name = "floor"
fluid = {density = 1, viscosity = 0.01}
inflow = {mean_velocity = 1}
outlet = {kind = "do-nothing"}

[geometry]
kind = "mesh"
file = "channel.mesh"
regions = {fluid = 1, floor = 2}  # the interface is where the two share edges
boundaries = {inlet = 11, outlet = 12, clamped = 13, walls = 14}

[solid.floor]
material = "st-venant-kirchhoff"
density = 1000
young_modulus = 50000
poisson_ratio = 0.4
""")
result = ffsi.solve("floor.toml", "runs/floor")
print(result)

# The pressure falls evenly along the channel: its force on the floor is half of the drop times the length.
assert result.quantities["tip_uy"] < 0
assert abs(result.quantities["lift"] / (-4 * result.quantities["pressure_drop"] / 2) - 1) < 0.05
