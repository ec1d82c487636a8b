# SPDX-License-Identifier: MIT
"""A headless Chromium with no network, driven by the DevTools protocol through pipes."""

import base64
import fcntl
import io
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CHROMIUM = shutil.which("chromium")
FLAGS = (
    "--headless", "--no-sandbox", "--remote-debugging-pipe", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-background-networking", "--disable-component-update",
    "--disable-default-apps", "--disable-extensions", "--disable-sync", "--no-first-run", "--hide-scrollbars",
    "--disable-dev-shm-usage", "--force-color-profile=srgb", "--mute-audio",
)  # fmt: skip

OFFLINE = ("--proxy-server=127.0.0.1:9", "--host-resolver-rules=MAP * ~NOTFOUND")
LOOPBACK = ("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",)
PATIENCE_S = 20
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


class Browser:
    """One browser; `open` gives its pages. It reaches nothing, or servers on this machine if asked."""

    def __init__(self, folder, network=OFFLINE):
        to_browser, from_here = _pipe()
        from_browser, to_here = _pipe()
        # bash gives the browser its ends as 3 and 4, where it looks for them
        line = f'exec "$@" 3<&{to_browser} 4>&{to_here}'
        self._process = subprocess.Popen(
            [
                "bash",
                "-c",
                line,
                "bash",
                CHROMIUM,
                *FLAGS,
                *network,
                f"--user-data-dir={folder}",
                "about:blank",
            ],
            pass_fds=(to_browser, to_here),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(to_here)
        self._write, self._read = os.fdopen(from_here, "wb", 0), from_browser
        self._number, self.events, self._rest = 0, [], b""

    def call(self, method, session=None, **parameters):
        """Send a command and return its result; events that come first are kept."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if session:
            message["sessionId"] = session
        self._write.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self.events.append(answer)

    def _receive(self):
        while b"\0" not in self._rest:
            assert select.select([self._read], [], [], PATIENCE_S)[0], "the browser does not answer"
            data = os.read(self._read, 1 << 20)
            assert data, "the browser has gone"
            self._rest += data
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, path, width=1280, height=900, *, before="", scripts=True, **features):
        """Open a file or an address in a page of its own; `before` runs ahead of its scripts, if any."""
        url = path if str(path).startswith("http://127.0.0.1:") else Path(path).resolve().as_uri()
        return Tab(self, url, width, height, features, before, scripts)

    def close(self):
        """End the browser."""
        try:
            self.call("Browser.close")
        except AssertionError:
            self._process.kill()
        self._process.wait(PATIENCE_S)
        self._write.close()
        os.close(self._read)


class Tab:
    """An open page."""

    def __init__(self, browser, url, width, height, features, before, scripts):
        self._browser, start = browser, len(browser.events)
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        attached = browser.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session, self._target, self._start = attached["sessionId"], target, start
        self._scripts = scripts
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        wanted = {"prefers-reduced-motion": "reduce", **{k.replace("_", "-"): v for k, v in features.items()}}
        self.call("Emulation.setEmulatedMedia", features=[{"name": k, "value": v} for k, v in wanted.items()])
        if before:
            self.call("Page.addScriptToEvaluateOnNewDocument", source=before)
        self.call("Emulation.setScriptExecutionDisabled", value=not scripts)
        self._own = url if url.startswith("http") else "file:"
        self.call("Page.navigate", url=url)
        while self.run("document.readyState") != "complete":
            time.sleep(0.01)

    def call(self, method, **parameters):
        """Send a command to this page."""
        return self._browser.call(method, self._session, **parameters)

    def run(self, expression):
        """Return the value of a JavaScript expression, a promise's once it is kept."""
        result = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=self._scripts, returnByValue=True
        )
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait_for(self, expression, seconds=15):
        """Wait until an expression holds."""
        looks = int(seconds * 20)
        self.run(
            f"(async () => {{ for (let k = 0; k < {looks}; k++) {{ if ({expression}) return;"
            " await new Promise(done => setTimeout(done, 50)); } throw new Error('never'); })()"
        )

    def press(self, key, **more):
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            text = {"text": key} if len(key) == 1 and kind == "keyDown" else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, **text, **more)

    def click(self, x, y):
        """Press and release the left button."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def box(self, selector):
        """Left, top, width and height of an element in the window, which is scrolled to it."""
        return self.run(
            f"(e => {{ e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect();"
            f" return [b.left, b.top, b.width, b.height]; }})(document.querySelector({json.dumps(selector)}))"
        )

    def pixels(self, selector=None):
        """Pixels (h, w, 3) of an element, of the window when not given."""
        clip = {}
        if selector:
            left, top, width, height = self.box(selector)
            across, down = self.run("[scrollX, scrollY]")
            clip = {
                "clip": {"x": left + across, "y": top + down, "width": width, "height": height, "scale": 1}
            }
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return _decoded(
            self.call("Page.captureScreenshot", format="png", optimizeForSpeed=True, **clip)["data"]
        )

    def whole(self, path):
        """Write a picture of the whole page."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        data = self.call("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)[
            "data"
        ]
        Path(path).write_bytes(base64.b64decode(data))

    def complaints(self):
        """What the console has said, and requests for anything but the page and what is below it."""
        found = []
        for event in self._browser.events[self._start :]:
            if event.get("sessionId") != self._session:
                continue
            method, what = event["method"], event["params"]
            if method == "Runtime.consoleAPICalled" and what["type"] != "debug":
                found.append(" ".join(str(one.get("value", one)) for one in what["args"]))
            elif method == "Runtime.exceptionThrown":
                found.append(str(what["exceptionDetails"]))
            elif method == "Log.entryAdded":
                found.append(what["entry"]["text"])
            elif method == "Network.requestWillBeSent":
                url = what["request"]["url"]
                if not url.startswith((self._own, "data:", "blob:")):
                    found.append(f"request for {url}")
        return found

    def close(self):
        """Close it."""
        self._browser.call("Target.closeTarget", targetId=self._target)


def _pipe():
    """Both ends of a pipe, with numbers that do not get into the way of 3 and 4."""
    ends = os.pipe()
    high = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 20) for end in ends]
    for end in ends:
        os.close(end)
    return high


def _decoded(data):
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        return np.array(image.convert("RGB"))
