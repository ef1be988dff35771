"""The server of the page: on this machine alone, for whoever has the signed address."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import threading
from pathlib import Path

from bokeh.document import Document
from bokeh.resources import Resources
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.views.static_handler import StaticHandler
from bokeh.util.token import generate_session_id
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.web import HTTPError, RequestHandler

from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.explore.page import Page
from sweeps.explore.view import View

HOST = "127.0.0.1"
#: Names of this machine in the Host header; another name is that of a page that was led here.
_OWN_NAMES = r"(?:127\.0\.0\.1|localhost)"


class _Foreign(RequestHandler):
    """Answers requests with a foreign Host header."""

    def prepare(self) -> None:
        raise HTTPError(403, reason=f"this page is at {HOST} only")


class _Application(BokehTornado):
    """Sends the page the scripts that it needs, from here whatever Bokeh is set to."""

    def resources(self, absolute_url: str | bool | None = None) -> Resources:
        version = StaticHandler.append_version
        scripts = ["bokeh", "bokeh-widgets"]
        return Resources("server", root_url="/", path_versioner=version, components=scripts)


class Explorer:
    """A running server; in Jupyter it is shown as the page itself.

    Parameters
    ----------
    config : SweepConfig
    port : int
        0 for any that is free.
    folder : Path, optional
        Where configurations are saved, by default the present one.

    Attributes
    ----------
    address : str
        Of the page, with the signed session.
    pages : list of Page
        Those that were opened.

    Raises
    ------
    Refused
        If the port is in use.
    """

    def __init__(self, config: SweepConfig, port: int = 0, folder: Path | None = None) -> None:
        self._home, self._folder = View.of(config), folder or Path.cwd()
        self._home.check()
        try:
            self._socket = socket.create_server((HOST, port))
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise Refused(
                f"--port {port} cannot be used ({reason}); expected: a free port, or none for any"
            ) from None
        self._socket.setblocking(False)
        self._port, self.pages = self._socket.getsockname()[1], list[Page]()
        self._key = secrets.token_bytes(32)
        self.address = self.new_address()
        self._loop: IOLoop | None = None
        started = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(started,), daemon=True)
        self._thread.start()
        started.wait()

    def new_address(self) -> str:
        """Return an address with a session of its own: windows of one session show the same."""
        session = generate_session_id(self._key, signed=True)
        return f"http://{HOST}:{self._port}/?bokeh-session-id={session}"

    def _serve(self, started: threading.Event) -> None:
        """Run the server until its loop is stopped."""
        asyncio.set_event_loop(asyncio.new_event_loop())
        self._loop = IOLoop.current()
        application = _Application(
            self._open,
            extra_websocket_origins=[f"{HOST}:{self._port}", f"localhost:{self._port}"],
            secret_key=self._key,
            sign_sessions=True,
            generate_session_ids=False,
            unused_session_lifetime_milliseconds=5000,
            check_unused_sessions_milliseconds=2000,
        )
        application.add_handlers(rf"(?!{_OWN_NAMES}$).*", [(r".*", _Foreign)])
        http = HTTPServer(application)
        http.add_socket(self._socket)
        server = BaseServer(self._loop, application, http)
        server.start()
        self._loop.add_callback(started.set)
        self._loop.start()
        server.stop(wait=False)
        self._loop.run_sync(http.close_all_connections)

    def _open(self, document: Document) -> None:
        self.pages.append(Page(document, self._home, self._folder))

    def close(self) -> None:
        """End the server; open pages say so."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):
                self._loop.add_callback(self._loop.stop)
            self._thread.join(2.0)
            self._loop = None
        for page in self.pages:
            page.worker.close()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.address}" width="100%" height="640" frameborder="0"></iframe>'

    def __repr__(self) -> str:
        return f"Explorer at {self.address}"
