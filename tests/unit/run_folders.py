"""Small run folders made without FreeFEM: a structured P2 mesh, given fields, and a stand-in for the process."""

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import structured

from ffsi.files import seals
from ffsi.files.arrays import RawMesh, RawState, write_mesh, write_state
from ffsi.freefem import Completed, Event, FreeFEMError
from ffsi.report import write_report
from ffsi.scene import load_scene

NEWTON = """point,loadFactor,stage,unknowns,iteration,residual,correction,step,factorized,min_jacobian,seconds
1,1,1,300,1,1.0,0.5,1,1,0.9,0.1
1,1,2,900,1,2e-1,0.1,1,1,0.9,0.1
1,1,2,900,2,1e-6,0.01,1,0,0.9,0.1
1,1,2,900,3,1e-12,1e-6,1,0,0.9,0.1
2,1,2,900,1,1e-11,1e-6,1,0,0.9,0.1
"""


def structured_mesh(nx: int = 10, ny: int = 4, length: float = 2.5, height: float = 0.4) -> RawMesh:
    """Rectangle of 2 nx ny triangles; column 2 of the lower half is region 2. P2 nodes are numbered backwards."""
    x, y = np.linspace(0, length, nx + 1), np.linspace(0, height, ny + 1)
    mesh = structured.structured_mesh(
        x, y, lambda at_x, at_y: 1 + (x[2] < at_x < x[3] and at_y < y[ny // 2]), lambda at_x, at_y: 3 * (at_y == 0)
    )
    bottom = mesh.label == 3
    edges = np.sort(mesh.edges[bottom])
    return replace(mesh, edges=edges[edges[:, 0].argsort()], label=mesh.label[bottom], p2=mesh.p2.max() - mesh.p2)


def given_state(mesh: RawMesh, scale: float = 1.0) -> RawState:
    """Quadratic u and v, linear p (zero inside the solid, as FreeFEM writes it); see `exact`."""
    at = mesh.p2_coordinates
    fields, p = exact(at[:, 0], at[:, 1], scale), exact(*mesh.vertices.T, scale)["p"]
    fluid = np.zeros(len(p), dtype=bool)
    fluid[mesh.triangles[mesh.region == 1]] = True
    return RawState(
        u=np.column_stack([fields["ux"], fields["uy"]]),
        v=np.column_stack([fields["vx"], fields["vy"]]),
        p=np.where(fluid, p, 0.0),
    )


def exact(x: Any, y: Any, scale: float = 1.0) -> dict[str, Any]:
    return {
        "ux": scale * (0.02 * y + 0.1 * y**2 - 0.01 * x * y), "uy": scale * (-0.05 * y**2),
        "vx": 6 * y * (0.4 - y) + 0.1 * x * y, "vy": 0.2 * x * y - 0.1 * x**2 + 0.03, "p": 4.0 - 2.0 * x + 0.5 * y,
    }  # fmt: skip


def point_json(
    case: str, number: int, parameters: Mapping[str, float], status: str = "converged", reason: str = ""
) -> str:
    velocity = parameters.get("inflow.mean_velocity", 1.0)
    return json.dumps(
        {
            "case": case, "status": status, "reason": reason, "point": number, "level": parameters.get("mesh.level", 0),
            "unknowns": 900, "triangles": 80, "parameters": dict(parameters),
            "quantities": {"drag": 2 * velocity, "lift": -velocity, "tip_ux": 0.01 * velocity, "min_jacobian": 0.5},
            "newton": {"iterations": 4, "factorizations": 2},
            "timings": {"mesh": 0.1, "solve": 0.2, "output": 0.05, "script": 0.4 * number},
            "freefem": {"version": "4.9", "solver": "MUMPS"},
        }
    )  # fmt: skip


def make_run(directory: Path, case: str = "flap-svk", **changes: Any) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    scene, mesh = load_scene(case, ["mesh.level=0"]), structured_mesh()
    write_mesh(directory / "mesh.bin", mesh)
    write_state(directory / "point-0001.bin", given_state(mesh))
    point = point_json(case, 1, scene.parameters())
    (directory / "point-0001.json").write_text(point)
    (directory / "case.edp").write_text("// nothing\n")
    (directory / "scene.toml").write_text(scene.to_toml())
    (directory / "newton.csv").write_text(NEWTON)
    data = json.loads(point) | {
        "check": {"momentum": 1e-11, "continuity": 2e-12}, "checked": True, "failure": "", "check_failures": [],
        "state": "point-0001.bin", "files": seals.seal_all(directory, ("*",)),
    }  # fmt: skip
    seals.write(directory / "result.json", data | changes)
    return directory


def report_text(folder: Path, *runs: Path, **options: Any) -> str:
    """Write a report of runs into a folder and return what it holds."""
    write_report(runs, folder / "report.html", **options)
    return (folder / "report.html").read_text()


class FakeFreeFEM:
    """Takes the place of `run_script`: writes what a script writes, up to the velocity `fail` or `die`."""

    def __init__(self) -> None:
        self.fail: float | None = None
        self.limit = math.inf
        self.die: float | None = None
        self.death = "crash"
        self.solved: list[float] = []
        self.needs_neighbour = False

    def run_script(
        self, script: Path, arguments: Mapping[str, str], *, log: Path, on_event: Callable[[Event], None] | None = None,
        **_: Any,
    ) -> Completed:  # fmt: skip
        out = Path(arguments["out"])
        scene, mesh = load_scene(str(out / "scene.toml"), []), structured_mesh()
        write_mesh(out / "mesh.bin", mesh)
        (out / "newton.csv").write_text(NEWTON)
        points = _points(Path(arguments["points"])) if "points" in arguments else [{}]
        log.write_text("@ffsi start\n")
        for number, values in enumerate(points, start=1):
            parameters = scene.parameters() | values
            velocity = parameters["inflow.mean_velocity"]
            if velocity == self.die:
                raise FreeFEMError(self.death, "signal 11, SIGSEGV", log=log)
            far = self.needs_neighbour and number == 1 and velocity > 0.05
            if velocity == self.fail or velocity > self.limit or far:
                write_state(out / "failed.bin", given_state(mesh, 0.5))
                (out / "failed.json").write_text(point_json(scene.name, number, parameters, "failed", "J too small"))
                return Completed("failed", 3, 0.1, "J too small", (), {}, 0, log)
            write_state(out / f"point-{number:04d}.bin", given_state(mesh))
            (out / f"point-{number:04d}.json").write_text(point_json(scene.name, number, parameters))
            self.solved.append(velocity)
            if on_event is not None:
                on_event(Event("point", {"point": number, "points": len(points), "status": "converged"}))
        return Completed("converged", 0, 0.1, "", (), {}, 0, log)


def _points(path: Path) -> list[dict[str, float]]:
    words = path.read_text().split()
    count = int(words[0])
    names = [name.replace("inflow_", "inflow.").replace("fluid_", "fluid.") for name in words[1 : 1 + count]]
    numbers = [float(word) for word in words[2 + count :]]
    assert len(numbers) == count * int(words[1 + count])
    return [dict(zip(names, numbers[i : i + count], strict=True)) for i in range(0, len(numbers), count)]


class FakeCheck:
    """Takes the place of `check_run`; `wrong` is a velocity whose check fails, `wait_for` a file to wait for."""

    def __init__(self) -> None:
        self.wrong: float | None = None
        self.wait_for: Path | None = None
        self.calls: list[tuple[float, int]] = []

    def __call__(self, directory: Path, scene: Any, point: int = 1, **_: Any) -> SimpleNamespace:
        velocity = scene.inflow.mean_velocity
        self.calls.append((velocity, point))
        while self.wait_for is not None and not self.wait_for.is_file():
            time.sleep(0.001)
        failures = ["momentum: the relative residual of the momentum is 1.00e-03"] if velocity == self.wrong else []
        names = (
            "momentum", "continuity", "kinematics", "mesh_motion", "incompressibility", "dirichlet", "drag_difference",
            "lift_difference",
        )  # fmt: skip
        numbers = dict.fromkeys(names, 1e-12) | {
            "momentum": 1e-3 if failures else 1e-11, "coefficient_difference": None, "outlet_difference": None,
            "wall_difference": None, "sensitivities_difference": None, "errors_difference": None,
            "start_difference": None, "quantities_difference": 1e-13,
        }  # fmt: skip
        return SimpleNamespace(**numbers, passed=not failures, failures=failures)
