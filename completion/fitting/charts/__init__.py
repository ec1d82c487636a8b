# SPDX-License-Identifier: MIT
"""Charts of the space of surfaces: minimal parametrisations to linearise a fit in."""
