"""Solve scenes, chains of points and sweeps; go on with what was stopped."""
