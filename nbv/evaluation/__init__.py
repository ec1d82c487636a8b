# SPDX-License-Identifier: MIT
"""Evaluation of completion: generated scenes, naive baselines, and the command `python -m nbv.evaluation`."""
