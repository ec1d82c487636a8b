# SPDX-License-Identifier: MIT
"""Clouds: readers and writers of files of points and of scans."""
