"""The report in a browser: its plots, its leg and its tables do what a reader asks of them."""

import io

import pytest
from PIL import Image

from planner.report.figure import ROLES

LEG, JOINTS = "figure8_foot_paths", "joints_by_method"
PHONE = 400  # width of a screen [px]
BEYOND = 1  # rounding may make a page this much wider than its screen [px]

ALL_DRAWN = (
    "Object.keys(live.figures).every((name) => 'drawn' in document.getElementById(name).dataset)"
)


@pytest.fixture(scope="module")
def report(reproduced):
    return reproduced.folder / "report.html"


@pytest.fixture
def quiet(browser):
    """The browser; afterwards, no page may have complained or asked anybody for anything."""
    yield browser
    assert browser.complaints == []
    assert browser.ask("live.errors") == []
    assert browser.asked_of_others == []


def _open(browser, report, **taste):
    """Open the page at its leg and its joints, and wait until both are drawn."""
    browser.open(report, **taste)
    browser.ask(f"document.getElementById('{JOINTS}').scrollIntoView({{ block: 'center' }})")
    for name in (LEG, JOINTS):
        browser.wait_for(f"'drawn' in document.getElementById('{name}').dataset")


def _plot(expression):
    plot = f"document.querySelector('#{JOINTS} .canvas')"
    return f"(() => {{ const plot = {plot}; return {expression}; }})()"


def _place(browser, across, down):
    """Where a point of the first panel is on the screen [px], which is scrolled there."""
    corner = _plot(
        "(() => { plot.scrollIntoView(); const { left, top } ="
        "plot.querySelector('.nsewdrag').getBoundingClientRect(); return [left, top]; })()"
    )
    left, top = browser.ask(corner)
    return left + across, top + down


def _moment(browser):
    return browser.ask("live.moment")


def test_every_figure_comes_to_life_and_fits_a_phone(quiet, report):
    assert {LEG, JOINTS} < set(quiet.read_through(report, width=PHONE, dark=True))
    assert quiet.ask("document.querySelectorAll('figure.alive .canvas .main-svg').length") > 0
    assert quiet.ask("document.querySelector('h1').textContent") == "The paper’s experiment, again"
    quiet.ask("scrollTo(0, 0)")
    picture = Image.open(io.BytesIO(quiet.screenshot())).convert("RGB")
    assert picture.width == PHONE
    assert sum(picture.getpixel((2, 2))) < 3 * 64
    assert len(picture.getcolors(1 << 24)) > 50  # an empty page has a few


def test_plots_change_their_colours_with_the_page(quiet, report):
    _open(quiet, report)
    colour = _plot("plot.data.find((trace) => trace.name === 'direct').line.color")
    assert quiet.ask(colour) == ROLES["direct"].light
    quiet.prefer(dark=True)
    quiet.wait_for(f"{colour} === '{ROLES['direct'].dark}'")
    assert quiet.ask(_plot("plot.layout.font.color")) == ROLES["ink"].dark


def test_the_slider_moves_the_leg_and_the_line_in_the_plots(quiet, report):
    _open(quiet, report)
    foot = f"document.querySelector('#{LEG} .bones').getAttribute('points').split(' ').at(-1)"
    before = quiet.ask(foot)
    quiet.ask(
        f"(() => {{ const slider = document.querySelector('#{LEG} input');"
        "slider.value = 44; slider.dispatchEvent(new Event('input')); })()"
    )
    assert quiet.ask(foot) != before
    assert _moment(quiet) == pytest.approx(44 * 0.008)
    assert quiet.ask(f"document.querySelector('#{LEG} .clock').textContent") == "352 ms"
    quiet.wait_for(_plot("plot.layout.shapes[0].x0 === 352"))


def test_play_moves_the_leg_and_pause_stops_it(quiet, report):
    _open(quiet, report)
    press = f"document.querySelector('#{LEG} .play').click()"
    quiet.ask(press)
    quiet.wait_for("live.moment > 0.02")
    quiet.ask(press)
    stopped = _moment(quiet)
    quiet.ask("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert _moment(quiet) == stopped


def test_the_leg_follows_the_pointer_in_a_plot_which_tells_values_with_units(quiet, report):
    _open(quiet, report)
    x, y = _place(quiet, 90, 40)
    quiet.point("mouseMoved", x, y)
    quiet.wait_for("live.moment > 0")
    quiet.wait_for(_plot("plot.querySelector('.hoverlayer').textContent.includes(' deg')"))
    assert " ms" in quiet.ask(_plot("plot.querySelector('.hoverlayer').textContent"))


def test_an_entry_of_the_legend_hides_its_curve_in_every_panel(quiet, report):
    _open(quiet, report)
    shown = _plot(
        "plot.data.filter((trace) => trace.name === 'direct' && trace.visible === true).length"
    )
    entries = f"[...document.querySelectorAll('#{JOINTS} .entry')]"
    entry = f"{entries}.find((each) => each.textContent === 'direct')"
    assert quiet.ask(shown) == 4  # three joints and the foot
    quiet.ask(f"{entry}.click()")
    quiet.wait_for(f"{shown} === 0")
    assert quiet.ask(f"{entry}.ariaPressed") == "false"
    quiet.ask(f"{entry}.click()")
    quiet.wait_for(f"{shown} === 4")


def test_a_table_is_copied_as_a_spreadsheet_reads_it(quiet, report, reproduced):
    button = "document.querySelector('.scroll[aria-label=\"Foot distances\"] + .copy')"
    _open(quiet, report)
    quiet.ask("navigator.clipboard.writeText = async (text) => { live.copied = text; }")
    quiet.ask(f"{button}.click()")
    quiet.wait_for("live.copied !== undefined")
    rows = [line.split("\t") for line in quiet.ask("live.copied").splitlines()]
    assert len({len(row) for row in rows}) == 1
    direct = reproduced.results["foot"]["direct"]
    (row,) = [row for row in rows if row[0].startswith("direct")]
    assert row[1:3] == [f"{direct['L2']:.2f}", f"{direct['paper']['L2']:.2f}"]
    assert row[3].startswith(("-", "+", "0"))
    quiet.wait_for(f"{button}.textContent === 'copied'")


def test_on_paper_every_plot_is_light_and_as_wide_as_its_figure(quiet, report):
    quiet.open(report, dark=True)
    colour = _plot("plot.data.find((trace) => trace.name === 'direct').line.color")
    quiet.wait_for(f"'drawn' in document.getElementById('{JOINTS}').dataset")
    assert quiet.ask(colour) == ROLES["direct"].dark
    quiet.prefer(dark=True, media="print")
    quiet.wait_for(ALL_DRAWN)
    quiet.wait_for(f"{colour} === '{ROLES['direct'].light}'")
    widths = "(plot) => [plot.clientWidth, plot.querySelector('.main-svg').clientWidth]"
    for frame, drawn in quiet.ask(f"[...document.querySelectorAll('.canvas')].map({widths})"):
        assert drawn == pytest.approx(frame, abs=BEYOND)
    tools = "[...document.querySelectorAll('.modebar-container, .controls')]"
    assert set(quiet.ask(f"{tools}.map((each) => getComputedStyle(each).display)")) == {"none"}
    assert quiet.printed()[:5] == b"%PDF-"
