"""Independent reference checker: numpy and scipy only, no code and no formula text shared with the FreeFEM scripts.

``check_run`` judges a run folder, ``check.check_state`` one state or step; ``solve`` computes small ones, steady or
step by step, from scratch.
"""

from ffsi.reference.check import CheckReport, check_run

__all__ = ["CheckReport", "check_run"]
