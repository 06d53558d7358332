"""Solids with a pressure of their own: Cook's membrane at Poisson's ratio 0.4999 and at 1/2, without locking."""

import ffsi

values = {"solid.membrane.poisson_ratio": 0.4999, "solid.membrane.young_modulus": 240.565, "traction.y": 6.25}
scene = ffsi.load_scene("cook", ["mesh.level=0", "solid.membrane.formulation=mixed"])
nearly = ffsi.with_values(scene, values)
fully = ffsi.with_values(nearly, {"solid.membrane.formulation": "incompressible"})

tips = [ffsi.solve(scene).quantities["tip_uy"] for scene in (nearly, fully)]
print(f"u_y of the tip: {tips[0]:.4f} m nearly, {tips[1]:.4f} m fully incompressible")
assert abs(tips[0] / tips[1] - 1) < 1e-3
