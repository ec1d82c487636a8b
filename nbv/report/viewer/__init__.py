# SPDX-License-Identifier: MIT
"""The report's 3-D view: what it shows, and how that is packed into the page."""
