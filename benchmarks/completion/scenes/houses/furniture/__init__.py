# SPDX-License-Identifier: MIT
"""What stands in a flat: furniture, figures and plants as triangles, each part named."""
