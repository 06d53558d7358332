"""The link to FreeFEM: find it, start it, stream its progress, turn its failures into Python errors."""

from ffsi.freefem.errors import FreeFEMError, FreeFEMNotFound
from ffsi.freefem.events import Event, parse_event
from ffsi.freefem.installation import Installation, find_freefem
from ffsi.freefem.process import Completed, run_script, stop_all

__all__ = [
    "Completed",
    "Event",
    "FreeFEMError",
    "FreeFEMNotFound",
    "Installation",
    "find_freefem",
    "parse_event",
    "run_script",
    "stop_all",
]
