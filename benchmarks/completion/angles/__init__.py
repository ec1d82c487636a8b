# SPDX-License-Identifier: MIT
"""Angles of surfaces that are known to be square or parallel, by what was stated of them."""
