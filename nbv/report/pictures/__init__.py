# SPDX-License-Identifier: MIT
"""Pictures of reports: cameras, drawing, and the one colour code."""
