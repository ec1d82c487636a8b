# SPDX-License-Identifier: MIT
"""Limits of the check against a design, each with unit and origin.

Lengths are metres of a building, and shrink with the size of a smaller design (`scale_of`). "Page" stands for
values tuned on six simulated states of a house, beside which others were held out.
"""

from __future__ import annotations

FULL_SIZE_M = 5.0
"""Diagonal of a design from which on lengths are those of a building: a room. By choice."""

# Faces
COPLANAR_DEG = 1.0
"""Between the normals of triangles of one plane, degrees. Page."""
COPLANAR_M = 2e-3
"""From a plane to the corners of its triangles. Page."""
LEAST_FACE_M2 = 0.05
"""Of a face that is tested. Page."""
LEAST_WIDTH_M = 0.04
"""Of a face that is tested. Page."""
FACET_DEG = 50.0
"""Between neighbouring facets of a round surface: one of eight facets has 45 degrees. By choice."""
FEWEST_FACETS = 5
"""Of a cylinder. By choice."""
ROUND = 0.01
"""From a circle to the corners of its facets, of the radius: they lie on it but for rounding. By choice."""
MAIN_SHARE = 0.25
"""Of the largest exposed face of an element, from which on a face is main. By choice."""
SEE_THROUGH = 0.9
"""Opacity below which material is not tested: glass. By choice."""

# Fit of scans
FITS_M = 0.1
"""From the design's first surface on a ray, across it, for a beam to end on it: twice FREE_M. By choice."""
FITS_SHARE, FITS_REACHED = 0.01, 0.2
"""Least share of beams towards the design that end on it; of those not stopped before it. By choice."""
FITS_UNLIKE = 0.5
"""The latter, below which it is told of. By choice."""
FITS_BEYOND, FITS_MOVED = 0.03, 0.9
"""Least share of beams behind the design, and after a shift on it, of a scan elsewhere. By choice: what
stands before walls stops beams, and lets none pass.
"""
FITS_UNIT = 0.25
"""How much larger the share of beams on the design must be in another unit. By choice."""
FITS_UP = 0.5
"""The share of beams on the design below which other axes of its file are tried as its up. By choice."""
FITS_SHIFT = 1.5
"""Of FITS_M, across a surface, from which on a beam notices a shift. By choice: what NEAR_M forgives."""
FITS_NOTICED = 0.3, 0.6
"""Most share of such beams on the design before a shift, least after it, of a scan elsewhere. By choice."""

# Crossings
BEHIND_M = 0.45
"""Behind what was measured, within which surfaces of the design are looked for. Page."""
MOST_CROSSINGS = 5
"""Of a beam. Page."""
STEP_M = 2e-4
"""From a crossing to where the next is looked for. By choice."""

# Association
LEAST_COSINE = 0.17
"""Of incidence, 80 degrees. Page."""
NEAR_M = 0.15
"""From a face, within which a beam may belong to it. Page."""
FAR_M = 0.5
"""Within which a displaced element is looked for. Page."""
NEARER = 0.5
"""Of the distance from the first face, within which a face behind it takes a beam: layers. By choice."""
AT_ONCE_M = 0.01
"""From its first face, within which nothing nearer is looked for. By choice: less than NEAR_M."""
GATE_SIGMAS = 5.0
"""Of range noise and registration together, beside GATE_M, within which a beam ends on an element. Page."""
GATE_M = 0.01
"""See GATE_SIGMAS. Page."""
MOST_SIGMA_M = 0.03
"""Of a beam that tells anything. Page, of depth cameras."""
MOST_A_PAIR = 500
"""Beams of a face in a scan that are kept, evenly. By choice: more tell nothing that form errors leave."""
SUBSET = 800_000
"""Beams that align the scans before all are looked at. By choice."""

# Support
WINDOW_SIGMAS = 2.5
"""Of noise, beside 3 standard deviations of the residuals, of the gate about a face's plane. Page."""
CORE_SIGMAS = 1.5
"""Of the gate within which beams tell where a surface is: half as wide as that for being on it. By choice."""
START_M = 0.025
"""Of the first gate about the commonest deviation: what tilts and bows reach. By choice."""
LEVEL_SD = 3.0
"""Standard deviations of registration, within which a station has its own level. Page."""
LEAST_SUPPORT = 0.3
"""Share of what beams could have met, for a test. Page."""
SURE_SUPPORT = 0.5
"""The same for `deviates`. Page."""
FEWEST_BEAMS = 50
"""For a test. Page."""
LEAST_MEASURED_M2 = 0.05
"""For a test. Page."""
MOST_RMS = 3.0
"""Times the median of all faces, for `deviates`. Page."""
LEAST_PART = 0.3
"""Of the measured area of an element, for `deviates` by one of its faces. Page."""
LEAST_EXPOSED = 0.1
"""Share of a face that nothing of the design covers, for a test. By choice."""

# Alignment
PAIR_BEAMS = 250
"""Of a face in a scan that enter the alignment. Page."""
FORM_M, BIAS_SHARE = 3e-4, 0.2
"""Error of form of each face as a scan sees it, and of the noise of single beams, by what stands before it:
no pair of face and scan tells more. By depth frames and scans of a furnished house, seeds for tuning; with
2 mm noise both are the page's 0.5 mm.
"""
FREE_M, FREE_RAD = 0.05, 0.01
"""Standard deviation of the motion of all scans together. Page."""
FREEDOM = 3.0
"""Degrees of freedom of the deviations' distribution. Page."""
LEAST_TAU_M, MOST_TAU_M = 5e-4, 0.01
"""Bounds of their scale. Page."""
ROUNDS = 12
"""Of expectation and maximisation. Page."""
AGAIN_M = 0.01
"""Motion of a scan after which the subset is aligned once more. By choice."""
UNLIKE = 0.5, 0.75
"""Share of a scan's beams near faces that lie on what all scans show, beside that of the usual one, to be
left out below it, and to be told of. By choice: a scan turned by 1 deg in a room has 0.3, one 5 cm off 0.6.
"""
MOVED_SIGMAS = 5.0
"""Stated errors of poses, beyond which the motion of one scan is told. By choice."""

# Decision
CORNERS = 0.05
"""Quantiles of what was measured, along both axes of a face, at whose corners it is judged. Page."""
WITHIN_SHARE = 0.7
"""Of the measured area of an element that must be within. Page."""
RIVAL_M = 0.01
"""Of an offset from which on rivals are asked. Page."""
RING_M = 0.1
"""Around the outline of a face. Page."""
RING_SHARE = 0.3
"""Of beams in the ring at the same offset, from which on something else is before a face. Page."""
BEFORE_SHARE = 0.3
"""Of a face's exposed area, below which what lies before it may be a thing that stands there. By choice."""
BODY_SHARE = 0.7
"""Of the thickness of a body by which the surface behind it lies back. Page."""
BACK_TAUS = 3.0
"""Scales of the faces' deviations, by which that surface may be before the back. By choice."""

# Missing
LEAST_THROUGH_M2 = 0.02
"""Of a body that beams passed. Page."""
THROUGH_OF_SEEN = 0.5
"""Of through and on. Page."""
THROUGH_OF_ALL = 0.1
"""Of through, on and hidden. Page."""
BEYOND_M = 0.03
"""Behind a body, beside the gate, for a beam to have passed it. Page."""
BEFORE_M = 0.02
"""Before a body, beside the gate, for a beam to be stopped before it. Page."""

LIKE_EXTENT, LIKE_AREA = 0.8, 0.5
"""Of both extents and of the area of a face that a displaced one must have. By choice."""
HIDDEN_SHARE = 0.5
"""Of an element's exposed area, below which it may be hidden although some of it is measured. By choice."""
MOST_THROUGH = 0.2
"""Of through and measured, beyond which an element is not within. By choice."""

# Shares
SAMPLE_M = 0.1
"""Between samples. Page."""
MOST_SAMPLES = 2_000_000
"""Of a design; those of a larger one are farther apart. By choice: half a gigabyte."""
COVERED_M = 0.01
"""Before a face, within which other surface of the design covers it. By choice."""

# Extra
CELL_M = 0.05
"""Of cells of extra surface. Page."""
LEAST_EXTRA_M2 = 0.05
"""Of a thing. Page."""
