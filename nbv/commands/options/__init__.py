# SPDX-License-Identifier: MIT
"""Options of the command line: their names, their help, and how text becomes values."""
