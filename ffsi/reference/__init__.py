"""Independent reference checker: numpy and scipy only, no code and no formula text shared with the FreeFEM scripts.

``check_run``, ``check_state`` and ``check_step`` judge a solution; ``ffsi.reference.solve`` computes small ones, steady
or step by step, from scratch.
"""

from ffsi.reference.check import CheckReport, check_run, check_state, check_step
from ffsi.reference.problem import Boundary, Fluid, MeshMotion, Problem, Solid
from ffsi.reference.step import Step
from ffsi.reference.system import System

__all__ = [
    "Boundary",
    "CheckReport",
    "Fluid",
    "MeshMotion",
    "Problem",
    "Solid",
    "Step",
    "System",
    "check_run",
    "check_state",
    "check_step",
]
