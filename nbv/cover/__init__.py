# SPDX-License-Identifier: MIT
"""Cover: few candidates that together see enough of a known scene, and how few any plan must have."""
