# SPDX-License-Identifier: MIT
"""Evidence: what the scans say of each cell of a surface's chart; a beam that went through is a veto."""
