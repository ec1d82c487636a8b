# SPDX-License-Identifier: MIT
"""RGB-D folders: colour and depth images with a trajectory."""
