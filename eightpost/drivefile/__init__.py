"""Drive file iteration (Eq 2.7): commands with which the rig reproduces channels measured on the track."""

from eightpost.drivefile.folder import IterationFolder
from eightpost.drivefile.iteration import Outcome, Pass, Problem, Settings, Status, advance
from eightpost.drivefile.limits import Limits
from eightpost.drivefile.response import ActuatorBands, StartResponse, start_response
from eightpost.drivefile.target import Target, read_channels, target_names

__all__ = [
    "ActuatorBands",
    "IterationFolder",
    "Limits",
    "Outcome",
    "Pass",
    "Problem",
    "Settings",
    "StartResponse",
    "Status",
    "Target",
    "advance",
    "read_channels",
    "start_response",
    "target_names",
]
