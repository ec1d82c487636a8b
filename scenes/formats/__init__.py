# SPDX-License-Identifier: MIT
"""File formats, one module each; `scenes.files.scan_files` dispatches to them by suffix."""
