# SPDX-License-Identifier: MIT
"""`unseen texture`: fill a hole in an image or grow a texture, and say where each pixel came from."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from nbv.commands.options.scans import TextureOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import start_run
from scenes.checks import InputError
from scenes.io.checks.image import open_image
from scenes.run.atomic import write_bytes
from scenes.run.memory import require
from texture.engine.compiled_front import list_visits
from texture.pipeline import fill, grow
from texture.result import Examination, Synthesis, examine
from texture.surface_fill import fill_surface


class _Need(NamedTuple):
    """Bytes that a texture takes: for a pixel among the first, for any, for each of its channels."""

    first: int
    pixel: int
    channel: int

    def of(self, n_pixels: int, n_channels: int) -> int:
        """Return the bytes that so many pixels take."""
        first = self.first * min(n_pixels, _FIRST_PIXELS)
        return first + n_pixels * (self.pixel + self.channel * n_channels)


_FIRST_PIXELS = 1_000_000
_FILLED, _SURFACE = _Need(150, 44, 27), _Need(150, 50, 24)  # as measured
_SAMPLED, _GROWN = _Need(70, 28, 21), _Need(0, 50, 9)
_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".webp": "WEBP", ".tif": "TIFF", ".tiff": "TIFF"}


def run_texture(shared: Shared, asked: TextureOptions) -> None:
    """Fill the masked pixels of an image, on request shading apart, or grow a texture."""
    image, mask, shape, is_surface = asked.image, asked.mask, asked.grow, asked.surface
    with start_run("texture", shared, default="texture.png", is_folder=False) as run:
        _format_of(run.out)
        run.read([image] if mask is None else [image, mask])
        pixels = read_image(image)
        hole = None if mask is None else read_mask(mask)

        what = f"a texture from {pixels.shape[0]} x {pixels.shape[1]} pixels"
        needed = texture_bytes(pixels.shape, shape, is_surface=is_surface)
        require(needed, what, "use smaller images, or give more memory")

        def tell(done: int, total: int) -> None:
            run.progress("texture", done, total)

        how: dict[str, Any] = {
            "window": asked.window,
            "order": asked.order,
            "rng": shared.seed,
            "n_threads": shared.threads,
            "progress": tell,
        }
        run.will_call(list_visits, 20)
        try:
            if hole is None:
                made = grow(pixels, shape or (1, 1), **how)
                result = made.image
            elif is_surface:
                lit = fill_surface(pixels, hole, **how)
                made, result = lit.synthesis, lit.image
            else:
                made = fill(pixels, hole, **how)
                result = made.image
        except ValueError as error:  # the texture package's checks of its arguments
            raise InputError(f"{image}: {error}") from error
        write_image(run.path(), result)
        _write_provenance(run.path(f"{run.out.name}.provenance.npz"), made)
        options = {
            "mask": None if mask is None else Path(mask).name,
            "grow": shape,
            "window": asked.window,
            "order": asked.order,
            "surface": is_surface,
        }
        examination = None if hole is None else examine(made, hole)
        summary: dict[str, Any] = {
            "rows": made.image.shape[0],
            "columns": made.image.shape[1],
            "filled": made.error.size if hole is None else int(np.count_nonzero(hole)),
            "window": made.window,
            "seeds": made.n_seeds,
            "relaxed": made.n_relaxed,
            "window_distances": {str(side): value for side, value in made.window_distances.items()},
            "alarms": [] if examination is None else list(examination.alarms),
            "quality": None if examination is None else _list_quality(examination),
        }
        line = f"{summary['filled']} pixels, window {made.window}"
        if summary["alarms"]:
            line += f"; look at it: {', '.join(summary['alarms'])}"
        run.finish(options, summary, [line])


def texture_bytes(shape: tuple[int, ...], grown: tuple[int, int] | None, *, is_surface: bool = False) -> int:
    """Return about how much memory it takes to fill an image of a shape, or to sample it and grow another.

    The shape is (rows, columns) or (rows, columns, channels), `grown` (rows, columns) of what is grown.
    """
    channels = shape[2] if len(shape) == 3 else 1
    if grown is not None:
        return _SAMPLED.of(shape[0] * shape[1], channels) + _GROWN.of(grown[0] * grown[1], channels)
    return (_SURFACE if is_surface else _FILLED).of(shape[0] * shape[1], channels)


def _list_quality(examination: Examination) -> dict[str, float | None]:
    """Return the numbers of an examination; None where one cannot be measured."""
    numbers = {name: value for name, value in asdict(examination).items() if isinstance(value, float)}
    return {name: None if isnan(value) else round(value, 4) for name, value in numbers.items()}


def read_image(path: str) -> NDArray[np.uint8]:
    """Return an image as (h, w) or (h, w, c) uint8: grey or RGB, with alpha or not, turned upright by EXIF.

    Raises
    ------
    InputError
        Missing, damaged, of unreasonable size, or of more than 8 bits.
    """
    with _open_image(path) as opened:
        if opened.mode.startswith(("I", "F")):
            raise InputError(f"has pixels of mode {opened.mode}; convert it to 8 bits first")
        if opened.mode == "1":
            opened = opened.convert("L")
        elif opened.mode not in ("L", "LA", "RGB", "RGBA"):
            opened = opened.convert("RGBA" if opened.has_transparency_data else "RGB")
        return np.array(opened, dtype=np.uint8)


def read_mask(path: str) -> NDArray[np.bool_]:
    """Return where an image (h, w) is not zero in any of its colours; alpha does not count."""
    with _open_image(path) as opened:
        if opened.mode not in ("1", "L", "LA", "RGB", "RGBA") and not opened.mode.startswith(("I", "F")):
            opened = opened.convert("RGBA" if opened.has_transparency_data else "RGB")
        values = np.array(opened)
    if values.ndim == 2:
        return np.asarray(values != 0, dtype=np.bool_)
    n_colours = 3 if values.shape[2] > 2 else 1
    return np.asarray((values[..., :n_colours] != 0).any(axis=2), dtype=np.bool_)


@contextmanager
def _open_image(path: str) -> Iterator[Image.Image]:
    with open_image(Path(path)) as opened:
        opened.load()
        yield ImageOps.exif_transpose(opened)


def write_image(path: Path, pixels: NDArray[Any]) -> None:
    """Write an image (rows, columns) or (rows, columns, channels) by its suffix; JPEG loses alpha."""
    kind = _format_of(path)
    image = Image.fromarray(pixels)
    if kind == "JPEG" and image.mode in ("LA", "RGBA"):
        image = image.convert("L" if image.mode == "LA" else "RGB")
    data = io.BytesIO()
    if kind == "WEBP":
        image.save(data, kind, lossless=True)
    elif kind == "JPEG":
        image.save(data, kind, quality=95)
    else:
        image.save(data, kind)
    write_bytes(path, data.getvalue())


def _format_of(path: Path) -> str:
    if path.suffix.lower() not in _FORMATS:
        raise InputError(f"{path}: cannot write images to {path.suffix or 'a name without suffix'}; "
                         f"known: {', '.join(_FORMATS)}")  # fmt: skip
    return _FORMATS[path.suffix.lower()]


def _write_provenance(path: Path, made: Synthesis) -> None:
    """Write where each pixel came from."""
    data = io.BytesIO()
    np.savez_compressed(
        data,
        source_rows=made.source_rows,
        source_cols=made.source_cols,
        error=made.error,
        confidence=made.confidence,
        window=made.window,
        n_seeds=made.n_seeds,
        n_relaxed=made.n_relaxed,
    )
    write_bytes(path, data.getvalue())
