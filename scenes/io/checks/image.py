# SPDX-License-Identifier: MIT
"""Images: opened by the formats that are known alone, their header looked at before a pixel is unpacked."""

from __future__ import annotations

import io
import logging
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageFile, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from scenes.checks import InputError
from scenes.io.checks.guard import check_file, check_size, guard_reading
from scenes.io.checks.limits import check_unpacked

FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP", "PPM", "GIF", "TGA")
_opening = threading.Lock()  # Pillow's own limit is a global of its module, and so are filters of warnings
_STRIPS = ((273, 279), (324, 325))  # of TIFF: tags of where strips, or tiles, begin, and of their bytes
logging.getLogger("PIL").addHandler(logging.NullHandler())  # what is wrong is told by our error alone


@contextmanager
def open_image(path: Path, what: str = "an image") -> Iterator[ImageFile.ImageFile]:
    """Open an image file; whatever goes wrong while it is open is an InputError that names it.

    Its first bytes say which of `FORMATS` it is; `what` it should be stands in the message. Raises
    InputError: as `check_file`; no image of a known format, or more pixels or bytes than the limits allow.
    """
    with guard_reading(path, what), check_file(path).open("rb") as stream, _header(stream) as image:
        _check(image, path.stat().st_size)
        if isinstance(image, TiffImageFile):
            _decode_tiff(image, path.stat().st_size)
        yield image


def check_image(data: Path | bytes) -> int:
    """Return the pixels of an image, a file or what one holds, of which only the header is looked at.

    Raises InputError: as `open_image`; of bytes without a name.
    """
    if isinstance(data, Path):
        with open_image(data) as image:
            return image.width * image.height
    with _header(io.BytesIO(data)) as image:
        _check(image, len(data))
        return image.width * image.height


def _header(stream: io.BufferedReader | io.BytesIO) -> ImageFile.ImageFile:
    """Open an image by its header, however many pixels it announces: that is for our own limit to say."""
    with _opening, warnings.catch_warnings():
        warnings.simplefilter("error")  # of tags that are damaged
        usual, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(stream, formats=FORMATS)
        except UnidentifiedImageError as error:
            raise InputError(f"is no image that is known ({', '.join(FORMATS)})") from error
        except Exception as error:
            raise InputError(f"is a damaged image: {error}") from error
        finally:
            Image.MAX_IMAGE_PIXELS = usual


def _decode_tiff(image: TiffImageFile, size: int) -> None:
    """Unpack a TIFF whose strips lie within the file; what Pillow only warns of is damage."""
    for tags in _STRIPS:
        starts, counts = (np.ravel(image.tag_v2.get(tag, ())).astype(np.float64) for tag in tags)
        if len(starts) != len(counts) or (starts + counts > size).any():
            raise InputError(f"truncated: its pixels end behind the {size} bytes that are present")
    with _opening, warnings.catch_warnings():
        warnings.simplefilter("error")
        # Pillow turns TIFF while it loads, and scrambles it when it is neither square nor compressed.
        if image.getexif().get(ExifTags.Base.Orientation, 1) > 4 and image.tile[0][0] == "raw":
            raise InputError("is an uncompressed TIFF lying on its side; save it upright, or compressed")
        image.load()


def _check(image: Image.Image, packed: int) -> None:
    check_size(image.height, image.width)
    wide = 4 if image.mode.startswith(("I", "F")) else 1
    check_unpacked(image.width * image.height * wide * len(image.getbands()), packed, "the image")
