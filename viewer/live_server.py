"""The live page's server: this machine alone, two addresses, reading only."""

from __future__ import annotations

import json
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from viewer.live_news import News

HERE = "127.0.0.1"  # never another interface
PATIENCE = 5.0  # [s] for a request: a client that says nothing does not hold the server
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
}


class LiveServer(ThreadingHTTPServer):
    """Answers for a drape in the making; closing it waits for its threads."""

    daemon_threads = False
    news: News  # what it answers from; given before it serves

    def __init__(self, port: int) -> None:
        """Bind the port, 0 for a free one.

        Raises:
            OSError: The port is taken or not allowed.
        """
        super().__init__((HERE, port), _Handler)
        self.hosts = {f"{name}:{self.server_port}" for name in (HERE, "localhost")}


class _Handler(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = PATIENCE
    server_version, sys_version = "drapeplan", ""

    def do_GET(self) -> None:
        """Answer `/` and `/news`, to nobody who came by another name.

        A page of another site can have its own name point to this machine; its browser
        then sends that name as the host.
        """
        if self.headers.get("Host", "").lower() not in self.server.hosts:
            return self._refuse(HTTPStatus.FORBIDDEN)
        address = urlsplit(self.path)
        if address.path == "/":
            return self._answer("text/html", self.server.news.page())
        if address.path == "/news":
            since = parse_qs(address.query).get("since", [""])[-1]
            if not (since.isascii() and since.isdecimal() and len(since) < 10):
                return self._refuse(HTTPStatus.BAD_REQUEST)
            news = self.server.news.after(int(since))
            return self._answer("application/json", json.dumps(news))
        return self._refuse(HTTPStatus.NOT_FOUND)

    def _refuse(self, status: HTTPStatus) -> None:
        self._answer("text/plain", status.phrase, status)

    def _answer(self, kind: str, text: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        body = text.encode()
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the terminal belongs to the planner."""
