"""A scene in time: a beam that falls under its weight (CSM3), its history as a table and a picture."""

import ffsi

scene = ffsi.load_scene("turek-csm3", ["mesh.level=0", "time.step=0.02", "time.end=0.6"])
result = ffsi.solve(scene, "runs/csm3")
history = result.history  # pandas: one row per step
history.plot("time", "tip_uy", xlabel="t, s", ylabel="u_y of the tip, m").figure.savefig("runs/csm3/tip.png")

energy = history["kinetic"] + history["elastic"]
print(f"lowest at t = {history['time'][history['tip_uy'].idxmin()]:.2f} s, {history['tip_uy'].min():.4f} m")
print(f"work {history['work'].iloc[-1]:.4f} J/m, energy {energy.iloc[-1]:.4f} J/m")
assert abs(history["tip_uy"].min() + 0.129) < 0.003  # published: -63.6 - 65.2 mm
assert abs(energy - history["work"]).max() < 0.01 * history["work"].max()
