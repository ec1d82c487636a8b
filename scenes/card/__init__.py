# SPDX-License-Identifier: MIT
"""Cards: values as notebooks show them."""
