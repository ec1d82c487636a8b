# SPDX-License-Identifier: MIT
"""Options of the commands, each declared once: name, help text, section, default and limits."""
