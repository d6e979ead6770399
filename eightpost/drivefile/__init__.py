"""Drive file iteration (Eq 2.7): commands with which the rig reproduces channels measured on the track."""

from eightpost.drivefile.folder import IterationFolder
from eightpost.drivefile.iteration import (
    ActuatorBands,
    Outcome,
    Pass,
    Problem,
    Settings,
    StartResponse,
    Status,
    advance,
    start_response,
)
from eightpost.drivefile.target import Limits, Target, read_channels, target_names

__all__ = [
    "ActuatorBands", "IterationFolder", "Limits", "Outcome", "Pass", "Problem", "Settings", "StartResponse",
    "Status", "Target", "advance", "read_channels", "start_response", "target_names",
]  # fmt: skip
