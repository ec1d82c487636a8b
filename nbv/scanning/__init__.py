# SPDX-License-Identifier: MIT
"""The simulated scanner: sensors, what their beams meet, and how they err; `scanner` is the page to read."""
