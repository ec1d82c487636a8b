# SPDX-License-Identifier: MIT
"""Check of scans against a design: elements within their tolerance, deviating, missing or hidden."""
