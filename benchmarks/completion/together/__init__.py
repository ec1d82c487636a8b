# SPDX-License-Identifier: MIT
"""Together: several scans completed at once against each of them alone, their poses right or wrong."""
