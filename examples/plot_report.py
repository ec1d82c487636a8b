# SPDX-License-Identifier: MIT
"""The picture of a report in the README: its first screen, as headless Chromium draws it.

Run it with `python examples/plot_report.py [REPORT] [--docs FOLDER] [--name NAME]` after `make demo`: it
writes FOLDER/pictures/NAME.png (default: docs, first_report). Without Chromium it says so and leaves the
picture as it is.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, HEIGHT = 1200, 1400  # of the window, pixels
SHOWN = 900  # pixels wide in the docs


def photograph(page: Path, browser: str, picture: Path) -> None:
    """Draw the first screen of a page, without network and in light colours."""
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(
            [
                browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--use-gl=angle",
                "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--virtual-time-budget=8000",
                "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}",
                f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={picture}", page.resolve().as_uri(),
            ],
            check=True, capture_output=True, timeout=120,
        )  # fmt: skip
    with Image.open(picture) as image:
        small = image.convert("RGB").resize((SHOWN, SHOWN * HEIGHT // WIDTH), Image.Resampling.LANCZOS)
    small.quantize(192, dither=Image.Dither.NONE).save(picture, optimize=True)


def main(arguments: list[str] | None = None) -> None:
    """Take the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("report", nargs="?", type=Path, default=ROOT / "out/demo/report.html")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--name", default="first_report", help="of the picture")
    asked = parser.parse_args(arguments)
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        print(f"skipped: none of {', '.join(BROWSERS)} is there")
    elif not asked.report.is_file():
        print(f"skipped: there is no {asked.report}; run `make demo`, or name a report")
    else:
        folder = asked.docs / "pictures"
        folder.mkdir(parents=True, exist_ok=True)
        photograph(asked.report, browser, folder / f"{asked.name}.png")
        print(f"{asked.name}.png")


if __name__ == "__main__":
    main()
