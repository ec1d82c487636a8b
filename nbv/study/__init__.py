# SPDX-License-Identifier: MIT
"""Studies: scenes x sensors x requirements x planners x seeds, resumable; `pipeline` is the page to read."""
