"""Solve scenes, chains of points and sweeps; go on with what was stopped."""

from ffsi.run.one_scene import resume, solve

__all__ = ["resume", "solve"]
