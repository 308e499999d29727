"""Chromium without a window, spoken to through its DevTools protocol over a pair of pipes."""

import base64
import fcntl
import json
import os
import select
import subprocess
import time

ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)

INVALID = """Object.values(live.figures).filter(({ kind }) => kind === 'plot').map(live.plotOf)
.flatMap(({ data, layout }) => Plotly.validate(live.coloured(data), live.coloured(layout)) ?? [])
.map(({ msg }) => msg).filter((msg) => !/array container|not get coerced/.test(msg))"""
"""What Plotly does not know of a page's figures, but for packed arrays and words without effect."""

PATIENCE = 120.0
"""The longest that anything is waited for [s]: a browser that starts on a busy machine."""


class Browser:
    """One page of a browser: what it complains of, what it asks for, what is to be seen.

    Attributes:
        complaints: What was said on its console, thrown, or reported of it.
        requests: Addresses that it asked for, its own among them.
    """

    def __init__(self, executable, profile):
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        # The browser expects 3 and 4, which must not be taken before both are in place.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_browser, from_browser)]
        os.close(to_browser)
        os.close(from_browser)
        self._process = subprocess.Popen(
            ["bash", "-c", f'exec "$0" "$@" 3<&{ends[0]} 4>&{ends[1]}', executable, *ARGUMENTS,
             "--remote-debugging-pipe", f"--user-data-dir={profile}"],
            pass_fds=ends,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        for end in ends:
            os.close(end)
        self._number, self._buffer, self._session = 0, b"", None
        self.complaints, self.requests, self._events = [], [], []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def open(self, path, *, width=1280, height=900, dark=False, media=""):
        """Open a file as if on a screen of this size and taste; begin with no complaints."""
        phone = width < 600
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=phone)  # fmt: skip
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)
        self.prefer(dark=dark, media=media)
        self.leave()
        self.complaints.clear()
        self.requests.clear()
        self._load(path.as_uri())

    def read_through(self, path, **taste):
        """Open a page, look at all of its figures, which draw themselves, and answer their names.

        Nothing may be wider than the screen, complain, or ask for another file, and every word of a
        plot must be one of Plotly's.
        """
        self.open(path, **taste)
        figures = self.ask("Object.keys(live.figures)")
        for name in figures:
            self.ask(f"document.getElementById('{name}').scrollIntoView()")
            self.wait_for(f"'drawn' in document.getElementById('{name}').dataset")
        assert self.ask("document.documentElement.scrollWidth <= innerWidth")
        assert self.complaints == self.ask("live.errors") == self.ask(INVALID) == []
        assert self.requests == [path.as_uri()]
        return figures

    def leave(self):
        """Leave the page, which ends what it does."""
        self._load("about:blank")

    def prefer(self, *, dark, media=""):
        """Whether the reader prefers dark pages, and the medium if not a screen."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", media=media, features=[scheme])

    @property
    def asked_of_others(self):
        """Addresses that it asked for outside the page's own file and text."""
        own = ("file:", "data:", "blob:")
        return [address for address in self.requests if not address.startswith(own)]

    def ask(self, expression):
        """The value of a JavaScript expression, of what it promises if it is a promise."""
        told = self.call("Runtime.evaluate", expression=expression, returnByValue=True,
                         awaitPromise=True, userGesture=True)  # fmt: skip
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def wait_for(self, expression):
        self._until(lambda: self.ask(expression))

    def point(self, kind, x, y, **more):
        """Do something with the pointer: kind is mouseMoved, mousePressed or mouseReleased."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def screenshot(self, *, whole=False):
        """What is to be seen, as PNG; the whole page if so asked."""
        told = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        return base64.b64decode(told["data"])

    def printed(self):
        """The page on paper, as PDF."""
        told = self.call("Page.printToPDF", printBackground=True, paperWidth=8.27, paperHeight=11.7)
        return base64.b64decode(told["data"])

    def close(self):
        self._session = None
        self.call("Browser.close")
        self._process.wait(PATIENCE)
        os.close(self._in)
        os.close(self._out)

    def call(self, method, **parameters):
        """Ask for something of the protocol, and wait for its answer."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            told = self._next()
            if told.get("id") == self._number:
                assert "error" not in told, (method, told)
                return told["result"]

    def _load(self, address):
        self._events.clear()
        self.call("Page.navigate", url=address)
        self._until(lambda: "Page.loadEventFired" in self._events)

    def _until(self, done):
        deadline = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < deadline, "the browser did not get there"
            if b"\0" in self._buffer or select.select([self._in], [], [], 0.02)[0]:
                self._next()

    def _next(self):
        """The next thing that the browser says, noted down."""
        while b"\0" not in self._buffer:
            assert select.select([self._in], [], [], PATIENCE)[0], "the browser is silent"
            read = os.read(self._in, 1 << 20)
            assert read, "the browser has ended"
            self._buffer += read
        message, _, self._buffer = self._buffer.partition(b"\0")
        told = json.loads(message)
        self._note(told.get("method"), told.get("params", {}))
        return told

    def _note(self, event, told):
        self._events.append(event)
        if event == "Runtime.consoleAPICalled":
            self.complaints.append([each.get("value", each) for each in told["args"]])
        elif event == "Runtime.exceptionThrown":
            self.complaints.append(told["exceptionDetails"])
        elif event == "Log.entryAdded":
            self.complaints.append(told["entry"])
        elif event == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
