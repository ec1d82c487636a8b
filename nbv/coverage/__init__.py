# SPDX-License-Identifier: MIT
"""Coverage: which surface views or scans measured as required, and why the rest is not."""
