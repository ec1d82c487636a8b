# SPDX-License-Identifier: MIT
"""Relations as equations, the joint estimate they are imposed on, and the tests of them."""
