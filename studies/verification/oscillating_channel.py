"""Womersley's oscillating flow between two plane walls: the exact one, and runs beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.hemodynamics.result import Result
from ffsi.scene import Scene
from studies.verification.measured import Measured

# Half the height is 3 times the thickness sqrt(nu / omega) of the layer that oscillates with the walls (Womersley's
# number). SI units.
HEIGHT, LENGTH, DENSITY, VISCOSITY, PERIOD, RATE, SWING = 1.0, 2.0, 1.0, 0.1745, 1.0, 1.0, 0.75
CYCLES, SAVED = 3, 16
_ACROSS = 41


def oscillating_flow(y: Floats, t: float) -> tuple[Floats, float]:
    """Return the velocity (m/s) at heights y (m) above the lower wall and -dp/dx (Pa/m) at the time t (s).

    The flow rate is RATE (1 + SWING sin(omega t)): Poiseuille's flow, and the real part of
    v = G / (i omega rho) (1 - cosh(b s) / cosh(b h)) e^(i omega t) with b^2 = i omega rho / mu, s = y - h, h half the
    height, for a pressure gradient G e^(i omega t).
    """
    omega, h = 2 * np.pi / PERIOD, HEIGHT / 2
    b = np.sqrt(1j * omega * DENSITY / VISCOSITY)
    per_gradient = (2 * h - 2 * np.tanh(b * h) / b) / (1j * omega * DENSITY)  # flow rate of G = 1
    gradient = -1j * SWING * RATE / per_gradient * np.exp(1j * omega * t)
    swing = gradient / (1j * omega * DENSITY) * (1 - np.cosh(b * (y - h)) / np.cosh(b * h))
    steady = 6 * RATE / HEIGHT**3 * y * (HEIGHT - y)
    return steady + swing.real, float(12 * VISCOSITY * RATE / HEIGHT**3 + gradient.real)


@dataclass(frozen=True)
class OscillatingCase:
    """A run on a mesh level with a time step in s."""

    level: int
    step: float
    group = "oscillating"

    @property
    def folder(self) -> str:
        """Name of the run folder."""
        return f"oscillating-level-{self.level}-steps-{round(PERIOD / self.step)}"

    @property
    def labels(self) -> tuple[str, ...]:
        """Mesh level and time step."""
        return str(self.level), f"{self.step:g}"

    @property
    def scene(self) -> Scene:
        """What is solved, from rest."""
        interval = PERIOD / SAVED
        return Scene.model_validate({
            "name": self.folder,
            "geometry": {"kind": "channel", "length": LENGTH, "height": HEIGHT},
            "mesh": {"level": self.level},
            "fluid": {"density": DENSITY, "viscosity": VISCOSITY},
            "inflow": {"flow_rate": RATE, "profile": "womersley", "waveform": "sinus"},
            "outlet": {"kind": "do-nothing"},
            "time": {"step": self.step, "end": CYCLES * PERIOD, "output_interval": interval},
            "output": {"pictures": False, "vtu": False},
        })  # fmt: skip

    def measure(self, result: Result) -> dict[str, Measured]:
        """Return the largest differences of velocity and pressure drop, relative to their largest exact values.

        Over the saved states of the last cycle, across the channel at inlet, middle and outlet.
        """
        y = np.linspace(0, HEIGHT, _ACROSS)
        steps = [step for step in result.saved_steps if step.time > (CYCLES - 1) * PERIOD * (1 + 1e-9)]
        differences, sizes = np.zeros(2), np.zeros(2)
        for step in steps:
            fields = result.fields_of(step)
            velocity, _ = oscillating_flow(y, step.time)
            for x in (0.0, LENGTH / 2, LENGTH):
                found = fields.sample(np.column_stack([np.full_like(y, x), y]))
                differences[0] = max(differences[0], np.hypot(found["vx"] - velocity, found["vy"]).max())
            # Where the pressure of a step belongs: at its weighted time.
            _, gradient = oscillating_flow(y, step.time - (1 - step.theta) * step.k)
            p = fields.sample([(0.0, HEIGHT / 2), (LENGTH, HEIGHT / 2)])["p"]
            differences[1] = max(differences[1], abs(p[0] - p[1] - LENGTH * gradient))
            sizes = np.maximum(sizes, [np.abs(velocity).max(), LENGTH * abs(gradient)])
        velocity_difference, drop_difference = differences / sizes
        return {
            "steps": Measured(float(result.data["time"]["steps"])),
            "velocity_difference": Measured(float(velocity_difference)),
            "pressure_difference": Measured(float(drop_difference)),
        }


OSCILLATING_CASES = (OscillatingCase(0, 0.0125), OscillatingCase(1, 0.00625))
