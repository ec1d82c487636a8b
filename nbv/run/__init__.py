# SPDX-License-Identifier: MIT
"""What runs need: manifest, workers, tables, wording."""
