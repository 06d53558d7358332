"""A resistance behind the outlet: the pressure there follows from the flow rate, whatever the velocity."""

import ffsi

scene = ffsi.load_scene("cylinder-2d1", ["mesh.level=0", "outlet.kind=resistance", "outlet.resistance=2 Pa s/m^2"])
table = ffsi.sweep(scene, {"inflow.mean_velocity": [0.1, 0.2]}, "runs/outlet")
table["pressure"] = 2 * table["flow_rate_out"]
print(table[["inflow.mean_velocity", "flow_rate_out", "outlet_pressure", "pressure"]])

assert abs(table["flow_rate_out"] / (0.41 * table["inflow.mean_velocity"]) - 1).max() < 1e-3
assert abs(table["outlet_pressure"] / table["pressure"] - 1).max() < 1e-10
