"""Blood that thins with shear: the wall shear stress of a Carreau fluid beside that of a Newtonian one."""

import ffsi

newtonian = ffsi.Scene.from_toml("""
name = "vessel"
geometry = {kind = "channel", length = "8 mm", height = "2 mm"}
fluid = {density = "1.06 g/cm^3", viscosity = "3.45 mPa s"}
inflow = {mean_velocity = "1 cm/s"}
outlet = {kind = "do-nothing"}
mesh = {level = 1}
output = {pictures = false}
""")
carreau = ffsi.with_values(newtonian, {"fluid.law": "carreau"})  # its constants are those of blood

stress = {}
for scene in (newtonian, carreau):
    walls = ffsi.solve(scene).wall  # one row per edge of the walls
    middle = walls[(walls["x"] > 3e-3) & (walls["x"] < 5e-3)]
    stress[scene.fluid.law] = middle["wss"].mean()
print(stress)

assert abs(stress["newtonian"] / (6 * 3.45e-3 * 0.01 / 2e-3) - 1) < 1e-3  # 6 mu U / H
assert 1.5 < stress["carreau"] / stress["newtonian"] < 3
