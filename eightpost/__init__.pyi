from cosim import Bond as Bond
from cosim import Scenario as Scenario
from cosim import System as System
from eightpost.api.models import build as build
from eightpost.api.models import fit as fit
from eightpost.api.models import identify as identify
from eightpost.api.models import simulate as simulate
from eightpost.api.reading import examples as examples
from eightpost.api.reading import read as read
from eightpost.api.runs import compare as compare
from eightpost.api.runs import run as run
from eightpost.api.runs import study as study
from eightpost.api.runs import sweep as sweep
from eightpost.errors import EightpostError as EightpostError
from eightpost.signals import Drivefile as Drivefile
from eightpost.signals import TimeSeries as TimeSeries

__all__ = [
    "Bond",
    "Drivefile",
    "EightpostError",
    "Scenario",
    "System",
    "TimeSeries",
    "build",
    "compare",
    "examples",
    "fit",
    "identify",
    "read",
    "run",
    "simulate",
    "study",
    "sweep",
]

__version__: str
