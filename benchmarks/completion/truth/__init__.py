# SPDX-License-Identifier: MIT
"""Truth: which true surface was measured, hidden, or in nobody's view."""
