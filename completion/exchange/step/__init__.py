# SPDX-License-Identifier: MIT
"""STEP: fitted surfaces trimmed where they meet, as a solid where they close."""
