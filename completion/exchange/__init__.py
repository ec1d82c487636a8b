# SPDX-License-Identifier: MIT
"""Exchange: what goes out to CAD, to BIM and to people who build; what was inferred stays apart."""
