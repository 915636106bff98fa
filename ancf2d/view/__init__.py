"""Interactive pages from result files alone, and the server that shows them.

A page has markup, style, script and data in a single text.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files

from ancf2d.errors import ResultsError
from ancf2d.results import Results
from ancf2d.results.target import MARK
from ancf2d.view.scene import LARGEST_CODE, scene

__all__ = ["Page", "make_page", "serve"]

SCRIPTS = "scene.js", "layers.js", "controls.js"


@dataclass(frozen=True)
class Page:
    """A page, and a remark about the data that it leaves out."""

    html: str
    remark: str


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def make_page(results: Results, fields: Sequence[str] = ()) -> Page:
    """Return the page of a result file. Raises ResultsError.

    ``fields`` names the fields to show, by default all that the results have.
    """
    data = scene(results, fields)
    # so that a tag within the data, such as </script> in a title, has no effect
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    script = "".join(map(_part, SCRIPTS))
    title = escape(data["title"], quote=False)
    parts = {"TITLE": title, "MARK": MARK, "STYLE": _part("page.css"), "SCRIPT": script, "DATA": text}
    # all in one pass, since inserted text may look like a placeholder itself
    html = re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _part("page.html"))
    shown, what = len(data["t"]), "mode" if data["kind"] == "modes" else "state"
    some = f"{shown} of {data['stored']} {what}s" if shown < data["stored"] else (
        f"all {shown} {what}s" if shown > 1 else f"its only {what}")
    return Page(html, f"{some}, displacements to 1/{LARGEST_CODE} of the largest")


ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")


class _Handler(BaseHTTPRequestHandler):
    page = b""

    def do_GET(self) -> None:
        """Answer with the page at the root of this machine's own names, and with an error elsewhere."""
        # rejects pages of other hosts whose name resolves to this machine (DNS rebinding)
        host = self.headers.get("Host", "").partition(":")[0].lower()
        found = self.path.split("?")[0] == "/" and host in NAMES
        body = self.page if found else b"not here"
        self.send_response(200 if found else 404 if host in NAMES else 421)
        self.send_header("Content-Type", "text/html; charset=utf-8" if found else "text/plain")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing about requests."""


def serve(html: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve a page on localhost until interrupted; ``ready`` is called with its address.

    ``port`` 0 takes a free one. Raises ResultsError if the port is in use.
    """
    handler = type("Handler", (_Handler,), {"page": html.encode()})
    try:
        server = ThreadingHTTPServer((ADDRESS, port), handler)
    except (OSError, OverflowError) as error:
        raise ResultsError(f"cannot serve on port {port}: {getattr(error, 'strerror', None) or error}; "
                           "choose another with --port, or --port 0 for a free one") from error
    with server:
        ready(f"http://{ADDRESS}:{server.server_port}/")
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            return
