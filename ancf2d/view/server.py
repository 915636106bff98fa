"""A page on this machine's own address, until it is interrupted."""

from __future__ import annotations

from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from ancf2d.errors import ResultsError

ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")


class _Handler(BaseHTTPRequestHandler):
    page = b""

    def do_GET(self) -> None:
        """Answer with the page at the root of this machine's own names, with nothing elsewhere."""
        # a page of another host, whose name was made to lead here, may not read this one
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
        """Say nothing of requests."""


def serve(html: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve a page on localhost until interrupted; ``ready`` is called with its address.

    ``port`` 0 takes a free one. Raises ResultsError where the port is taken.
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
