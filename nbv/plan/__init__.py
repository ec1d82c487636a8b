# SPDX-License-Identifier: MIT
"""Plans of a known scene: by the online planner, by cover, by baselines; and their files."""
