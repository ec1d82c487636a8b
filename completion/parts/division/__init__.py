# SPDX-License-Identifier: MIT
"""Unorganised points divided into faces: looked around, surfaces grown, points labelled, faces fitted."""
