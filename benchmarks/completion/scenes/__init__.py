# SPDX-License-Identifier: MIT
"""Scenes of the evaluation: generated rooms, furniture, stations and sweeps."""
