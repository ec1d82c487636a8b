# SPDX-License-Identifier: MIT
"""The page docs/results/paper-study.md: tables and pictures of the study of the paper.

Run it with `python examples/plot_paper_study.py [--docs FOLDER] [--starts N] [--spacing M] [--threads N]`: it
measures all anew, draws the pictures into FOLDER/pictures, and puts its tables between the marks of
FOLDER/results/paper-study.md (default: docs), whose text a person writes.
Few starts and coarse samples are quick.
"""

import argparse
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from benchmarks.suites.paper_study import (
    ANGLES,
    OFFLINE,
    ONLINE,
    SENSORS,
    SHARES,
    STUDIES,
    Problem,
    Result,
    measure,
    shown,
    table,
    tail,
)

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from nbv import load_sensor
from nbv.run.wording import count
from nbv.visibility.site_options import TRIPOD_HEIGHTS_M
from scenes import Pose, Scene, builtin_scene

Results = Mapping[tuple[str, int], Result]

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, VIEWS, STATIONS = "results/paper-study.md", "paper_study_views.png", "paper_study_stations.png"
COLOURS = {90: "#0072B2", 75: "#00805F", 60: "#C64F00", 45: "#882255"}  # told apart by all kinds of eyes
HEIGHT_COLOURS = ("#DCE9F5", "#9CC3E4", "#3F85BE", "#0B3C66")  # the lowest stations lightest
INK, GREY, PALE, WALL = "#22313A", "#5D6970", "#E4E9EC", "#C9D1D6"
PAPER_VIEWS, PAPER_MORE = 110, (100, 200)
FIRST = 0.85  # share with which the chart begins
TICKS = (1, 2, 5, 10, 20, 50, 100, 200)
MAP_ANGLE, MAP_SHARE = 60, 0.99


def draw_views(results: Mapping[str, Results], path: Path) -> None:
    """Draw views against share of the area: a panel for each sensor, a colour for each requirement."""
    figure, panels = plt.subplots(1, len(results), figsize=(13.5, 7), sharey=True, layout="constrained")
    for axes, (sensor, found) in zip(np.atleast_1d(panels), results.items(), strict=True):
        ends = {}
        for angle in dict.fromkeys(angle for _, angle in found):
            colour = COLOURS[angle]
            ends[angle] = [found[study.name, angle] for study in (ONLINE, OFFLINE)]
            draw_line(axes, ends[angle][0], colour, "-", colour)
            draw_line(axes, ends[angle][1], colour, (0, (3, 1.5)), "white")
        label_lines(axes, ends)
        dress(axes, SENSORS[sensor])
    draw_paper(np.atleast_1d(panels)[0])
    draw_key(np.atleast_1d(panels)[-1])
    np.atleast_1d(panels)[0].set_ylabel("views (logarithmic scale)", color=INK)
    title = "Views until a room of 6 x 5 m with two boxes is seen, or seen within an angle of its normals"
    figure.suptitle(title, x=0.008, ha="left", fontsize=14, color=INK)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_line(axes: Axes, result: Result, colour: str, style: object, fill: str) -> None:
    """Draw one line with its markers, and a cross where the planner ends before all is met."""
    shares = np.append(np.arange(FIRST, 1.0, 0.0005), 1.0)
    views = np.array([result.views(share) for share in shares])
    axes.plot(100 * shares, views, color=colour, linestyle=style, linewidth=2)
    met = [(100 * share, result.views(share)) for share in SHARES if np.isfinite(result.views(share))]
    axes.plot(
        *np.reshape(met, (-1, 2)).T, "o", color=colour, markerfacecolor=fill, markersize=7, clip_on=False
    )
    if not np.isfinite(result.views(1.0)):
        end = (100 * result.end[0], result.end[1])
        axes.plot(*end, "X", color=colour, markersize=9, markeredgecolor="white", clip_on=False, zorder=4)


def label_lines(axes: Axes, ends: Mapping[int, Sequence[Result]]) -> None:
    """Write beside the ends of the two lines of a requirement what it is, and their views."""
    wanted = {
        angle: float(np.log10(offline.views(1.0) * online.end[1]) / 2)
        for angle, (online, offline) in ends.items()
    }
    places = apart(wanted, 0.27)
    for angle, (online, offline) in ends.items():
        met, last = online.end
        views, rest = online.views(1.0), ""
        if not np.isfinite(views):
            views, rest = last, f" (ends at {shown(met)} %)"
        words = (
            (ANGLES[angle], 14, "bold", 11),
            (f"online {views:g}{rest}", 0, "normal", 9.5),
            (f"offline {offline.views(1.0):g} (at least {offline.at_least[1.0]})", -14, "normal", 9.5),
        )
        for text, up, weight, size in words:
            axes.annotate(
                text, (100, 10 ** places[angle]), xytext=(14, up), textcoords="offset points", va="center",
                color=COLOURS[angle], fontsize=size, fontweight=weight, annotation_clip=False,
            )  # fmt: skip


def apart(wanted: Mapping[int, float], gap: float) -> dict[int, float]:
    """Return places at least `gap` apart, in the same order: the wanted ones, or pushed up."""
    places: dict[int, float] = {}
    lowest = -np.inf
    for name in sorted(wanted, key=lambda name: wanted[name]):
        places[name] = lowest = max(wanted[name], lowest + gap)
    return places


def dress(axes: Axes, title: str) -> None:
    """Set scales, grid and title."""
    axes.set_yscale("log")
    axes.set(xlim=(100 * FIRST, 100), ylim=(1, 400))
    axes.set_yticks(TICKS, [str(tick) for tick in TICKS])
    axes.set_xticks([85, 90, 95, 99, 100])
    axes.minorticks_off()
    axes.grid(color=PALE)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("% of the area that any view could measure so", color=INK)
    axes.set_title(title, loc="left", fontsize=13, fontweight="bold", color=INK)


def draw_paper(axes: Axes) -> None:
    """Draw what the paper says of its room and sensor."""
    low, high = (PAPER_VIEWS + more for more in PAPER_MORE)
    axes.axhspan(low, high, color=PALE, zorder=0)
    axes.axhline(PAPER_VIEWS, color=GREY, linewidth=1.6, linestyle=":")
    axes.text(100 * FIRST + 0.2, (low * high) ** 0.5, "the paper: every point accurate, 100 to 200 more",
              color=GREY, fontsize=9.5, va="center")  # fmt: skip
    axes.text(100 * FIRST + 0.2, PAPER_VIEWS * 1.06, "the paper: every part seen, about 110",
              color=GREY, fontsize=9.5, va="bottom")  # fmt: skip


def draw_key(axes: Axes) -> None:
    """Draw what the lines and markers mean."""
    plain = {"color": INK, "linewidth": 2, "markersize": 7}
    handles = [
        axes.plot([], [], "-o", **plain)[0],
        axes.plot([], [], "--o", markerfacecolor="white", **plain)[0],
        axes.plot([], [], "X", color=INK, markersize=9, markeredgecolor="white")[0],
    ]
    words = (
        "online: the room is unknown, median of starts",
        "offline: the room is known, a plan for each dot",
        "here the online planner sees nothing more to gain",
    )
    axes.legend(handles, words, loc="upper left", frameon=False, fontsize=9.5, labelcolor=INK)


def draw_stations(room: Scene, results: Mapping[str, Results], path: Path) -> None:
    """Draw from above where the views of the online runs and of the offline plans are taken."""
    figure, panels = plt.subplots(len(results), 2, figsize=(12, 11.6), layout="constrained", squeeze=False)
    for row, (sensor, found) in zip(panels, results.items(), strict=True):
        for axes, name, study in zip(row, ("online", "offline"), (ONLINE, OFFLINE), strict=True):
            poses = poses_to(found[study.name, MAP_ANGLE], MAP_SHARE)
            draw_map(axes, room, poses, looks=sensor != "panorama")
            n_places = len({tuple(pose.translation[:2].round(3)) for pose in poses})
            where = "" if n_places == len(poses) else f" from {count(n_places, 'place')}"
            title = f"{SENSORS[sensor]}, {name}: {count(len(poses), 'view')}{where}"
            axes.set_title(title, color=INK, fontsize=12, loc="left")
    title = (
        f"Stations that measure {100 * MAP_SHARE:g} % of what is reachable {ANGLES[MAP_ANGLE]} of the normal"
    )
    figure.suptitle(title, x=0.004, ha="left", fontsize=14, color=INK)
    key = "Height of the sensor. Arrows: where it looks, from above; the shorter, the more up or down."
    handles, words = panels[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, words, title=key, loc="outside lower left", ncols=4, frameon=False, labelcolor=INK,
        alignment="left", fontsize=11, title_fontsize=11,
    )  # fmt: skip
    figure.savefig(path, dpi=100)
    plt.close(figure)


def poses_to(result: Result, share: float) -> Sequence[Pose]:
    """Return the views, to this share, of the run nearest to what is said of all."""
    views = result.views_to(share)
    run = int(np.argmin(np.abs(views - result.views(share))))
    return result.poses[run][: int(min(views[run], len(result.poses[run])))]


def draw_map(axes: Axes, room: Scene, poses: Sequence[Pose], *, looks: bool) -> None:
    """Draw one floor plan: boxes with their heights, stations by theirs, and where they look."""
    low, high = room.mesh.bounds()
    axes.add_patch(Rectangle(low[:2], *(high - low)[:2], facecolor="white", edgecolor=INK, linewidth=3))
    for number, name in enumerate(room.surface_names):
        if name.endswith("box top"):
            draw_box(axes, room.mesh.corners[room.mesh.face_surface == number].reshape(-1, 3))
    places = np.array([pose.translation for pose in poses])
    if looks:
        ways = np.array([pose.rotation[:2, 2] for pose in poses])
        axes.quiver(
            *places[:, :2].T, *(0.6 * ways.T), angles="xy", scale_units="xy", scale=1, width=0.006,
            color=GREY, zorder=3,
        )  # fmt: skip
    for height, colour, size in zip(TRIPOD_HEIGHTS_M, HEIGHT_COLOURS, (13, 10.5, 8, 5.5), strict=True):
        here = places[np.isclose(places[:, 2], height)]
        axes.plot(
            *here[:, :2].T, "o", color=colour, markersize=size, markeredgecolor=INK, zorder=4,
            label=f"{height:g} m",
        )  # fmt: skip
    axes.set(aspect="equal", xlim=(low[0] - 0.05, high[0] + 0.05), ylim=(low[1] - 0.05, high[1] + 0.05))
    axes.axis("off")


def draw_box(axes: Axes, corners: NDArray[np.float64]) -> None:
    """Draw a box by the corners (n, 3) of its top, and write how high it is."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    axes.add_patch(Rectangle(low[:2], *(high - low)[:2], facecolor=WALL, edgecolor=INK, linewidth=1.5))
    middle = (low + high)[:2] / 2
    axes.text(*middle, f"{high[2]:g} m\nhigh", color=INK, ha="center", va="center", fontsize=10, zorder=2)


def put(page: str, name: str, text: str) -> str:
    """Return the page with `text` between the marks of this name.

    Raises ValueError: the page has no such marks, or several.
    """
    marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    changed, n = marks.subn(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)
    if n != 1:
        raise ValueError(f"the page has {n} places marked {name}, expected 1")
    return changed


def main(arguments: list[str] | None = None) -> None:
    """Measure, draw the pictures, and put the tables into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", type=Path, default=DOCS)
    parser.add_argument("--starts", type=int, default=5, help="runs online, each from a start of its own")
    parser.add_argument("--spacing", type=float, default=0.15, metavar="M", help="between samples")
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args(arguments)
    begun, room, results = time.process_time(), builtin_scene("two_occluders"), {}
    own = given.docs / PAGE
    page = (own if own.is_file() else DOCS / PAGE).read_text("utf-8")
    for sensor in SENSORS:
        problem = Problem.of(room, load_sensor(sensor), given.spacing, given.starts, given.threads)
        results[sensor] = measure(problem, STUDIES)
        page = put(page, f"views, {sensor}", table(results[sensor], STUDIES))
        page = put(page, f"tail, {sensor}", tail(results[sensor], (ONLINE, OFFLINE)))
    for folder in ("pictures", "results"):
        (given.docs / folder).mkdir(parents=True, exist_ok=True)
    draw_views(results, given.docs / "pictures" / VIEWS)
    draw_stations(room, results, given.docs / "pictures" / STATIONS)
    own.write_text(page, "utf-8")
    print(f"{own}: {(time.process_time() - begun) / 60:.1f} minutes of processor time")


if __name__ == "__main__":
    main()
