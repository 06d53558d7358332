"""A run in time that is stopped goes on from its last checkpoint, to the history that it would have had."""

from pathlib import Path

import ffsi

settings = ["mesh.level=0", "time.step=0.02", "time.end=0.24", "time.checkpoint_interval=0.06", "output.vtu=false"]
scene = ffsi.load_scene("turek-csm3", settings)


def stop_in_the_middle(event) -> None:
    """Ask the script to end after its step, as `echo 1 > runs/stopped/stop` does."""
    if event.kind == "time" and event.integer("step") == 6:
        Path("runs/stopped/stop").write_text("1\n")


stopped = ffsi.solve(scene, "runs/stopped", on_event=stop_in_the_middle)
print(f"{stopped.failure} at t = {stopped.history['time'].iloc[-1]:g} s")
assert stopped.failure == "stopped"

resumed = ffsi.resume("runs/stopped")
assert "step=1 " not in Path("runs/stopped/freefem.log").read_text()  # only what came after the checkpoint is solved
whole = ffsi.solve(scene, "runs/whole")
assert len(resumed.history) == len(whole.history) == 12
# The step at the stop is solved to round-off, as a last one; others to solver.step_tolerance.
assert abs(resumed.history["tip_uy"] - whole.history["tip_uy"]).max() < 1e-6
