"""Independent reference checker: numpy and scipy only, no code and no formula text shared with the FreeFEM scripts.

``check_run`` and ``check_state`` judge a solution, ``ffsi.reference.solve.solve`` computes small ones from scratch.
"""

from ffsi.reference.check import CheckReport, check_run, check_state
from ffsi.reference.problem import Boundary, Fluid, MeshMotion, Problem, Solid
from ffsi.reference.system import System

__all__ = [
    "Boundary",
    "CheckReport",
    "Fluid",
    "MeshMotion",
    "Problem",
    "Solid",
    "System",
    "check_run",
    "check_state",
]
