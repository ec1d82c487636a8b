# SPDX-License-Identifier: MIT
"""Completion: the surfaces behind occluders, inferred, bounded, textured, and marked as inferred.

Names are imported when they are first used; `__init__.pyi` says from where.
"""

from importlib import metadata

import lazy_loader

try:
    __version__ = metadata.version("unseen")
except metadata.PackageNotFoundError:  # run from the sources alone
    __version__ = "unknown"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
