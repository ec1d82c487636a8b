# SPDX-License-Identifier: MIT
"""Things for back sides: kinds fitted on and kinds held out, views of them, what is true of them."""
