# SPDX-License-Identifier: MIT
"""File formats, one module each; `scenes.files` dispatches to them by suffix."""
