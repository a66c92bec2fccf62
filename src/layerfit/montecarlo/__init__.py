"""An independent Monte Carlo of light in layered media, to judge the solvers by. It shares no formula with them.

Numba starts with the first simulation, not with this import.
"""

from .medium import Medium as Medium
from .phase import HenyeyGreenstein as HenyeyGreenstein
from .phase import TabulatedPhase as TabulatedPhase
from .result import Result as Result
from .run import simulate as simulate
from .source import Disk as Disk
from .source import Fibre as Fibre
from .source import Gaussian as Gaussian
from .source import Lambertian as Lambertian
from .source import Pencil as Pencil
from .statistics import Comparison as Comparison
from .statistics import Estimate as Estimate
from .statistics import compare as compare
from .store import load as load
from .tallies import CollectingFibre as CollectingFibre
from .tallies import Tallies as Tallies
