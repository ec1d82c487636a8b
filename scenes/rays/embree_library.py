# SPDX-License-Identifier: MIT
"""The Embree library inside the embreex wheel, called through its C interface (rtcore.h of Embree 4)."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import embreex

_POINTER, _UNSIGNED, _SIZE = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
_FUNCTIONS = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [_POINTER]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_POINTER, ctypes.c_int]),
    "rtcGetDeviceError": (ctypes.c_int, [_POINTER]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcSetSceneFlags": (None, [_POINTER, ctypes.c_int]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, ctypes.c_int]),
    "rtcSetSharedGeometryBuffer": (
        None,
        [_POINTER, ctypes.c_int, _UNSIGNED, ctypes.c_int, _POINTER, _SIZE, _SIZE, _SIZE],
    ),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (_UNSIGNED, [_POINTER, _POINTER]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    **{
        f"rtc{verb}{width}": (None, [_POINTER] * 4)
        for verb in ("Intersect", "Occluded")
        for width in (4, 8, 16)
    },
}
_ERRORS = {
    1: "an unknown error",
    2: "an invalid argument",
    3: "an invalid operation",
    4: "out of memory",
    5: "this processor is not supported",
    6: "cancelled",
}


class EmbreeError(RuntimeError):
    """Embree reported an error; the message says which, and what it was asked to do."""


@cache
def load_library() -> ctypes.CDLL:
    """Return the shared library that embreex ships, its functions declared.

    Raises
    ------
    OSError
        It is not where embreex's wheels have it, does not load, or lacks a function.
    """
    package = Path(embreex.__file__).parent
    found = [
        *package.parent.glob("embreex.libs/libembree4*.so*"),
        *package.parent.glob("embreex.libs/embree4*.dll"),
        *package.glob(".dylibs/libembree4*.dylib"),
    ]
    if not found:
        raise OSError(f"no Embree 4 library beside {package}")
    library = ctypes.CDLL(str(found[0]))
    for name, (result, arguments) in _FUNCTIONS.items():
        try:
            function = getattr(library, name)
        except AttributeError as error:
            raise OSError(f"{found[0].name} has no {name}") from error
        function.restype, function.argtypes = result, arguments
    return library


def address(library: ctypes.CDLL, name: str) -> int:
    """Return where a function of the library lies in memory."""
    return ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0


def check_device(library: ctypes.CDLL, device: int | None, task: str) -> None:
    """Raise EmbreeError if a call of this thread has failed since the last check; `task` says at what."""
    code = library.rtcGetDeviceError(device)
    if code:
        raise EmbreeError(f"Embree, {task}: {_ERRORS.get(code, f'error {code}')}")
