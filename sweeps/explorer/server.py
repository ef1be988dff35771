"""The server of the page, for users of this machine with the secret address."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import hashlib
import logging
import re
import secrets
import socket
import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from bokeh.document import Document
from bokeh.resources import Resources
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.views.doc_handler import DocHandler
from bokeh.server.views.static_handler import StaticHandler
from bokeh.server.views.ws import WSHandler
from bokeh.util.token import check_token_signature
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.iostream import IOStream
from tornado.web import ErrorHandler, GZipContentEncoding, OutputTransform

from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.explorer.live_page import SECRET, LivePage
from sweeps.explorer.view import View
from sweeps.store.replacing import absolute

HOST = "127.0.0.1"
#: Allowed names in the Host header; another name shows that a foreign page was redirected here.
_OWN_NAMES = (HOST, "localhost")
#: Limits what a page may do in the browser; for example, a script in one of its texts does not run.
#: Bokeh compiles functions from text and sets styles, which needs the two ``unsafe`` exceptions.
_POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src 'self' data: blob:; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-eval'{hashes}; "
    "connect-src 'self' {sockets}"
)
_SCRIPT = re.compile(rb"<script(?: type=\"text/javascript\")?>(.*?)</script>", re.DOTALL)
#: The paths of Bokeh's own files; for another, such as one with escapes, Tornado logs a warning.
_STATIC = re.compile(r"/static(?:/[\w-][\w.-]*)+", re.ASCII)
#: Loggers that quote requests, which may hold control characters: silent in our thread.
_QUOTING = ("tornado.access", "tornado.general")
#: Most open pages: to make one takes .2 to .4 s, during which the server answers nobody, and a page
#: whose browser is not answered for 5 s is made again.
MOST_PAGES = 10
_FULL = (
    "%d pages of vibroimpact explore are open, and more would slow them down. Close one, and load "
    "this page again after ten seconds."
)
#: Time after which a page without a browser is closed, and time between two searches for such [ms].
_UNUSED, _SEARCH = 5000, 2000
#: Most connections that are no open page, and most bytes of the body of a request: before they are
#: read, nobody knows whether it has the secret. A page sends only requests without a body.
_MOST_CONNECTIONS, _MOST_BODY = 100, 1 << 12
#: Time for the head of a request, also from the one before, and for its body [s].
_PATIENCE = 20.0
#: Pause before new connections are accepted when no file descriptors are left [s].
_PAUSE = 1.0
#: Time during which a page may reconnect [s]: ten years.
_FOREVER = 10 * 365 * 86400


class _Policy(OutputTransform):
    """Adds the policy to every response; it allows the scripts of Bokeh's page by their hashes."""

    def __init__(self, hosts: Sequence[str], request: HTTPServerRequest) -> None:
        self._sockets = " ".join(f"ws://{host}" for host in hosts)

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        digests = (hashlib.sha256(script).digest() for script in _SCRIPT.findall(chunk))
        hashes = "".join(f" 'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
        policy = _POLICY.format(hashes=hashes, sockets=self._sockets)
        headers["Content-Security-Policy"] = policy
        return status_code, headers, chunk


class _Page(DocHandler):
    """Opens a page, unless too many are open."""

    async def get(self, *arguments: Any, **options: Any) -> None:
        if len(self.application.get_sessions("/")) < MOST_PAGES:
            await super().get(*arguments, **options)
        else:
            self.set_status(503)
            self.finish(_FULL % MOST_PAGES)


class _Connection(WSHandler):
    """Sends no ping while it closes: Bokeh would detach the page before it notices the end."""

    def ping(self, data: str | bytes = b"") -> None:
        if self.ws_connection is None or not self.ws_connection.is_closing():
            super().ping(data)


class _Application(BokehTornado):
    """Serves pages to whoever knows the secret address, and the requests of these pages."""

    def __init__(self, *arguments: Any, secret: str, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._secret = secret

    def resources(self, absolute_url: str | bool | None = None) -> Resources:
        """Return the scripts of a page, always served from here, whatever the settings of Bokeh."""
        version = StaticHandler.append_version
        scripts = ["bokeh", "bokeh-widgets"]
        return Resources("server", root_url="/", path_versioner=version, components=scripts)

    def find_handler(self, request: HTTPServerRequest, **options: Any) -> Any:
        """Refuse a foreign request here, because Bokeh logs a traceback for some of them."""
        if not self._is_own(request):
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": 403})
        delegate = super().find_handler(request, **options)
        handler = delegate.handler_class
        delegate.handler_class = {DocHandler: _Page, WSHandler: _Connection}.get(handler, handler)
        return delegate

    def _is_own(self, request: HTTPServerRequest) -> bool:
        """Whether a request addresses this machine, comes from our own page and has the secret."""
        page = f"http://{request.host}"
        if request.host_name not in _OWN_NAMES or request.headers.get("Origin", page) != page:
            return False
        if request.path.startswith("/static/"):
            return _STATIC.fullmatch(request.path) is not None
        if request.path == "/":
            (secret, *others) = request.query_arguments.get(SECRET, [b""])
            return not others and secrets.compare_digest(secret, self._secret.encode())
        if request.path != "/ws":
            return False  # a page needs nothing else
        token = request.headers.get("Sec-WebSocket-Protocol", "").rpartition(",")[2].strip()
        try:
            return check_token_signature(token, self.secret_key, signed=True)
        except Exception:  # a malformed token can raise any error
            return False


class _Server(HTTPServer):
    """Closes connections beyond the most that it keeps."""

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        if len(self._connections) < _MOST_CONNECTIONS:
            super().handle_stream(stream, address)
        else:
            stream.close()


class Explorer:
    """A running server, from `sweeps.explore`; Jupyter shows it as the page itself.

    Attributes
    ----------
    address : str
        The address of the page, with a secret. Each time it is opened it shows a separate page.
    pages : list of LivePage
        The open pages, at most ``MOST_PAGES``. A closed one is removed within ten seconds.
    """

    def __init__(self, config: SweepConfig, port: int, folder: Path | None) -> None:
        self._home, self._folder = View.of(config).checked(), folder or absolute(Path())
        try:
            self._socket = socket.create_server((HOST, port))
        except OSError as error:
            raise Refused(
                f"the port {port} cannot be used ({error.strerror}); expected: a free port, or "
                "none for any"
            ) from None
        self._socket.setblocking(False)
        self._port, self.pages = self._socket.getsockname()[1], list[LivePage]()
        self._secret = secrets.token_urlsafe(32)
        self.address = f"http://{HOST}:{self._port}/?{SECRET}={self._secret}"
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(self._handle_failure)
        # A request that arrives before the thread is ready waits in the socket.
        self._thread = threading.Thread(target=self._serve, daemon=True)
        for logger in _QUOTING:
            logging.getLogger(logger).addFilter(self._is_foreign)
        self._thread.start()

    def _is_foreign(self, record: logging.LogRecord) -> bool:
        """Whether another thread logs, as the kernel of a notebook, which uses Tornado, too."""
        return record.thread != self._thread.ident

    def _serve(self) -> None:
        """Run the server until its loop is stopped."""
        asyncio.set_event_loop(self._loop)
        loop = IOLoop.current()
        hosts = [f"{name}:{self._port}" for name in _OWN_NAMES]
        application = _Application(
            self._open,
            transforms=[partial(_Policy, hosts), GZipContentEncoding],
            websocket_compression_level=1,  # a map becomes a tenth
            extra_websocket_origins=hosts,
            secret=self._secret,
            secret_key=secrets.token_bytes(32),
            sign_sessions=True,
            session_token_expiration=_FOREVER,
            unused_session_lifetime_milliseconds=_UNUSED,
            check_unused_sessions_milliseconds=_SEARCH,
        )
        http = _Server(
            application,
            max_body_size=_MOST_BODY,
            idle_connection_timeout=_PATIENCE,
            body_timeout=_PATIENCE,
        )
        http.add_socket(self._socket)
        server = BaseServer(loop, application, http)
        server.start()
        loop.start()
        server.stop(wait=False)
        loop.run_sync(http.close_all_connections)
        loop.close(all_fds=True)  # also the sockets of open pages, which `http` does not know

    def _handle_failure(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Pause new connections when no file descriptors are left; log any other error."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            server = IOLoop.current()
            server.update_handler(self._socket, 0)
            server.call_later(_PAUSE, server.update_handler, self._socket, IOLoop.READ)
        else:
            loop.default_exception_handler(context)

    def _open(self, document: Document) -> None:
        page = LivePage(document, self._home, self._folder)
        self.pages.append(page)
        document.on_session_destroyed(lambda _: self.pages.remove(page))

    def close(self) -> None:
        """Stop the server; open pages show a message."""
        with contextlib.suppress(RuntimeError):  # closed before
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2.0)
        for page in self.pages:
            page.worker.shutdown()
        for logger in _QUOTING:
            logging.getLogger(logger).removeFilter(self._is_foreign)

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.address}" width="100%" height="640" frameborder="0"></iframe>'

    def __repr__(self) -> str:
        return f"Explorer at {self.address}"
