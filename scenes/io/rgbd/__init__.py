# SPDX-License-Identifier: MIT
"""RGB-D: folders of depth images, as recorders lay them out."""
