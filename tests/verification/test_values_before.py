"""The numbers of every scene as they were before: what is no change of the mathematics keeps them.

`python tests/verification/test_values_before.py` solves all scenes and writes data/values-before.json anew.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from units_scaling import first_steps

from ffsi.result.quantities import unit
from ffsi.run import solve
from ffsi.scene import CASES, load_scene

TABLE = Path(__file__).parent / "data" / "values-before.json"
PLAIN = ["output.pictures=false", "output.vtu=false"]
UNCOUNTED = ("seconds",)
COUNTS = ("iteration", "iterations", "factorized", "point", "stage", "unknowns")
# Structures of which the catalogue has no scene: name -> case and settings, on level 0.
STRUCTURES: dict[str, tuple[str, list[str]]] = {
    "incompressible flap": ("flap-neo-hookean", ["solid.flap.formulation=incompressible", "inflow.mean_velocity=0.03"]),
    "mixed flap and roof": ("flap-mooney-rivlin-roof", ["solid.flap.formulation=mixed", "inflow.mean_velocity=0.03"]),
    "mixed membrane": ("cook", ["solid.membrane.formulation=mixed"]),
    "incompressible beam in time": ("turek-fsi3",
        ["solid.beam.material=neo-hookean", "solid.beam.formulation=incompressible"]),
    "mixed beam in time": ("turek-fsi3", ["solid.beam.material=neo-hookean", "solid.beam.formulation=mixed"]),
    "mixed beam alone in time": ("turek-csm3", ["solid.beam.material=neo-hookean", "solid.beam.formulation=mixed"]),
    "neo-hookean beam in time by Newton": ("turek-fsi2", ["solid.beam.material=neo-hookean", "solver.step=newton"]),
    "harmonic motion in time": ("turek-fsi2", ["mesh_motion.kind=harmonic", "mesh_motion.distance_exponent=1"]),
    "linear-elastic motion": ("flap-svk", ["mesh_motion.kind=linear-elastic"]),
    "power law": ("turek-cfd1", ["fluid.law=power-law", "fluid.consistency=1.0", "fluid.exponent=0.7"]),
    "casson": ("aneurysm-carreau", ["fluid.law=casson", "fluid.yield_stress=0.004", "fluid.viscosity_infinity=0.0035"]),
    "zero traction": ("turek-fsi1", ["outlet.kind=zero-traction"]),
    "pressure behind an elastic wall": ("turek-fsi1",
        ["outlet.kind=pressure", "outlet.pressure=30", "outlet.backflow=0.5"]),
    "resistance between rigid walls": ("turek-cfd1", ["outlet.kind=resistance", "outlet.resistance=100"]),
    "resistance behind an elastic wall": ("turek-fsi1", ["outlet.kind=resistance", "outlet.resistance=100"]),
    "windkessel between rigid walls": ("turek-cfd3", ["outlet.kind=windkessel", "outlet.proximal_resistance=10",
        "outlet.distal_resistance=50", "outlet.compliance=0.01"]),
    "windkessel behind an elastic wall": ("turek-fsi3", ["outlet.kind=windkessel", "outlet.proximal_resistance=10",
        "outlet.distal_resistance=50", "outlet.compliance=0.01", "outlet.backflow=0.5"]),
    "gravity": ("turek-fsi1", ["gravity.y=-2", "outlet.hydrostatic=true"]),
    "gravity in time": ("turek-fsi3", ["gravity.y=-2", "outlet.hydrostatic=true"]),
    "support of the walls": ("aneurysm-carreau", ["support.stiffness=1e8"]),
    "support of the walls in time": ("aneurysm-pulsatile", ["support.stiffness=1e8", "support.damping=1e3"]),
    "rigid aneurysm": ("aneurysm-carreau", ["solid.vessel=none", "solid.dome=none", "mesh_motion=none"]),
    "rigid pulsatile aneurysm": ("aneurysm-pulsatile",
        ["solid.vessel=none", "solid.dome=none", "mesh_motion=none", "support=none"]),
    "womersley": ("aneurysm-pulsatile", ["inflow.profile=womersley"]),
    "stent": ("aneurysm-carreau", ["geometry.stent.count=5", "geometry.stent.diameter=1e-4"]),
    "backward euler": ("turek-fsi3", ["time.scheme=backward-euler"]),
    "ordinary start": ("flap-neo-hookean", ["solver.start=rest", "solver.linear_solver=umfpack"]),
}  # fmt: skip
RUNS = {
    **{f"{case} on level {level}": (case, [f"mesh.level={level}"]) for case in CASES for level in (0, 1)},
    **{name: (case, ["mesh.level=0", *settings]) for name, (case, settings) in STRUCTURES.items()},
}


def values(name: str, folder: Path) -> dict[str, Any]:
    """Solve a run, in time its first ten steps; return quantities, and columns of the history without the seconds."""
    case, settings = RUNS[name]
    result = solve(load_scene(case, [*PLAIN, *first_steps(case, 10), *settings]), folder, check=False)
    assert result.converged, result.reason
    history = {key: result.history[key].tolist() for key in result.history.columns if key not in UNCOUNTED}
    return {"quantities": result.last_quantities, "history": history}


@pytest.mark.parametrize("name", RUNS)
def test_the_numbers_are_those_of_before(tmp_path, name):
    before, now = json.loads(TABLE.read_text(encoding="utf-8"))[name], values(name, tmp_path / "run")
    assert now["quantities"].keys() == before["quantities"].keys() and now["history"].keys() == before["history"].keys()
    for key in set(COUNTS) & before["history"].keys():
        assert now["history"][key] == before["history"][key], key
    for table, bound in ("quantities", 1e-9), ("history", 1e-8):
        columns = {key: value for key, value in before[table].items() if key not in COUNTS}
        if "residual" in columns:
            continue  # of Newton's iterations: the last ones are rounding
        # Of all in a unit: a lift that is rounding beside the drag is no size of its own. The balance is relative.
        size = {"mass_balance": 1.0}
        for key, value in columns.items():
            size[group(key)] = max(size.get(group(key), 0.0), largest(value))
        for key, value in columns.items():
            other = now[table][key]
            found = largest([a - b for a, b in zip(listed(value), listed(other), strict=True)])
            assert found <= bound * size[group(key)], f"{key}: {value} before, {other} now"


def group(key: str) -> str:
    """Return what has the same unit, and with it a common size."""
    if key in ("kinetic", "elastic", "dissipated", "work"):
        return "energy"
    if key.endswith("_coefficient"):
        return "coefficient"
    return key if unit(key) == "1" else unit(key)


def listed(value: float | list[float]) -> list[float]:
    return value if isinstance(value, list) else [value]


def largest(value: float | list[float]) -> float:
    return max((abs(number) for number in listed(value)), default=0.0)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        found = {}
        for number, name in enumerate(RUNS):
            print(name, file=sys.stderr, flush=True)
            found[name] = values(name, Path(scratch) / str(number))
    TABLE.parent.mkdir(exist_ok=True)
    lines = (f"{json.dumps(name)}: {json.dumps(run)}" for name, run in found.items())
    TABLE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
