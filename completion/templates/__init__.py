# SPDX-License-Identifier: MIT
"""Templates: objects of several faces, fitted whole from what fragments show of them."""
