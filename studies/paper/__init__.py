"""The study of the paper's sections 5.1 to 5.3 (figures 3 to 14), from sweeps over the mean inflow velocity.

The paper: "Finite Element Method for Strongly Coupled Fluid-Structure Interaction of a Vertical Flap in a Channel and
Aneurysm Hemodynamics".
"""

from studies.paper.cases import CASES, Curve, PaperCase
from studies.paper.study import main
from studies.paper.sweeps import Outcome

__all__ = ["CASES", "Curve", "Outcome", "PaperCase", "main"]
