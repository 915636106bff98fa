"""The page in a real browser: keys, play, slider, narrow screens, dark mode, no errors, and its pictures."""

from __future__ import annotations

import io
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy import ndimage
from synthetic import mechanism
from test_view_page import FRAME

from ancf2d.results import open_results
from ancf2d.study.run import load, run_case
from ancf2d.view import make_page

pytestmark = pytest.mark.slow
CASES = Path(__file__).parents[2] / "cases"
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
         "--disable-background-networking", "--disable-component-update", "--disable-sync")


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    """Yield a headless browser with its own profile."""
    binary, service = shutil.which("chromium"), shutil.which("chromedriver")
    if not binary or not service:
        pytest.skip("chromium or chromedriver is not installed (Debian: apt install chromium chromium-driver)")
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed (pip install selenium)")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        for flag in (*FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        found = webdriver.Chrome(options=options, service=webdriver.ChromeService(service))
        yield found
        found.quit()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the saved pages of a motion, of a static case with fields, and of modes."""
    folder = tmp_path_factory.mktemp("pages")
    mechanism(folder / "motion.h5")
    (folder / "static.yaml").write_text(json.dumps(FRAME))
    run_case(load(folder / "static.yaml"), str(folder / "static.h5"))
    run_case(load(CASES / "paper" / "table3_2d2n.yaml", ["solver.modes=3"]), str(folder / "modes.h5"))
    out = {}
    for name in ("motion", "static", "modes"):
        out[name] = folder / f"{name}.html"
        with open_results(folder / f"{name}.h5") as results:
            out[name].write_text(make_page(results).html, encoding="utf-8")
    return out


Show = Callable[..., Any]


@pytest.fixture
def show(driver: Any, pages: dict[str, Path]) -> Iterator[Show]:
    """Yield a function that opens a page at a size and in a colour scheme; the console must stay empty."""
    def opened(name: str, width: int = 1200, height: int = 800, dark: bool = False) -> Any:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        driver.get(pages[name].as_uri())
        assert driver.execute_script("return document.documentElement.dataset.ready") == "yes"
        return driver

    driver.get_log("browser")
    yield opened
    assert driver.get_log("browser") == []


def text(driver: Any, name: str) -> str:
    return driver.execute_script("return document.getElementById(arguments[0]).textContent", name)


# ---------------------------------------------------------------------- hands


@pytest.mark.parametrize("focus", ["", "scene", "play", "time", "curve", "magnify", "speed", "nodes", "theme", "fit"])
def test_keys_work_with_any_focus(show: Show, focus: str) -> None:
    from selenium.webdriver import ActionChains, Keys

    driver = show("motion")

    def press(key: str) -> str:
        ActionChains(driver).send_keys(key).perform()
        return text(driver, "readout")

    if focus:
        driver.execute_script("el(arguments[0]).focus()", focus)
        assert driver.switch_to.active_element.get_attribute("id") == focus
    settings = "return [...document.querySelectorAll('select, #speed')].map((e) => e.value)"
    ticks = "return [[...document.querySelectorAll('input[type=checkbox]')].map((e) => e.checked), state.dark]"
    before = driver.execute_script(settings), driver.execute_script(ticks)
    assert press(Keys.END) == "t = 1 s"
    assert press(Keys.ARROW_LEFT) == "t = 0.975 s"
    assert press(Keys.HOME) == "t = 0 s"
    assert press(Keys.ARROW_RIGHT) == "t = 0.025 s"
    scale = driver.execute_script("return state.view.scale")
    press("+")
    assert driver.execute_script("return state.view.scale") == pytest.approx(1.25 * scale)
    press("0")
    assert driver.execute_script("return state.view.scale") == pytest.approx(scale)
    press(" ")
    assert text(driver, "play") == "pause"
    press(" ")
    assert text(driver, "play") == "play"
    assert (driver.execute_script(settings), driver.execute_script(ticks)) == before


def test_the_focused_control_reacts_to_enter_up_and_down(show: Show) -> None:
    from selenium.webdriver import ActionChains, Keys

    driver = show("motion")
    for name, key, asked in (("nodes", Keys.ENTER, "!el('nodes').checked"), ("theme", Keys.ENTER, "state.dark"),
                             ("curve", Keys.ARROW_UP, "state.curve === 0"), ("play", Keys.ENTER, "state.playing")):
        driver.execute_script("el(arguments[0]).focus()", name)
        ActionChains(driver).send_keys(key).perform()
        assert driver.execute_script(f"return {asked}"), name


def test_keys_step_through_modes_without_stopping_them(show: Show) -> None:
    from selenium.webdriver import ActionChains, Keys
    from selenium.webdriver.support.wait import WebDriverWait

    driver = show("modes")
    for key, mode in ((Keys.END, 2), (Keys.ARROW_RIGHT, 0), (Keys.HOME, 0)):
        ActionChains(driver).send_keys(key).perform()
        assert driver.execute_script("return state.mode") == mode
    ActionChains(driver).send_keys(" ").perform()
    WebDriverWait(driver, 20).until(lambda d: d.execute_script("return state.phase") > 0.3)


def test_play_continues_and_restarts(show: Show) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    driver = show("motion")
    driver.execute_script("go(0.9); state.speed = 8")
    driver.find_element("id", "play").click()
    WebDriverWait(driver, 20).until(lambda d: d.execute_script("return state.at < 0.8"))
    driver.execute_script("el('loop').checked = false")
    WebDriverWait(driver, 20).until(lambda d: not d.execute_script("return state.playing"))
    assert text(driver, "readout") == "t = 1 s"
    assert text(driver, "play") == "play"


def test_the_slider_and_the_curve_lead_to_their_times(show: Show) -> None:
    from selenium.webdriver import ActionChains

    driver = show("motion")
    for name in ("time", "plot"):
        driver.execute_script("go(0)")
        # at the centre
        ActionChains(driver).move_to_element(driver.find_element("id", name)).click().perform()
        assert driver.execute_script("return state.at") == pytest.approx(0.5, abs=0.06), name
        assert float(driver.execute_script("return el('time').value")) == pytest.approx(0.5, abs=0.06)


# ---------------------------------------------------------------------- layout

# elements with a text or a hand of their own that overlap each other, and what reaches beyond the page
OVERLAPS = """
const said = (e) => e.textContent || !["P", "OUTPUT"].includes(e.tagName);
const found = "h1, p, button, select, input, label, output, li, canvas, #readout, #bar span";
const shown = [...document.querySelectorAll(found)]
  .filter((e) => e.checkVisibility() && e.getBoundingClientRect().width > 0 && said(e));
const name = (e) => `${e.tagName} ${e.id}`;
const out = [];
shown.forEach((a, i) => {
  const p = a.getBoundingClientRect();
  if (p.left < -0.5 || p.right > innerWidth + 0.5) out.push(`${name(a)} leaves the page`);
  if (a.scrollWidth > a.clientWidth + 1 && a.clientWidth && a.tagName !== "SELECT") out.push(`${name(a)} is cut`);
  for (const b of shown.slice(i + 1)) {
    if (a.contains(b) || b.contains(a)) continue;
    const q = b.getBoundingClientRect();
    const w = Math.min(p.right, q.right) - Math.max(p.left, q.left);
    const h = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    if (w > 1 && h > 1) out.push(`${name(a)} and ${name(b)}: ${w} by ${h}`);
  }
});
if (document.documentElement.scrollWidth > innerWidth) out.push("the page is wider than the screen");
return out;
"""


@pytest.mark.parametrize("width", [320, 390, 800, 1400])
@pytest.mark.parametrize("name", ["motion", "static", "modes"])
def test_nothing_overlaps_at_any_width(show: Show, name: str, width: int) -> None:
    driver = show(name, width, 844)
    assert driver.execute_script(OVERLAPS) == []
    assert driver.execute_script("return stage.getBoundingClientRect().height") > 200


# numbers of an axis that overlap each other, or leave the canvas
NUMBERS = """
const texts = [];
for (const ink of [pen, plotPen]) {
  const write = ink.fillText.bind(ink);
  ink.fillText = (text, x, y) => {
    const w = ink.measureText(text).width;
    const left = { left: x, center: x - w / 2, right: x - w }[ink.textAlign];
    texts.push([ink === pen ? "scene" : "plot", text, left, y - 8, left + w, y]);
    write(text, x, y);
  };
}
draw();
return texts;
"""


@pytest.mark.parametrize("name", ["motion", "static"])
def test_axes_have_units_and_their_numbers_do_not_overlap(show: Show, name: str) -> None:
    driver = show(name, 390, 844)
    assert driver.execute_script("return stage.dataset.axes") == "x [m]; y [m]"
    wanted = {"motion": "end uy [m] over time [s]", "static": "load factor [1] over tip theta [rad]"}[name]
    assert driver.execute_script("return plot.getAttribute('aria-label')").startswith(wanted)
    written = driver.execute_script(NUMBERS)
    assert {"x [m]", "y [m]"} <= {t[1] for t in written}
    for i, (canvas, *a) in enumerate(written):
        wide, high = driver.execute_script("const b = el(arguments[0]).getBoundingClientRect(); "
                                           "return [b.width, b.height]", canvas)
        assert a[1] >= -0.5, a
        assert a[3] <= wide + 0.5, a
        assert a[4] <= high, a
        for other, *b in written[i + 1:]:
            apart = a[3] <= b[1] or b[3] <= a[1] or a[4] <= b[2] or b[4] <= a[2]
            assert canvas != other or apart, (a, b)


def luminance(color: str) -> float:
    parts = np.array([float(v) for v in color[color.index("(") + 1:-1].split(",")[:3]]) / 255
    return float(np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("dark", [False, True])
def test_texts_are_readable_in_both_colour_schemes(show: Show, dark: bool) -> None:
    driver = show("static", dark=dark)
    for turned in (False, True):
        colors = driver.execute_script("return ['body', '#about', '#value', '#play'].map((q) => { "
                                       "const s = getComputedStyle(document.querySelector(q)); let e = "
                                       "document.querySelector(q); let b = s.backgroundColor; "
                                       "while (b === 'rgba(0, 0, 0, 0)') { e = e.parentElement; "
                                       "b = getComputedStyle(e).backgroundColor; } return [s.color, b]; })")
        assert (luminance(colors[0][1]) < 0.2) == (dark != turned)
        for ink, back in colors:
            low, high = sorted((luminance(ink), luminance(back)))
            assert (high + 0.05) / (low + 0.05) > 4.5, (ink, back)
        driver.find_element("id", "theme").click()


# ---------------------------------------------------------------------- pictures


def picture(driver: Any, name: str) -> np.ndarray:
    """Return the pixels of a canvas (h, w, 3)."""
    with Image.open(io.BytesIO(driver.find_element("id", name).screenshot_as_png)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def alone(driver: Any) -> None:
    """Show only the bodies."""
    driver.execute_script("for (const n of ['reference', 'nodes', 'symbols', 'trace']) el(n).checked = false; "
                          "state.field = -1; draw()")


def mapped(driver: Any, points: str, *arguments: Any) -> list[tuple[float, float]]:
    """Return the canvas positions of points of the plane, an expression of the page."""
    found = driver.execute_script("const m = mapping(stage.clientWidth, stage.clientHeight); "
                                  f"return ({points}).map((p) => [m.X(p[0]), m.Y(p[1])])", *arguments)
    return [(x, y) for x, y in found]


def agreement(a: np.ndarray, b: np.ndarray) -> float:
    """Return the share of common points of two masks."""
    return float((a & b).sum() / (a | b).sum())


def test_bodies_are_drawn_at_their_states(show: Show, pages: dict[str, Path]) -> None:
    """The blue points of the picture are the section of the bent beam, in one piece."""
    driver = show("static")
    alone(driver)
    found = picture(driver, "scene")
    with open_results(pages["static"].with_suffix(".h5")) as results:
        faces = results.faces("beam", -1)
    boundary = np.concatenate([faces["bottom"].reshape(-1, 2), faces["top"].reshape(-1, 2)[::-1]])
    wanted = Image.new("L", (found.shape[1], found.shape[0]))
    ImageDraw.Draw(wanted).polygon(mapped(driver, "arguments[0]", boundary.tolist()), fill=1, outline=1)
    blue = found[..., 2] - found[..., 0] > 30
    assert agreement(blue, np.asarray(wanted) > 0) > 0.9
    assert ndimage.label(blue, np.ones((3, 3)))[1] == 1
    # the picture fills its place
    rows, columns = np.nonzero(blue)
    assert np.ptp(columns) > 0.6 * found.shape[1] or np.ptp(rows) > 0.6 * found.shape[0]


def test_dark_and_light_pictures_have_the_same_structure(show: Show) -> None:
    masks = []
    for dark in (False, True):
        driver = show("motion", dark=dark)
        alone(driver)
        driver.execute_script("go(0.6)")
        found = picture(driver, "scene")
        masks.append(found.max(axis=-1) - found.min(axis=-1) > 40)  # colours; grid and numbers are grey
    assert agreement(*masks) > 0.85


def test_a_trace_leads_from_the_start_to_the_state_shown(show: Show, pages: dict[str, Path]) -> None:
    driver = show("static")
    alone(driver)
    before = picture(driver, "scene")
    driver.execute_script("el('trace').checked = true; draw()")
    changed = np.abs(picture(driver, "scene") - before).sum(axis=-1) > 60
    with open_results(pages["static"].with_suffix(".h5")) as results:
        tip = results.displacement("beam", np.array([1.0]), -1)[0] + [2, 0]
    for x, y in mapped(driver, "arguments[0]", [[2, 0], tip.tolist()]):
        near = changed[max(int(y) - 4, 0):int(y) + 5, max(int(x) - 4, 0):int(x) + 5]
        assert near.any(), (x, y)


def test_colours_are_the_stress(show: Show) -> None:
    """A beam with its tip pressed down is red (in tension) above and blue below at its clamp."""
    driver = show("static")
    alone(driver)
    driver.execute_script("state.field = 0; draw()")
    found = picture(driver, "scene")
    red, blue = (found[int(y), int(x)] for x, y in mapped(driver, "[[0.06, 0.08], [0.06, -0.08]]"))
    assert red[0] > red[2] + 60
    assert blue[2] > blue[0] + 60
    assert text(driver, "barname") == "stress along the axis, σ_xx [Pa]"
    assert float(text(driver, "high")) == -float(text(driver, "low")) > 0


def test_supports_and_loads_are_drawn_in_position(show: Show, pages: dict[str, Path]) -> None:
    driver = show("static")
    alone(driver)
    before = picture(driver, "scene")
    driver.execute_script("el('symbols').checked = true; draw()")
    changed = np.abs(picture(driver, "scene") - before).sum(axis=-1) > 60
    with open_results(pages["static"].with_suffix(".h5")) as results:
        tip = results.displacement("beam", np.array([1.0]), -1)[0] + [2, 0]
    places = mapped(driver, "arguments[0]", [[0, 0], tip.tolist(), [2, -0.9]])
    spots, count = ndimage.label(ndimage.binary_dilation(changed, iterations=6))
    assert count == 3  # the clamp; the spring and the force at the tip; gravity in its corner
    for x, y in places:
        assert spots[int(y) - 3:int(y) + 4, max(int(x) - 12, 0):int(x) + 13].any(), (x, y)
    assert changed[:80, -60:].any()


def test_the_curve_is_drawn_through_its_values(show: Show) -> None:
    driver = show("motion")
    driver.execute_script("go(0)")
    found = picture(driver, "plot")
    dark = found.sum(axis=-1) < 200
    values = np.array(driver.execute_script("return Array.from(data.probes[state.curve].values)"))
    columns = [c for c in range(found.shape[1]) if dark[:, c].any()]
    heights = np.array([-np.nonzero(dark[:, c])[0].mean() for c in columns])
    wanted = np.interp(np.linspace(0, 1, len(columns)), np.linspace(0, 1, len(values)), values)
    assert np.corrcoef(heights, wanted)[0, 1] > 0.99
