# SPDX-License-Identifier: MIT
"""Registration: how well the poses of scans agree with what the scans measured."""
