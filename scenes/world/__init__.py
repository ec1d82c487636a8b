# SPDX-License-Identifier: MIT
"""The true scene and the built-in ones; closed to completion and the online planner."""
