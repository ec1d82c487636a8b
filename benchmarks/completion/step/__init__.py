# SPDX-License-Identifier: MIT
"""Parts as STEP against their clouds: validity, solids, volumes, relations that were claimed."""
