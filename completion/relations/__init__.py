# SPDX-License-Identifier: MIT
"""Relations between surfaces: inferred, tested, imposed."""
