# SPDX-License-Identifier: MIT
"""Review: a page on which a person corrects a finished completion, and sees first what follows."""
