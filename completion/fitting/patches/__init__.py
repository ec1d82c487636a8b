# SPDX-License-Identifier: MIT
"""Free-form patches: B-splines through points, joined to planes and cylinders along their boundaries."""
