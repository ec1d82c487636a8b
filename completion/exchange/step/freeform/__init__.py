# SPDX-License-Identifier: MIT
"""Free-form faces: patches as STEP."""
