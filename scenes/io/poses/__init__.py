# SPDX-License-Identifier: MIT
"""Poses: trajectories, cameras and the models of COLMAP."""
