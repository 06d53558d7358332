"""The study of the paper's sections 5.1 to 5.3 (figures 3 to 14), from sweeps over the mean inflow velocity.

The paper: "Finite Element Method for Strongly Coupled Fluid-Structure Interaction of a Vertical Flap in a Channel and
Aneurysm Hemodynamics".
"""

from ffsi.paper.cases import CASES, Curve, PaperCase
from ffsi.paper.study import main
from ffsi.paper.sweeps import Outcome

__all__ = ["CASES", "Curve", "Outcome", "PaperCase", "main"]
