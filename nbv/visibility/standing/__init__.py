# SPDX-License-Identifier: MIT
"""Where a tripod may stand: floors, storeys, rooms, and the candidates in them."""
