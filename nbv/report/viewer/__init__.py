# SPDX-License-Identifier: MIT
"""The report's 3-D view: what it shows, how that is packed into the page, and the scripts that draw it."""
