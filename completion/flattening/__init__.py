# SPDX-License-Identifier: MIT
"""Flattening: the ripple of a sensor goes from planes, their relief stays."""
