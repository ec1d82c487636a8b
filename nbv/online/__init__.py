# SPDX-License-Identifier: MIT
"""The online planner, which knows its scans alone; `planner` is the page to read."""
