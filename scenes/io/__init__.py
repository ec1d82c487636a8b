# SPDX-License-Identifier: MIT
"""Files: scans, points, meshes, poses and images, each checked before it is believed."""
