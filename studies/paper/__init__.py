"""The study of the paper's section 5: the flap in a channel (figures 3 to 14), and the aneurysm (figures 15 to 18).

The paper: "Finite Element Method for Strongly Coupled Fluid-Structure Interaction of a Vertical Flap in a Channel and
Aneurysm Hemodynamics".
"""
