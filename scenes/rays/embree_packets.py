# SPDX-License-Identifier: MIT
"""Embree in packets: 16 rays a call (8 or 4 where the processor is narrower), from a compiled loop.

Neighbouring rays that share a packet share most of their way through the tree, which makes them several times
as fast as one by one. After `rtcIntersect16` of the Embree 4 manual; robust mode is on, so that no ray slips
between two faces.
"""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from pathlib import Path

import embreex
import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.local_mesh import LocalMesh
from scenes.rays.packet_kernels import SPREAD, compile_for

_VERSION_MAJOR, _NATIVE_WIDTHS = 1, {16: 34, 8: 33}  # RTCDeviceProperty
_NO_CACHE = "tessellation_cache_size=0"  # for subdivision surfaces, which we have none of: 128 MB a device
_ROBUST, _COHERENT = 1 << 2, 1 << 16  # RTCSceneFlags, RTCRayQueryFlags
_TRIANGLES, _INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003  # types and formats
_PADDING = 2  # rows: Embree reads 16 bytes from the start of the last one
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


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments, and RTCOccludedArguments just the same."""

    _fields_ = (
        ("flags", ctypes.c_uint),
        ("feature_mask", ctypes.c_uint),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("callback", ctypes.c_void_p),
        ("min_width_distance_factor", ctypes.c_float),
    )


class PacketScene:
    """A mesh in Embree, for packets of rays; any thread may cast.

    The configuration is for the Embree device, as in its manual; "max_isa=avx2" plays a narrower processor.
    Raises OSError: the library does not load, or is not Embree 4; EmbreeError: it cannot build the scene.
    """

    name = "packets"

    def __init__(self, mesh: LocalMesh, configuration: str = "") -> None:
        library = load_library()
        device = library.rtcNewDevice(f"{_NO_CACHE},{configuration}".encode())
        check_device(library, device, "opening a device")
        scene = library.rtcNewScene(device)
        vertices, faces = _padded(mesh.vertices, np.float32), _padded(mesh.faces, np.int32)
        self._release = weakref.finalize(self, _release, library, device, scene, (vertices, faces))
        version = library.rtcGetDeviceProperty(device, _VERSION_MAJOR)
        if version != 4:
            raise OSError(f"the library is Embree {version}; packets are laid out for Embree 4")
        self._library, self._device, self._scene, self._centre = library, device, scene, mesh.centre
        widths = [w for w, key in _NATIVE_WIDTHS.items() if library.rtcGetDeviceProperty(device, key)]
        self.width = max(widths, default=4)
        self._kernels = compile_for(self.width)
        self._intersect = address(library, f"rtcIntersect{self.width}")
        self._occluded = address(library, f"rtcOccluded{self.width}")
        self._arguments = [_Arguments(flags, 0xFFFFFFFF) for flags in (0, _COHERENT)]
        self._apart = _apart(mesh)
        library.rtcSetSceneFlags(scene, _ROBUST)
        if len(mesh.faces):
            _attach(library, device, scene, vertices, faces)
        library.rtcCommitScene(scene)
        check_device(library, device, f"building a scene of {len(mesh.faces)} faces")

    def first_faces(
        self,
        origins: FloatArray,
        directions: FloatArray,
        columns: int,
        coherent: bool | None,
        face: NDArray[np.int32],
    ) -> int:
        """Write the first face (n,) that each ray hits, -1 for none; return how many rays were usable.

        Parameters
        ----------
        origins, directions : (n, 3) or (1, 3), (n, 3) float
            World coordinates, metres; directions of any length.
        columns : int
            Of the image that the rays form; 0 when they form none.
        coherent : bool, optional
            Whether the rays of a packet go nearly the same way; each packet is looked at when not given.
        face : (n,) int32
            Written.
        """
        n_usable = self._kernels.first_faces(
            self._intersect,
            self._scene,
            *self._how(coherent),
            self._centre,
            origins,
            directions,
            columns,
            face,
        )
        check_device(self._library, self._device, "casting rays")
        return n_usable

    def _how(self, coherent: bool | None) -> tuple[int, int, float]:
        """Addresses of the arguments for other and for coherent packets, and how far apart origins may be."""
        plain, together = (ctypes.addressof(one) for one in self._arguments)
        if coherent is not None:
            plain = together = together if coherent else plain
        return plain, together, self._apart

    def any_hits(
        self, origins: FloatArray, targets: FloatArray, coherent: bool | None, blocked: BoolArray
    ) -> None:
        """Write to `blocked` (n,) whether a face lies between origins and targets, (n, 3) or (1, 3) each."""
        self._kernels.any_hits(
            self._occluded, self._scene, *self._how(coherent), self._centre, origins, targets, blocked
        )
        check_device(self._library, self._device, "casting rays")


def _apart(mesh: LocalMesh) -> float:
    """How far apart the origins of coherent rays may be, metres, squared."""
    return float((SPREAD * np.linalg.norm(mesh.vertices.max(axis=0, initial=0.0))) ** 2)


def _padded(rows: NDArray[np.generic], kind: type[np.generic]) -> NDArray[np.generic]:
    padded = np.zeros((len(rows) + _PADDING, 3), kind)
    padded[: len(rows)] = rows
    return padded


def _attach(
    library: ctypes.CDLL, device: int, scene: int, vertices: NDArray[np.generic], faces: NDArray[np.generic]
) -> None:
    geometry = library.rtcNewGeometry(device, _TRIANGLES)
    for array, kind, layout in ((vertices, _VERTEX, _FLOAT3), (faces, _INDEX, _UINT3)):
        library.rtcSetSharedGeometryBuffer(
            geometry, kind, 0, layout, array.ctypes.data, 0, 12, len(array) - _PADDING
        )
    library.rtcCommitGeometry(geometry)
    library.rtcAttachGeometry(scene, geometry)
    library.rtcReleaseGeometry(geometry)


def _release(library: ctypes.CDLL, device: int, scene: int, _buffers: object) -> None:
    """Give Embree's memory back; `_buffers` has lived as long as the scene that shares it."""
    library.rtcReleaseScene(scene)
    library.rtcReleaseDevice(device)


class EmbreeError(RuntimeError):
    """Embree reported an error; the message says which, and what it was asked to do."""


@cache
def load_library() -> ctypes.CDLL:
    """Return the shared library that embreex ships, its functions declared.

    Raises OSError: it is not where embreex's wheels have it, does not load, or lacks a function.
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
