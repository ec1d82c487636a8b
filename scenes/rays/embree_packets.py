# SPDX-License-Identifier: MIT
"""Embree in packets: 16 rays a call (8 or 4 where the processor is narrower), from a compiled loop.

Neighbouring rays that share a packet share most of their way through the tree, which makes them several times
as fast as one by one. After `rtcIntersect16` of the Embree 4 manual; robust mode is on, so that no ray slips
between two faces. Imported only when a ray caster is built, because numba takes a while to load. The loops
hold no lock while they run and write into the arrays they are given; `scenes.rays.embree_single.usable_rays`
states in numpy which rays reach Embree.

A packet of Embree 4.4 (rtcore_ray.h) is a table of 32-bit numbers with a column for each ray ("lane"). Its
rows: origin x y z, tnear, direction x y z, time, tfar, mask, id, flags (RTCRay), normal x y z, u, v, primID,
geomID, instID, instPrimID (RTCHit).
"""

from __future__ import annotations

import ctypes
import math
import weakref
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import embreex
import numpy as np
from llvmlite import ir
from numba import boolean, float64, int32, int64, njit, types, uint64, void
from numba.extending import intrinsic
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.local_mesh import LocalMesh
from scenes.rays.ray_kernels import COMPILED, INLINED

_N_ROWS, _TFAR, _MASK, _PRIMITIVE, _GEOMETRY = 24, 8, 9, 17, 18  # 21 rows are Embree's, the rest to spare
_VECTORS = types.Array(float64, 2, "C", readonly=True)
_CENTRE = types.Array(float64, 1, "C", readonly=True)
SPREAD = 0.05
"""Radians, and a share of the mesh's radius: wider packets are slower when they are walked through the tree
together. Measured: they begin to be at 0.04 to 0.2 on meshes of a million to 15,000 faces."""
_LEAST_COSINE = np.float32(math.cos(SPREAD))
_LARGEST = float(np.finfo(np.float32).max)  # what exceeds it is not finite in Embree


class PacketKernels(NamedTuple):
    """The compiled loops for packets of one width; see `compile_for`."""

    first_faces: Callable[..., int]
    any_hits: Callable[..., None]


@intrinsic
def _call(_typing: Any, function: Any, valid: Any, scene: Any, rays: Any, arguments: Any) -> Any:
    """Call the C function at an address with four pointers; no address is compiled in, so code is cached."""
    signature = types.void(function, valid, scene, rays, arguments)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in values[1:]])
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return context.get_dummy_value()

    return signature, generate


@njit(**INLINED)
def _align_zeros(n: int) -> NDArray[np.float32]:
    """Return n zeros of 32 bits at an address that Embree can load packets from."""
    room = np.zeros(n + 16, np.float32)
    skip = (-room.ctypes.data // 4) % 16
    return room[skip : skip + n]


@njit(**INLINED)
def _n_packets(n: int, width: int, columns: int) -> int:
    if columns == 0:
        return (n + width - 1) // width
    high = width // 4
    return (columns + 3) // 4 * ((n // columns + high - 1) // high)


@njit(**INLINED)
def _rays_of(packet: int, columns: int, n: int, first: NDArray[np.int64], count: NDArray[np.int64]) -> None:
    """Write which of n rays a packet casts: in each four lanes `count` consecutive ones from `first` on.

    Of an image a packet is a tile, four pixels wide.
    """
    high = len(first)
    if columns == 0:
        for four in range(high):
            first[four] = (packet * high + four) * 4
            count[four] = max(min(n - first[four], 4), 0)
    else:
        across = (columns + 3) // 4
        band = packet // across
        column = (packet - band * across) * 4
        for four in range(high):
            first[four] = (band * high + four) * columns + column
            count[four] = min(columns - column, 4) if first[four] < n else 0


@njit(**INLINED)
def _repeat(lanes: FloatArray, vector: FloatArray) -> None:
    """Give all lanes one vector (1, 3)."""
    for k in range(len(lanes)):
        lanes[k] = vector[0, k % 3]


@njit(**INLINED)
def _load(lanes: FloatArray, vectors: FloatArray, first: NDArray[np.int64], count: NDArray[np.int64]) -> None:
    """Copy the vectors of a packet's rays to `lanes` (3 * width,); NaN where a lane has no ray."""
    numbers = vectors.reshape(-1)
    for four in range(len(first)):
        start, end = first[four] * 3, count[four] * 3
        if end == 12:
            for k in range(12):
                lanes[four * 12 + k] = numbers[uint64(start + k)]
        else:
            for k in range(12):
                lanes[four * 12 + k] = numbers[start + k] if k < end else np.nan


@njit(**INLINED)
def _fill(
    packet: NDArray[np.float32],
    valid: NDArray[np.int32],
    centre: FloatArray,
    starts: FloatArray,
    ways: FloatArray,
    is_segment: bool,
) -> int:
    """Write a packet's rays and mask; return how many are usable. Lanes without a ray hold NaN.

    A segment ends at tfar; where it needs no ray, tfar already is the answer: -1 blocked, 0 free.
    """
    words, width = packet.view(np.int32), len(valid)
    c_x, c_y, c_z = centre[0], centre[1], centre[2]
    n_valid = 0
    for index in range(width):
        lane, k = uint64(index), uint64(3 * index)
        x, y, z = starts[k] - c_x, starts[k + uint64(1)] - c_y, starts[k + uint64(2)] - c_z
        a, b, c = ways[k], ways[k + uint64(1)], ways[k + uint64(2)]
        length = math.sqrt(a * a + b * b + c * c)
        finite = (abs(x) <= _LARGEST) & (abs(y) <= _LARGEST) & (abs(z) <= _LARGEST)
        finite &= (abs(a) <= _LARGEST) & (abs(b) <= _LARGEST) & (abs(c) <= _LARGEST)
        usable = finite & (length > 0)
        inverse = 1 / length
        packet[lane] = x
        packet[width + lane] = y
        packet[2 * width + lane] = z
        packet[4 * width + lane] = a * inverse
        packet[5 * width + lane] = b * inverse
        packet[6 * width + lane] = c * inverse
        reach = length if is_segment else np.inf
        packet[_TFAR * width + lane] = reach if finite else -1.0
        words[_PRIMITIVE * width + lane] = -1
        words[_GEOMETRY * width + lane] = -1
        valid[lane] = -1 if usable else 0
        n_valid += 1 if usable else 0
    return n_valid


@njit(error_model="numpy", inline="always")
def _is_coherent(packet: NDArray[np.float32], width: int, apart: float) -> bool:
    """Tell whether a packet's rays go nearly the same way from nearly the same place.

    Nearly: within `SPREAD` of the first one's direction, and within `apart` metres, squared, of its origin.
    Lanes that hold NaN do not count.
    """
    x, y, z = packet[0], packet[width], packet[2 * width]
    a, b, c = packet[4 * width], packet[5 * width], packet[6 * width]
    nearest, furthest = np.float32(1), np.float32(0)
    for index in range(width):
        k = uint64(index)
        along = packet[4 * width + k] * a + packet[5 * width + k] * b + packet[6 * width + k] * c
        d, e, f = packet[k] - x, packet[width + k] - y, packet[2 * width + k] - z
        away = d * d + e * e + f * f
        nearest = along if along < nearest else nearest
        furthest = away if away > furthest else furthest
    return bool((nearest >= _LEAST_COSINE) & (furthest <= apart))


@cache
def compile_for(width: int) -> PacketKernels:
    """Return the loops for packets of 4, 8 or 16 rays; knowing the width, the compiler makes them faster."""

    @njit(
        int64(int64, int64, int64, int64, float64, _CENTRE, _VECTORS, _VECTORS, int64, int32[::1]), **COMPILED
    )
    def first_faces(
        intersect: int,
        scene: int,
        arguments: int,
        together: int,
        apart: float,
        centre: FloatArray,
        origins: FloatArray,
        directions: FloatArray,
        columns: int,
        face: NDArray[np.int32],
    ) -> int:
        """Write the first face (n,) that each ray hits, -1 for none; return how many rays were usable.

        `intersect` is the address of rtcIntersect4, 8 or 16; scene, arguments and `together`, the arguments
        of coherent packets, are addresses too. `apart` is for `_is_coherent`. Centre (3,), origins (n, 3) or
        (1, 3) and directions (n, 3) are in world coordinates, metres. `columns` are of the image whose pixels
        the rays are, row by row; 0 when they are a list.
        """
        packet, valid = _align_zeros(_N_ROWS * width), _align_zeros(width).view(np.int32)
        starts, ways = np.empty(3 * width), np.empty(3 * width)
        first, count = np.zeros(width // 4, np.int64), np.zeros(width // 4, np.int64)
        words = packet.view(np.int32)
        words[_MASK * width : (_MASK + 1) * width] = -1
        n, n_usable = len(directions), 0
        shared = len(origins) == 1
        if shared:
            _repeat(starts, origins)
        for p in range(_n_packets(n, width, columns)):
            _rays_of(p, columns, n, first, count)
            if not shared:
                _load(starts, origins, first, count)
            _load(ways, directions, first, count)
            n_valid = _fill(packet, valid, centre, starts, ways, False)
            if n_valid > 0:
                how = together if _is_coherent(packet, width, apart) else arguments
                _call(intersect, valid.ctypes.data, scene, packet.ctypes.data, how)
                n_usable += n_valid
            for four in range(width // 4):
                for k in range(count[four]):
                    face[uint64(first[four] + k)] = words[_PRIMITIVE * width + 4 * four + k]
        return n_usable

    @njit(void(int64, int64, int64, int64, float64, _CENTRE, _VECTORS, _VECTORS, boolean[::1]), **COMPILED)
    def any_hits(
        occluded: int,
        scene: int,
        arguments: int,
        together: int,
        apart: float,
        centre: FloatArray,
        origins: FloatArray,
        targets: FloatArray,
        blocked: BoolArray,
    ) -> None:
        """Write whether something lies between origin and target; True for what is not finite.

        `occluded` is the address of rtcOccluded4, 8 or 16; the others are as for `first_faces`, and targets
        may be a single one too.
        """
        packet, valid = _align_zeros(_N_ROWS * width), _align_zeros(width).view(np.int32)
        packet.view(np.int32)[_MASK * width : (_MASK + 1) * width] = -1
        starts, ends = np.empty(3 * width), np.empty(3 * width)
        first, count = np.zeros(width // 4, np.int64), np.zeros(width // 4, np.int64)
        ways = np.empty(3 * width)
        n = len(blocked)
        if len(origins) == 1:
            _repeat(starts, origins)
        if len(targets) == 1:
            _repeat(ends, targets)
        for p in range(_n_packets(n, width, 0)):
            _rays_of(p, 0, n, first, count)
            if len(origins) > 1:
                _load(starts, origins, first, count)
            if len(targets) > 1:
                _load(ends, targets, first, count)
            for k in range(3 * width):
                ways[k] = ends[k] - starts[k]
            if _fill(packet, valid, centre, starts, ways, True) > 0:
                how = together if _is_coherent(packet, width, apart) else arguments
                _call(occluded, valid.ctypes.data, scene, packet.ctypes.data, how)
            for lane in range(min(width, n - p * width)):
                blocked[p * width + lane] = packet[_TFAR * width + lane] < 0

    return PacketKernels(first_faces, any_hits)


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
        vertices, faces = _pad(mesh.vertices, np.float32), _pad(mesh.faces, np.int32)
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
        plain, together = (ctypes.addressof(argument) for argument in self._arguments)
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


def _pad(rows: NDArray[np.generic], kind: type[np.generic]) -> NDArray[np.generic]:
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
    paths = [
        *package.parent.glob("embreex.libs/libembree4*.so*"),
        *package.parent.glob("embreex.libs/embree4*.dll"),
        *package.glob(".dylibs/libembree4*.dylib"),
    ]
    if not paths:
        raise OSError(f"no Embree 4 library beside {package}")
    library = ctypes.CDLL(str(paths[0]))
    for name, (result, arguments) in _FUNCTIONS.items():
        try:
            function = getattr(library, name)
        except AttributeError as error:
            raise OSError(f"{paths[0].name} has no {name}") from error
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
