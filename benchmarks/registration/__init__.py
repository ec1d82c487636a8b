# SPDX-License-Identifier: MIT
"""Registration from any start: how often it is right, and how often it claims what is not so."""
