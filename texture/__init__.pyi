# SPDX-License-Identifier: MIT
from .lattice import Lattice as Lattice
from .lattice import find_lattice as find_lattice
from .lattice import measure_phase_error as measure_phase_error
from .pipeline import fill as fill
from .pipeline import grow as grow
from .quality import measure_distance as measure_distance
from .quality import measure_seam as measure_seam
from .quality import measure_verbatim_share as measure_verbatim_share
from .result import Examination as Examination
from .result import Synthesis as Synthesis
from .result import examine as examine
from .surface_fill import SurfaceFill as SurfaceFill
from .surface_fill import fill_surface as fill_surface
