# SPDX-License-Identifier: MIT
"""Bad files: what every reader does with every class of bad input, generated, counted and documented."""
