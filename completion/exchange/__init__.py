# SPDX-License-Identifier: MIT
"""Exchange: drawings of a completed model that CAD programs open; what was inferred stays apart."""
