"""The server of the live picture: access control and shutdown."""

import gzip
import html
import http.client
import logging
import os
import re
import resource
import signal
import socket
import stat
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import psutil
import pytest
from bokeh.server import session
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

import sweeps
from sweeps import Refused
from sweeps.explorer import server
from tests.helpers.browser import SCENE
from tests.helpers.interruptions import wait_until


@pytest.fixture(scope="module")
def explorer():
    explorer = sweeps.explore(SCENE)
    yield explorer
    explorer.close()


@contextmanager
def started(*options, **variables):
    """Start the command; yield its process and address; Ctrl-C ends it with exit code 0."""
    command = [sys.executable, "-m", "sweeps.cli", "explore", *options]
    streams = {"stdout": subprocess.PIPE, "stderr": Path("stderr.txt").open("w"), "text": True}
    with subprocess.Popen(command, env={**os.environ, **variables}, **streams) as process:
        try:
            yield process, process.stdout.readline().strip()
            process.send_signal(signal.SIGINT)
            assert process.wait(300) == 0
        finally:
            process.kill()
            streams["stderr"].close()


def answer(address, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", urlsplit(address).port, timeout=300)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    status, text = response.status, response.read().decode()
    connection.close()
    return status, text


@pytest.mark.slow
def test_only_the_address_with_its_secret_and_this_host_are_served(explorer):
    parts = urlsplit(explorer.address)
    path = f"/?{parts.query}"
    status, text = answer(explorer.address, path)
    assert status == 200
    assert 0 < text.index("is opening") < text.index("<script"), "the page is white at first"
    # No other address; the secret in the page may spell any word, but has no slash.
    assert not re.search(r"""https?://|["']//""", text)
    assert answer(explorer.address, "/")[0] == 403
    for other in (path[:-5] + "aaaaa", path + "&token=x", "/?token=", "/?bokeh-session-id=x"):
        assert answer(explorer.address, other)[0] == 403
    for host in ("evil.example", f"evil.example:{parts.port}", "127.0.0.1.evil.example"):
        assert answer(explorer.address, path, Host=host)[0] == 403
        assert answer(explorer.address, "/static/js/bokeh.min.js", Host=host)[0] == 403
    assert answer(explorer.address, path, Host=f"localhost:{parts.port}")[0] == 200
    script = re.search(r"/static/js/bokeh[^\"]*", text)[0]
    with closing(http.client.HTTPConnection(parts.netloc, timeout=300)) as connection:
        connection.request("GET", script, headers={"Accept-Encoding": "gzip"})
        packed = connection.getresponse().read()  # for a slow connection
    assert gzip.decompress(packed).decode() == answer(explorer.address, script)[1]
    sockets = psutil.Process().net_connections("tcp")
    bound = {s.laddr.ip for s in sockets if s.status == "LISTEN" and s.laddr.port == parts.port}
    assert bound == {"127.0.0.1"}


@pytest.mark.slow
def test_too_many_pages_at_once_are_refused_until_others_are_closed(monkeypatch):
    """Forty pages at once were all made, one after the other, and nobody was answered meanwhile."""
    monkeypatch.setattr(server, "MOST_PAGES", 2)
    monkeypatch.setattr(server, "_SEARCH", server._SEARCH // 20)
    now = [0.0]  # [ms]; it stands still, however long the eight take
    monkeypatch.setattr(session, "current_time", lambda: now[0])
    explorer = sweeps.explore(SCENE)
    path = f"/?{urlsplit(explorer.address).query}"
    try:
        with ThreadPoolExecutor(8) as clients:
            answers = list(clients.map(lambda _: answer(explorer.address, path), range(8)))
        assert sorted(status for status, _ in answers) == [200] * 2 + [503] * 6
        refusals = {text for status, text in answers if status == 503}
        assert refusals == {server._FULL % 2}
        assert len(explorer.pages) == 2
        now[0] = 8000.0
        wait_until(lambda: not explorer.pages, "the end of pages whose browser is gone")
        assert answer(explorer.address, path)[0] == 200
        assert len(explorer.pages) == 1
    finally:
        explorer.close()


def test_only_the_server_itself_logs_no_requests(caplog, monkeypatch):
    """The kernel of a notebook uses Tornado, too, and its messages must stay, also afterwards."""
    caplog.set_level("INFO", "tornado")  # distributed, which other tests import, silences it
    monkeypatch.setattr(logging.getLogger("tornado"), "propagate", True)
    loggers = [logging.getLogger(f"tornado.{name}") for name in ("access", "general")]
    before = [(logger.level, list(logger.filters)) for logger in loggers]
    explorer = sweeps.explore(SCENE)
    assert answer(explorer.address, "/no-such-page")[0] == 403
    for logger in loggers:
        logger.warning("of another server")
    said = [record.getMessage() for record in caplog.records]
    assert said.count("of another server") == 2
    assert not any("no-such-page" in text for text in said)
    explorer.close()
    assert [(logger.level, logger.filters) for logger in loggers] == before


@pytest.mark.slow
def test_a_false_token_is_refused_and_a_page_vanishes_without_a_word(explorer, caplog):
    parts = urlsplit(explorer.address)
    _, text = answer(explorer.address, f"/?{parts.query}")
    token = re.search(r'"token":"([^"]*)"', text)[1]
    false = ("", "x", "\xff", token[:-9], f"{token}x", token.partition(".")[0] + ".x")
    attempts = [{"Sec-WebSocket-Protocol": f"bokeh, {text}"} for text in false]
    attempts += [{"Sec-WebSocket-Protocol": f"bokeh, {token}", "Origin": "http://evil.example"}, {}]
    for headers in attempts:
        request = HTTPRequest(f"ws://{parts.netloc}/ws", headers=headers)
        with pytest.raises(HTTPClientError, match="403"):
            IOLoop(make_current=False).run_sync(partial(websocket_connect, request))
    for path in ("/", "/autoload.js", "/metadata"):
        assert answer(explorer.address, f"{path}?bokeh-token=x")[0] == 403
    right = {"Sec-WebSocket-Protocol": f"bokeh, {token}", "Origin": f"http://{parts.netloc}"}
    request = HTTPRequest(f"ws://{parts.netloc}/ws", headers=right)

    def lose():
        """Let a ping find that the browser is gone before the end of its connection is noticed."""
        (connection,) = explorer.pages[-1].document.session_context.session._subscribed_connections
        connection._socket.ws_connection.stream.close()
        connection._socket.application._keep_alive()

    async def connect_until_lost():
        connection = await websocket_connect(request)
        for _ in range(3):  # of the greeting; the server would log that it cannot send the rest
            assert await connection.read_message()
        explorer._loop.call_soon_threadsafe(lose)
        assert await connection.read_message() is None
        connection.close()

    IOLoop(make_current=False).run_sync(connect_until_lost)
    assert answer(explorer.address, "/")[0] == 403  # after the end of the connection
    assert [record for record in caplog.records if record.name != "tornado.access"] == []


ESCAPE = "%1b[2J%1b]0;X%07"
FORM = "Content-Type: application/x-www-form-urlencoded\r\nContent-Encoding: \x1b[2J\r\n"


@pytest.mark.parametrize(
    "line",
    [
        f"GET /static/..%2f{ESCAPE} HTTP/1.1\r\n",
        "GET /static/%00 HTTP/1.1\r\n",
        "GET /static/../x HTTP/1.1\r\n",
        "GET /static/js/bokeh.min.js HTTP/1.1\r\nRange: bytes=\x1b[2J\r\n",
        "GET /static/js/bokeh.min.js HTTP/1.1\r\nIf-Modified-Since: \x1b[2J\r\n",
        f"GET /{ESCAPE} HTTP/1.1\r\n",
        "\x1b[2J / HTTP/1.1\r\n",
        "GET / \x1b[2J\r\n",
        f"POST / HTTP/1.1\r\n{FORM}Content-Length: 4\r\n",
        "POST / HTTP/1.1\r\nContent-Type: multipart/form-data; boundary=\x1b[2J\r\n"
        "Content-Length: 4\r\n",
        "GET / HTTP/1.1\r\nCookie: \x1b[2J=\x1b[2J\r\nno header \x1b[2J\r\n",
    ],
)
def test_nothing_of_a_request_without_the_secret_is_logged(explorer, caplog, line):
    """Its control characters would reach the terminal."""
    port = urlsplit(explorer.address).port
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(f"{line}Host: 127.0.0.1:{port}\r\n\r\na=%1".encode("latin-1"))
        connection.shutdown(socket.SHUT_WR)
        connection.settimeout(300)
        while connection.recv(1 << 16):
            pass
    assert caplog.records == []
    assert answer(explorer.address, "/static/js/bokeh.min.js")[0] == 200


def test_who_does_not_know_the_secret_can_take_neither_memory_nor_all_connections(monkeypatch):
    """Bodies are refused before they are read, and connections without a request are closed."""
    monkeypatch.setattr(server, "_MOST_CONNECTIONS", 5)
    monkeypatch.setattr(server, "_PATIENCE", 1.0)
    explorer = sweeps.explore(SCENE)
    place = "127.0.0.1", urlsplit(explorer.address).port
    heads = [b"Content-Length: 100000000\r\n\r\n", b"Transfer-Encoding: chunked\r\n\r\n5F5E100\r\n"]
    heads += [b"Content-Length: 1000\r\n\r\n", b"Cookie: a"]  # which never end
    try:
        for head in heads:
            with socket.create_connection(place, timeout=300) as connection:
                connection.sendall(b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + head)
                assert connection.recv(1 << 16) in (b"", b"HTTP/1.1 400 Bad Request\r\n\r\n")
        idle = [socket.create_connection(place, timeout=300) for _ in range(20)]
        for connection in idle:
            with suppress(ConnectionResetError):
                assert connection.recv(1) == b""
            connection.close()
        assert answer(explorer.address, "/static/js/bokeh.min.js")[0] == 200
    finally:
        explorer.close()


#: Replaces the browser: it waits while the test reads the list of processes.
BROWSER = """\
import os, sys, time
open("new", "w").write(sys.argv[1])
os.rename("new", "opened")
while os.path.exists("opened"):
    time.sleep(0.1)
"""


@pytest.mark.slow
def test_a_process_hides_its_address_and_goes_on_after_others_took_its_descriptors():
    """The browser gets a private file, which redirects to the address and is then removed."""
    Path("browser.py").write_text(BROWSER)
    opened = Path("opened")
    options = ("--set", "record.transient=auto")
    with started(*options, BROWSER=f"{sys.executable} browser.py %s &") as (process, address):
        parts = urlsplit(address)
        wait_until(lambda: opened.exists() or process.poll() is not None, "the browser")
        seen = [" ".join(p.info["cmdline"] or ()) for p in psutil.process_iter(["cmdline"])]
        given = opened.read_text()
        opened.unlink()
        assert any(given in arguments for arguments in seen)
        assert not any(address.rpartition("=")[2] in arguments for arguments in seen)
        page = Path(urlsplit(given).path)
        assert stat.S_IMODE(page.stat().st_mode) == 0o600
        assert stat.S_IMODE(page.parent.stat().st_mode) == 0o700
        assert f"url={address}" in html.unescape(page.read_text())

        assert answer(address, f"/?{parts.query}")[0] == 200
        left = psutil.Process(process.pid).num_fds() + 5
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (left, left))
        taken = [socket.create_connection((parts.hostname, parts.port)) for _ in range(8)]
        time.sleep(0.5)
        for connection in taken:
            connection.close()
        assert answer(address, f"/?{parts.query}")[0] == 200
    assert not page.parent.exists()
    (note,) = Path("stderr.txt").read_text().splitlines()
    assert note.startswith("transient: auto is left out here")


def test_a_notebook_shows_the_page_itself(explorer):
    text = explorer._repr_html_()
    assert text.startswith("<iframe")
    assert explorer.address in text


def test_a_port_in_use_is_refused(explorer):
    port = urlsplit(explorer.address).port
    with pytest.raises(Refused, match=f"the port {port} cannot be used .*in use"):
        sweeps.explore(SCENE, port)
