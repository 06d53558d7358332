"""One parameter in many values, one table: the flap's tip over the inflow velocity, and a picture of it."""

import ffsi

scene = ffsi.load_scene("flap-neo-hookean", ["mesh.level=0"])
velocities = [0.0055 * k for k in range(1, 6)]
table = ffsi.sweep(scene, {"inflow.mean_velocity": velocities}, "runs/flap-sweep")  # called again: only what is missing
print(table[["inflow.mean_velocity", "tip_ux", "drag", "status"]])

axes = table.plot("inflow.mean_velocity", "tip_ux", marker="o", xlabel="mean velocity, m/s", ylabel="u_x of the tip, m")
axes.figure.savefig("runs/flap-sweep/tip.png")

assert (table["status"] == "converged").all()
assert table["tip_ux"].is_monotonic_increasing
