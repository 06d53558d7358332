"""A scene as TOML, with units: flow between two plates, whose pressure drop is known exactly."""

from pathlib import Path

import ffsi

SCENE = """
name = "plates"
geometry = {kind = "channel", length = "5 cm", height = "1 cm"}
fluid = {density = "1 g/cm^3", viscosity = "10 mPa s"}
inflow = {mean_velocity = "2 cm/s"}
outlet = {kind = "do-nothing"}
mesh = {level = 1}
"""
Path("plates.toml").write_text(SCENE)
scene = ffsi.load_scene("plates.toml")
print(scene)  # what is not stated has its default; the units are SI

result = ffsi.solve(scene)
exact = 12 * 0.01 * 0.02 * 0.05 / 0.01**2  # 12 mu U L / H^2
print(f"pressure drop {result.quantities['pressure_drop']:.6f} Pa, exact {exact:.6f} Pa")
assert abs(result.quantities["pressure_drop"] / exact - 1) < 1e-6
