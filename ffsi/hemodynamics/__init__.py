"""What blood does to its vessel: wall shear stress and its indices, effective stress, flow into an aneurysm."""
