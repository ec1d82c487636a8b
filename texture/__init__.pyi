# SPDX-License-Identifier: MIT
from .analysis.lattice import Lattice as Lattice
from .analysis.lattice import find_lattice as find_lattice
from .analysis.lattice import measure_phase_error as measure_phase_error
from .analysis.quality import measure_distance as measure_distance
from .analysis.quality import measure_seam as measure_seam
from .analysis.quality import measure_verbatim_share as measure_verbatim_share
from .examination import Examination as Examination
from .examination import examine as examine
from .pipeline import fill as fill
from .pipeline import grow as grow
from .result import Synthesis as Synthesis
from .surface.surface_fill import SurfaceFill as SurfaceFill
from .surface.surface_fill import fill_surface as fill_surface
