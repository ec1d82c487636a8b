# SPDX-License-Identifier: MIT
from .cues import Cue as Cue
from .evidence import EvidenceOptions as EvidenceOptions
from .evidence import Label as Label
from .extension import Patch as Patch
from .fitting import FitError as FitError
from .fitting import SurfaceFit as SurfaceFit
from .fitting import fit as fit
from .fitting import fit_cylinder as fit_cylinder
from .fitting import fit_plane as fit_plane
from .fitting import inflated as inflated
from .fitting import select as select
from .pipeline import Completion as Completion
from .pipeline import CompletionOptions as CompletionOptions
from .pipeline import complete as complete
from .provenance import Provenance as Provenance
from .segmentation.regions import SegmentationOptions as SegmentationOptions
from .texturing import TexturingOptions as TexturingOptions
