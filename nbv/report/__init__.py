# SPDX-License-Identifier: MIT
"""Reports: one HTML file that works offline, pictures by our own ray caster; no times, no paths."""
