"""A stand-in for the script of a scene in time: given signals, and all the files that the real one writes."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from run_folders import given_state, point_json, structured_mesh

from ffsi.files.arrays import read_arrays, write_arrays, write_mesh, write_state
from ffsi.files.checkpoints import CHECKPOINT_VERSION
from ffsi.freefem import Completed, Event, FreeFEMError
from ffsi.scene import Scene, load_scene

HEAD = "time,step,drag,lift,tip_ux,tip_uy,min_jacobian,iterations,factorized,seconds\n"
NEWTON_HEAD = "step,time,dt,iteration,correction,factorized,kept,min_jacobian,seconds\n"
STEPS_HEAD = "step,time,k,theta,old,new,drag,lift\n"
FREQUENCY = 1.0


def scene_in_time(*settings: str) -> Scene:
    """Return FSI3 with 40 steps to t = 2 s, fields every 0.5 s, checkpoints every 0.25 s and no pictures."""
    plain = [*("mesh.level=0", "output.pictures=false", "output.vtu=false", "inflow.ramp=0.1", "time.stop=end")]
    steps = ["time.step=0.05", "time.end=2", "time.output_interval=0.5", "time.checkpoint_interval=0.25"]
    return load_scene("turek-fsi3", [*plain, *steps, *settings])


def signals(t: float) -> dict[str, float]:
    """Drag and lift (N/m), tip_ux and tip_uy (m) and the smallest J at the time t (s)."""
    angle = 2 * math.pi * FREQUENCY * t
    return {
        "drag": 400 + 20 * math.sin(2 * angle), "lift": 3 + 150 * math.sin(angle + 1),
        "tip_ux": -0.003 + 0.002 * math.cos(2 * angle), "tip_uy": 0.001 + 0.03 * math.sin(angle),
        "min_jacobian": 0.5 + 0.1 * math.cos(2 * angle),
    }  # fmt: skip


def write_checkpoint(path: Path, step: int, time: float, size: int = 7) -> None:
    state = np.full(size, float(step))
    head, mark = np.array([CHECKPOINT_VERSION, step, size, 5, 3, 1, 0, 0, 0, 1, 1, 0]), np.array([step])
    factors = [mark, np.array([0.05, 0.5]), np.concatenate([state, state])]
    kept = [np.array([1, 1, 1]), mark, mark, np.zeros(9), np.concatenate([state, state])]
    write_arrays(path, [head, np.array([time, 0.05, 0.05, 0.05, 0.05, 2.0]), *[state] * 4, *factors, *kept, mark])


class FakeTimeFreeFEM:
    """Takes the place of `run_script` for a scene in time; `die` and `fail` are step numbers."""

    def __init__(self) -> None:
        self.die: int | None = None
        self.fail: int | None = None
        self.stop_at: int | None = None
        self.arguments: list[dict[str, str]] = []
        self.first_steps: list[int] = []

    def run_script(
        self, script: Path, arguments: Mapping[str, str], *, log: Path, on_event: Callable[[Event], None] | None = None,
        **_: Any,
    ) -> Completed:  # fmt: skip
        self.arguments.append(dict(arguments))
        out = Path(arguments["out"])
        scene = load_scene(str(out / "scene.toml"), [])
        assert scene.time is not None
        k, end = scene.time.step, scene.time.end
        log.write_text("@ffsi start\n")
        (out / "stop").write_text("0\n")
        step = 0
        if "resume" in arguments:
            head, *_rest = read_arrays(Path(arguments["resume"]), (int, float), more=float)
            step = int(head[1])
        else:
            for name, text in (("history", HEAD), ("newton", NEWTON_HEAD), ("steps", STEPS_HEAD)):
                (out / f"{name}.csv").write_text(text)
        self.first_steps.append(step + 1)
        mesh, turn = structured_mesh(), 0
        while step * k < end * (1 - 1e-9):
            step += 1
            if step == self.fail:
                write_mesh(out / "mesh.bin", mesh)
                write_state(out / "failed.bin", given_state(mesh, 0.5))
                (out / "failed.json").write_text(point_json(scene.name, 1, scene.parameters(), "failed", "no step"))
                return Completed("failed", 3, 0.1, "no step", (), {}, 0, log)
            t = round(step * k, 12)
            at = signals(t)
            self._append(out / "history.csv", t, k, *at.values(), 2, int(step % 10 == 1), 0.01 * step)
            self._append(out / "newton.csv", step, t, k, 0, 1e-3, int(step % 10 == 1), 3, 0.5, 0.01 * step)
            if step % round((scene.time.output_interval or end) / k) == 0:
                write_mesh(out / "mesh.bin", mesh)
                names = [f"state-{number:06d}.bin" for number in (step - 1, step)]
                for name, number in zip(names, (step - 1, step), strict=True):
                    write_state(out / name, given_state(mesh, math.sin(2 * math.pi * FREQUENCY * number * k)))
                self._append(out / "steps.csv", step, t, k, 0.55, *names, at["drag"], at["lift"])
            if on_event is not None:
                on_event(Event("time", {"step": step, "time": t, "end": end, "dt": k, "iterations": 2}))
            if step == self.stop_at:
                (out / "stop").write_text("1\n")
            if step == self.die:
                with (out / "history.csv").open("a") as file:
                    file.write("0.123,0.05,4")
                raise FreeFEMError("killed", "killed", log=log)
            if scene.time.checkpoint_interval and step % round(scene.time.checkpoint_interval / k) == 0:
                write_checkpoint(out / f"checkpoint-{'ab'[turn]}.bin", step, t)
                turn = 1 - turn
            if (out / "stop").read_text().startswith("1"):
                break
        write_mesh(out / "mesh.bin", mesh)
        write_state(out / "point-0001.bin", given_state(mesh))
        (out / "point-0001.json").write_text(point_json(scene.name, 1, scene.parameters()))
        if on_event is not None:
            on_event(Event("point", {"point": 1, "points": 1, "status": "converged"}))
        return Completed("converged", 0, 0.1, "", (), {}, 0, log)

    @staticmethod
    def _append(path: Path, *cells: object) -> None:
        with path.open("a") as file:
            file.write(",".join(str(cell) for cell in cells) + "\n")
