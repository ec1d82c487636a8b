# SPDX-License-Identifier: MIT
"""Relations: how often true ones are rejected, and what they bring where little was seen."""
