"""An aneurysm with rigid walls: how much blood enters the dome, and the shear stress that it leaves there."""

import ffsi

settings = ["mesh.level=1", "solid.vessel=none", "solid.dome=none", "mesh_motion=none"]
result = ffsi.solve(ffsi.load_scene("aneurysm", settings), "runs/aneurysm")
quantities = result.quantities
print(f"flow into the dome {quantities['dome_inflow']:.3e} m²/s, turnover {quantities['turnover_time']:.2f} s")
print(f"wall shear stress: dome {quantities['wss_mean_dome']:.4f} Pa, vessel {quantities['wss_mean_vessel']:.4f} Pa")
result.picture("velocity").savefig("runs/aneurysm/flow.png")

assert abs(quantities["mass_balance"]) < 1e-8
assert abs(quantities["wss_mean_dome"] / 0.01489 - 1) < 0.01  # an independent code of high order
