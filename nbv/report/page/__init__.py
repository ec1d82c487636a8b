# SPDX-License-Identifier: MIT
"""The page: the parts a report is made of, rendered as one HTML file that works offline."""
