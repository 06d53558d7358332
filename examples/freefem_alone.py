"""FreeFEM without Python: a script is rendered once, and any number of it is a flag."""

import json
import os
import subprocess
import sys
from pathlib import Path

subprocess.run([sys.executable, "-m", "ffsi", "render", "turek-cfd1", "-o", "cfd1.edp"], check=True)

out = Path("runs/direct")
out.mkdir(parents=True, exist_ok=True)
debian = {"FF_LOADPATH": "/usr/lib/freefem++;;"}
flags = ["-mesh_level", "0", "-inflow_mean_velocity", "0.1", "-out", str(out)]
subprocess.run(["FreeFem++-nw", "-nw", "-ns", "-v", "0", "cfd1.edp", *flags], check=True, env={**os.environ, **debian})

point = json.loads((out / "point-0001.json").read_text())
print(point["parameters"]["inflow.mean_velocity"], point["quantities"]["drag"])
assert point["status"] == "converged"
assert 4 < point["quantities"]["drag"] < 8  # at 0.2 m/s 14.3 N/m; more than a quarter of it at half the velocity
