# SPDX-License-Identifier: MIT
"""The pictures and tables of docs/guides/instruments.md: built-in instruments by family, from their profiles.

Run it with `python examples/plot_instruments.py [--docs FOLDER]`. Where FOLDER holds the page, its tables are
written anew; a test compares them with the profiles.
"""

import argparse
import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from PIL import Image

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

from nbv import load_sensor
from nbv.scanning.noise_models import TableNoise, TerrestrialNoise, range_sigma_m
from nbv.scanning.sensor import Sensor
from nbv.scanning.sensor_profile import load_profile

FAMILIES = {
    "terrestrial": {
        "faro_focus_s350": "FARO Focus S350",
        "leica_rtc360": "Leica RTC360",
        "leica_p40": "Leica ScanStation P40",
        "leica_blk360": "Leica BLK360 G1",
        "riegl_vz400i": "RIEGL VZ-400i",
        "trimble_x7": "Trimble X7",
    },
    "mobile": {
        "velodyne_vlp16": "Velodyne VLP-16",
        "ouster_os1_64": "Ouster OS1-64",
        "livox_mid360": "Livox Mid-360",
    },
    "depth": {
        "azure_kinect": "Azure Kinect",
        "kinect_v1": "Kinect v1",
        "realsense_d435": "RealSense D435",
        "realsense_l515": "RealSense L515",
    },
    "triangulation": {
        "photoneo_phoxi_m": "Photoneo PhoXi M",
        "konica_vivid910": "Konica Minolta VIVID 910",
    },
}
WHITE = {0.9: "-", 0.5: "--", 0.1: ":"}


def ranges_of(sensor: Sensor) -> np.ndarray:
    """Ranges within the gate of a sensor, metres."""
    return np.geomspace(max(sensor.min_range_m, 0.1), sensor.max_range_m, 200)


def depends_on_light(sensor: Sensor) -> bool:
    """Whether the noise is another on darker surfaces."""
    noise = sensor.effects.noise
    return isinstance(noise, TerrestrialNoise) or (
        isinstance(noise, TableNoise) and len(noise.reflectivity) > 1
    )


def spacing_deg(sensor: Sensor) -> tuple[float, float]:
    """Angles between columns and between rows, degrees: in the middle of a camera's image."""
    projection = sensor.projection
    if projection.kind == "pinhole":
        return float(np.degrees(1 / projection.fx)), float(np.degrees(1 / abs(projection.fy)))
    across, down = (np.median(np.abs(np.diff(a))) for a in (projection.azimuths, projection.elevations))
    return float(np.degrees(across)), float(np.degrees(down))


def draw(family: str, folder: Path) -> None:
    """Draw noise, beam and spacing by range for the instruments of one family."""
    sensors = {title: load_sensor(name) for name, title in FAMILIES[family].items()}
    labels = ["range noise, one sigma", "diameter of the beam", "point spacing"]
    if not any(sensor.effects.footprint for sensor in sensors.values()):
        labels.remove("diameter of the beam")
    n = len(labels)
    figure, row = plt.subplots(1, n, figsize=(1 + 4 * n, 4.4), layout="constrained")
    axes = dict(zip(labels, row, strict=True))
    for k, (title, sensor) in enumerate(sensors.items()):
        draw_one(sensor, title, f"C{k}", axes)
    for text, ax in axes.items():
        ax.set(xscale="log", yscale="log", xlabel="range, m", ylabel=f"{text}, mm")
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        ax.grid(alpha=0.3, lw=0.5)
    if any(depends_on_light(sensor) for sensor in sensors.values()):
        for white, line in WHITE.items():
            alone = ", or the one stated" if white == 0.9 else ""
            row[0].plot([], [], "k", ls=line, label=f"{white:.0%} reflectivity{alone}")
        row[0].legend(fontsize=8)
    if n == 3:
        row[-1].plot([], [], "k:", label="finest setting")
    row[-1].legend(fontsize=8)
    save(figure, folder / f"instruments_{family}.png")


def draw_one(sensor: Sensor, title: str, colour: str, axes: dict[str, plt.Axes]) -> None:
    """Draw the curves of one instrument into the panels that there are."""
    first, *_, last = axes.values()
    ranges, noise = ranges_of(sensor), sensor.effects.noise
    for white, line in WHITE.items() if depends_on_light(sensor) else [(0.9, "-")]:
        sigma = range_sigma_m(noise, ranges, np.zeros_like(ranges), 1.0, white)
        first.plot(ranges, 1e3 * np.broadcast_to(sigma, ranges.shape), colour, ls=line)
    if isinstance(noise, TableNoise):
        for sd in noise.sd_m:
            first.plot(noise.range_m, 1e3 * np.array(sd), f"{colour}o", ms=4)
    if sensor.effects.footprint is not None:
        beam = axes["diameter of the beam"]
        beam.plot(ranges, 1e3 * sensor.effects.footprint.diameter_m(ranges), colour)
    last.plot(ranges, 1e3 * np.radians(spacing_deg(sensor)[0]) * ranges, colour, label=title)
    if finest := getattr(sensor, "finest_step_deg", None):
        last.plot(ranges, 1e3 * np.radians(finest) * ranges, colour, ls=":")


def save(figure: plt.Figure, file: Path) -> None:
    """Write a picture and say so."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110)
    plt.close(figure)
    with Image.open(drawn) as picture:
        picture.convert("RGB").quantize(64).save(file, optimize=True)
    print(file.name)


def view_of(sensor: Sensor) -> str:
    """Return the field of view, degrees."""
    projection = sensor.projection
    if projection.kind != "pinhole":
        return f"{sensor.azimuth_span_deg:g} x ({sensor.elevation_min_deg:g} to {sensor.elevation_max_deg:g})"
    half = (projection.width / 2 / projection.fx, projection.height / 2 / projection.fy)
    return " x ".join(f"{2 * np.degrees(np.arctan(tangent)):.0f}" for tangent in half)


def noise_of(sensor: Sensor) -> str:
    """Return the range noise as its profile states it."""
    noise = sensor.effects.noise
    if isinstance(noise, TableNoise):
        rows = zip(noise.reflectivity, noise.sd_m, strict=True)
        at = [
            ", ".join(f"{1e3 * sd:.3g} at {r:g} m" for r, sd in zip(noise.range_m, row, strict=True))
            + f" on {white:.0%}"
            for white, row in rows
        ]
        return "; ".join(at)
    ranges = np.unique([max(sensor.min_range_m, 0.1), sensor.max_range_m])
    sigma = 1e3 * np.broadcast_to(range_sigma_m(noise, ranges, 0 * ranges), ranges.shape)
    if np.ptp(sigma) == 0:
        return f"{sigma[0]:.2g}"
    return ", ".join(f"{float(f'{sd:.2g}'):g} at {r:.3g} m" for r, sd in zip(ranges, sigma, strict=True))


def texts(sources: Mapping[str, Any]) -> Iterator[str]:
    """Sources of all numbers of a profile."""
    for value in sources.values():
        if isinstance(value, str):
            yield value
        else:
            yield from texts(value)


def column(name: str, title: str) -> dict[str, str]:
    """Return what the table says of one instrument."""
    profile = load_profile(name)
    sensor, sources = profile.sensor, list(texts(profile.sources))
    rows, columns = sensor.projection.shape
    beam, pointing = sensor.effects.footprint, sensor.effects.pointing
    finest = getattr(sensor, "finest_step_deg", None)
    return {
        "": title,
        "profile": f"`{name}`",
        "field of view, °": view_of(sensor),
        "range, m": f"{sensor.min_range_m:g} to {sensor.max_range_m:g}",
        "pixels": f"{columns} x {rows}",
        "step, °": " x ".join(f"{angle:.3g}" for angle in spacing_deg(sensor)),
        "finest step, °": "-" if finest is None else f"{finest:g}",
        "points a second": f"{sensor.points_per_s:,.0f}",
        "time of a scan, s": f"{sensor.scan_time_s:.2g}",
        "diameter of the beam at r metres, mm": "-"
        if beam is None
        else f"{1e3 * beam.exit_diameter_m:.3g} + {1e3 * beam.divergence_rad:.3g} r",
        "range noise (one sigma), mm": noise_of(sensor),
        "direction (one sigma), °": "-" if pointing is None else f"{pointing.sd_deg:g}",
        "numbers not checked": f"{sum('not checked' in text for text in sources)} of {len(sources)}",
    }


def table(family: str) -> str:
    """Return the table of a family in Markdown: a column for each instrument."""
    columns = [column(*entry) for entry in FAMILIES[family].items()]
    lines = [[key, *(told[key] for told in columns)] for key in columns[0]]
    lines = [line for line in lines if set(line[1:]) != {"-"}]
    head, *body = [f"| {' | '.join(line)} |\n" for line in lines]
    return head + "|---" * (len(columns) + 1) + "|\n" + "".join(body)


def with_tables(page: str) -> str:
    """Return the page with its tables made anew, each after the picture of its family."""
    for family in FAMILIES:
        place = rf"(\]\(\.\./pictures/instruments_{family}\.png\)\n\n)(?:\|.*\n)*"
        page = re.sub(place, lambda found, family=family: found[1] + table(family), page)
    return page


def main(arguments: list[str] | None = None) -> None:
    """Write the pictures, and the tables into the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=Path(__file__).resolve().parents[1] / "docs")
    docs = parser.parse_args(arguments).docs
    (docs / "pictures").mkdir(parents=True, exist_ok=True)
    for family in FAMILIES:
        draw(family, docs / "pictures")
    page = docs / "guides/instruments.md"
    if page.exists():
        page.write_text(with_tables(page.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
