# SPDX-License-Identifier: MIT
"""What each command of `unseen` does, a module a command; imported when the command runs."""
