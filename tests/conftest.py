"""What every test shares: hypothesis tries the same examples at every run, without a clock."""

from __future__ import annotations

import os
import shutil
import subprocess
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from hypothesis import settings

from tests.browser import Browser

settings.register_profile("suite", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("suite")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder with recordings of real servos; a test that asks for it is skipped without."""
    named = os.environ.get("REQUEST_PLANNER_RECORDINGS", "")
    if not named:
        pytest.skip("no recordings: REQUEST_PLANNER_RECORDINGS is not set")
    folder = Path(named)
    if not folder.is_dir():
        pytest.skip(f"no recordings: REQUEST_PLANNER_RECORDINGS names no folder ({folder})")
    return folder


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """A browser for pages that live: one for all tests, each of which opens its page anew."""
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        pytest.skip("Chromium is not installed")
    browser = Browser(executable, tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def robots() -> Path:
    """The folder of example-robot-data; a test that asks for it is skipped without."""
    try:
        found = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("needs the extra robots")
    return Path(str(found.locate_file("cmeel.prefix/share/example-robot-data/robots")))


@pytest.fixture
def opened(tmp_path):
    """A page opened by Chromium: its path to what the browser made of it and complained of."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("Chromium is not installed")

    def opened(page):
        return subprocess.run(
            [
                browser,
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
                "--enable-logging=stderr",
                f"--user-data-dir={tmp_path / 'profile'}",
                "--window-size=400,800",
                "--dump-dom",
                page.as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )

    return opened
