"""The page as served, and as run by a browser."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import subprocess
import threading
import urllib.error
import urllib.request
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import HEADER, coordinates, mechanism, tangent_body
from test_view_page import CASES, embedded

import ancf2d.view as page_module
from ancf2d.errors import ResultsError
from ancf2d.results import ResultWriter, open_results
from ancf2d.study.run import load, run_case
from ancf2d.view import make_page, serve

BROWSER = next((b for b in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if b), None)


def test_the_page_is_served_only_on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    servers: list[ThreadingHTTPServer] = []
    monkeypatch.setattr(page_module, "ThreadingHTTPServer",
                        lambda *a: servers.append(ThreadingHTTPServer(*a)) or servers[-1])
    addresses, ready = [], threading.Event()
    thread = threading.Thread(target=serve, args=("<p>ä</p>", 0, lambda a: (addresses.append(a), ready.set())))
    thread.start()
    assert ready.wait(5)
    try:
        with urllib.request.urlopen(addresses[0], timeout=5) as answer:
            assert answer.read().decode() == "<p>ä</p>"
        with pytest.raises(urllib.error.HTTPError, match="404") as caught:
            urllib.request.urlopen(addresses[0] + "other", timeout=5)
        caught.value.close()
        assert servers[0].server_address[0] == "127.0.0.1"
        port = servers[0].server_port
        for host, status in ((f"localhost:{port}", 200), ("localhost", 200), (f"LOCALHOST:{port}", 200),
                             (f"127.0.0.1:{port}", 200), (f"evil.example:{port}", 421), ("", 421), ("[", 421),
                             (f"127.0.0.1.evil.example:{port}", 421), (f"evil.example@127.0.0.1:{port}", 421)):
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            connection.request("GET", "/", headers={"Host": host})
            answer = connection.getresponse()
            assert (answer.status, b"<p>" in answer.read()) == (status, status == 200), host
            connection.close()
        with pytest.raises(ResultsError, match=r"cannot serve on port \d+.*--port"):
            serve("", servers[0].server_port, print)
    finally:
        servers[0].shutdown()
        thread.join(5)


PROBE = """<script>
const seen = {};
window.addEventListener("error", (e) => { document.title = "ERROR " + e.message; });
try {
  BODY
  document.title = "SEEN " + JSON.stringify(seen);
} catch (e) { document.title = "ERROR " + e; }
</script>"""


def in_browser(html: str, script: str, folder: Path) -> dict[str, Any]:
    """Run a script at the end of a page in a headless browser; return its ``seen``."""
    page = folder / "page.html"
    page.write_text(html.replace("</body>", PROBE.replace("BODY", script) + "</body>"), encoding="utf-8")
    command = [str(BROWSER), "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}",
               "--window-size=1000,700", "--virtual-time-budget=500", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    (title,) = re.findall(r"<title>(.*?)</title>", done.stdout, re.S)
    assert title.startswith("SEEN "), title + done.stderr[-500:]
    return json.loads(title[5:].replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">"))


@pytest.mark.skipif(BROWSER is None, reason="no browser is installed")
def test_a_browser_shows_the_states_at_their_times(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        html = make_page(results).html
        middle = 0.5 * (results.faces("rod", 20)["top"] + results.faces("rod", 21)["top"]).reshape(-1, 2)
    seen = in_browser(html, """
      go(0.5125);
      seen.ready = document.documentElement.dataset.ready;
      seen.readout = el("readout").textContent;
      seen.value = el("value").textContent;
      seen.points = Array.from(points);
      const ink = pen.getImageData(0, 0, stage.width, stage.height).data;
      seen.painted = ink.some((v) => v > 0);
      step(1);
      seen.next = el("readout").textContent;
      const scale = state.view.scale;
      zoom(2, 400, 300);
      seen.zoom = state.view.scale / scale;
      theme(true);
      seen.dark = getComputedStyle(document.body).backgroundColor;
      play(true);
      seen.playing = el("play").textContent;
    """, tmp_path)
    assert seen["ready"] == "yes"
    assert seen["readout"] == "t = 0.5125 s"
    assert seen["next"] == "t = 0.525 s"
    assert seen["painted"]
    assert seen["zoom"] == pytest.approx(2)
    assert (seen["dark"], seen["playing"]) == ("rgb(18, 22, 28)", "pause")
    data = embedded(html)
    rod = data["bodies"][1]
    first = rod["first"] + rod["elements"] * rod["samples"]
    drawn = np.array(seen["points"]).reshape(-1, 2)[first:first + len(middle)]
    np.testing.assert_allclose(drawn, middle, atol=1e-3)


@pytest.mark.skipif(BROWSER is None, reason="no browser is installed")
def test_a_browser_swings_modes_and_follows_a_path_that_turns_back(tmp_path: Path) -> None:
    run_case(load(CASES / "paper" / "table3_2d2n.yaml", ["solver.modes=3"]), str(tmp_path / "m.h5"))
    with open_results(tmp_path / "m.h5") as results:
        modal = make_page(results).html
    seen = in_browser(modal, """
      choose(1); state.phase = 0; draw(); const out = Array.from(points);
      state.phase = Math.PI / 2; draw(); seen.rest = Math.max(...points.map((p, i) => Math.abs(p - reference[i])));
      seen.out = Math.max(...out.map((p, i) => Math.abs(p - reference[i])));
      seen.readout = el("readout").textContent; seen.side = el("side").hidden;
    """, tmp_path)
    assert seen["out"] > 1e3 * seen["rest"]
    assert seen["readout"].startswith("axial 1: 279.053 rad/s")
    assert seen["side"]
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(tmp_path / "p.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        for factor, u in ((0.0, 0.0), (2.0, 0.1), (1.0, 0.2), (3.0, 0.3)):
            w.append(factor, e0 * u, None, {"p": {"uy": u}})
        w.finish({})
    with open_results(tmp_path / "p.h5") as results:
        path = make_page(results).html
    seen = in_browser(path, """
      go(2); seen.readout = el("readout").textContent; seen.value = el("value").textContent;
      go(3); seen.end = el("readout").textContent; seen.last = el("value").textContent;
    """, tmp_path)
    assert (seen["readout"], seen["value"]) == ("load factor 1", "p uy = 0.2 m")
    assert (seen["end"], seen["last"]) == ("load factor 3", "p uy = 0.3 m")
