"""The command line on clusters: local processes, schedulers, certificates."""

import asyncio
import gc
import logging
import os
import queue
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import dask
import psutil
import pytest
from distributed import LocalCluster
from distributed.core import Server
from distributed.security import Security

from sweeps import interrupts, run_sweep
from sweeps.engine import cluster as clusters
from sweeps.engine.cluster import check_address
from tests.helpers.clusters import CLUSTERED as CONFIG
from tests.helpers.clusters import assert_same_bits, refused_run
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.interruptions import hear, wait_until
from tests.helpers.places import ROOT

pytestmark = [pytest.mark.cluster, pytest.mark.slow]


def command(*arguments):
    """Start the command line like a terminal, in a separate process group."""
    words = [sys.executable, "-m", "sweeps.cli", "run", "sweep.yaml", "-o", "out.h5", *arguments]
    how = {"env": {"PYTHONPATH": str(ROOT), "PATH": ""}, "start_new_session": True}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(words, preexec_fn=hear, **how, **streams)


def test_no_other_user_reaches_the_processes_of_this_machine(capfd):
    """Every listening port requires the certificate of the run, or serves nothing."""
    others = listening()
    with clusters.connected("local:1") as client:
        run_sweep(load(CONFIG), "there.h5", client=client)
        address = client.scheduler.address
        (worker,) = client.nthreads()
        ports = listening() - others
        trusted = client.security.get_connection_args("client")["ssl_context"]
        assert {host for host, _ in ports} == {"127.0.0.1"}
        encrypted = {place for place in ports if not answers_http(*place)}
        assert all(answers_tls(*place, trusted) for place in encrypted)
        assert {tuple(a.removeprefix("tls://").split(":")) for a in (address, worker)} <= {
            (host, str(port)) for host, port in encrypted
        }
        for host, port in encrypted:
            assert not answers_tls(host, port, ssl._create_unverified_context())
            assert "no Dask scheduler answers" in refused_run("--dask", f"tcp://{host}:{port}")
        for host, port in ports - encrypted:
            for path in ("/", "/status", "/info/main/workers.html", "/json/identity.json"):
                with pytest.raises(urllib.error.HTTPError, match="404"):
                    urllib.request.urlopen(f"http://{host}:{port}{path}", timeout=300)
    assert capfd.readouterr() == ("", "")  # of the worker, too
    assert_same_bits("there.h5")


def listening():
    """Return host and port of every server of this process and its children."""
    me = psutil.Process()
    processes = [me, *me.children(recursive=True)]
    places = [one for process in processes for one in process.net_connections("tcp")]
    return {one.laddr[:2] for one in places if one.status == psutil.CONN_LISTEN}


def answers_http(host, port):
    """Whether a server answers a request without TLS, which another one ends at once."""
    try:
        urllib.request.urlopen(f"http://{host}:{port}/", timeout=300)
    except OSError as error:
        return isinstance(error, urllib.error.HTTPError)
    return True


def answers_tls(host, port, context):
    """Whether a server completes the handshake and accepts the certificate of the client."""
    try:
        with (
            socket.create_connection((host, port), timeout=300) as plain,
            context.wrap_socket(plain, server_hostname=None) as encrypted,
        ):
            return len(encrypted.recv(1)) == 1  # Dask's servers speak first
    except OSError:  # among them ssl.SSLError
        return False


@pytest.fixture
def certificates(tmp_path_factory):
    """Return Dask's settings for a certificate in files, as for a cluster of a group."""
    temporary = Security.temporary()
    files = {"ca-file": temporary.tls_ca_file, "cert": temporary.tls_scheduler_cert}
    files["key"] = temporary.tls_scheduler_key
    folder = tmp_path_factory.mktemp("certificates")
    for name, text in files.items():
        (folder / name).write_text(text)
    settings = {"ca-file": "ca-file"}
    for role in ("scheduler", "worker", "client"):
        settings |= {f"{role}.cert": "cert", f"{role}.key": "key"}
    return {f"distributed.comm.tls.{key}": str(folder / name) for key, name in settings.items()}


def test_a_cluster_with_certificates_of_dasks_own_configuration(certificates):
    options = {"processes": False, "n_workers": 1, "threads_per_worker": 1}
    with dask.config.set(certificates):
        security = Security(require_encryption=True)
        places = {"host": "127.0.0.1", "dashboard_address": ":0"}
        with LocalCluster(**options, **places, security=security) as cluster:
            address = cluster.scheduler_address
            assert address.startswith("tls://")
            result = call("run", "sweep.yaml", "-o", "out.h5", "--dask", address, "--quiet")
            assert result.exit_code == 0, result.stderr
            assert_same_bits("out.h5")
            Path("out.h5").unlink()
            with dask.config.set(dict.fromkeys(certificates)):
                message = refused_run("--dask", address)
    assert f"no Dask scheduler answers at {address} (" in message
    assert "distributed.comm.tls in Dask's configuration" in message


@pytest.mark.parametrize("answer", [None, {"op": "nonsense"}])
def test_a_scheduler_that_answers_and_never_registers(monkeypatch, answer):
    class Imposter(Server):
        def __init__(self):
            super().__init__({"identity": self.identify, "register-client": self.register})

        def identify(self, **_):
            monkeypatch.setattr(clusters, "_PATIENCE", 1)
            return {"type": "Scheduler", "id": "x", "address": self.address}

        async def register(self, comm, **_):
            if answer:
                await comm.write([answer])
            await asyncio.sleep(100)

    async def serve():
        server = Imposter()
        await server.listen("tcp://127.0.0.1:0")
        addresses.put(server.address)
        await asyncio.sleep(100)

    addresses = queue.SimpleQueue()
    threading.Thread(target=asyncio.run, args=[serve()], daemon=True).start()
    monkeypatch.setattr(clusters, "_PATIENCE", 300)
    message = refused_run("--dask", addresses.get(timeout=300))
    assert "answers, but does not accept this process" in message
    gc.collect()  # a client that was thrown away says nothing (pytest would)


def test_an_interrupt_ends_the_processes_in_the_middle_of_a_long_block():
    undamped = ["--set", "oscillator.h=0", "--set", "oscillator.R=1"]  # it does not come back
    endless = ["--set", "record.transient=5e8", "--set", "oscillator.omega.num=2", *undamped]
    process = command("--dask", "local:1", "--quiet", *endless)
    wait_until(Path("out.h5.parts/schema.h5").exists, "a run that computes")
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 1
    said = "vibroimpact: error: interrupted; 0 of 2 points kept in out.h5.parts; "
    assert stderr.startswith(said)
    assert stderr.count("\n") == 1
    with pytest.raises(ProcessLookupError):  # none of the group is left
        for _ in range(3000):
            os.killpg(process.pid, 0)
            time.sleep(0.1)


@pytest.mark.parametrize(
    ("addresses", "told"),
    [
        (["local:0", "local:x", "local:1000000"], "local:N with an integer N from 1 to "),
        (["", "nonsense", "tcp://host", "tcp://host:65536", "http://host:1"], "tcp://HOST:PORT "),
        (["local:" + "1" * 5000], "local:N with an integer N from 1 to "),
        (["tcp://host:" + "1" * 5000], "tcp://HOST:PORT "),
        (["host:8786"], "did you mean tcp://host:8786?"),
    ],
)
def test_an_address_that_is_none_is_refused_without_dask(monkeypatch, addresses, told):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for address in addresses:
        message = refused_run("--dask", address)
        assert message.startswith(f"vibroimpact: error: --dask {address[:40]}")
        assert " is not allowed; expected: " in message and told in message and len(message) < 600


@pytest.mark.parametrize("address", ["local:1", "tcp://10.0.0.1:8786", "tls://[::1]:8786"])
def test_an_address(address):
    check_address(address)


def test_the_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = refused_run("--dask", "local:1")
    assert "pip install 'vibroimpact[distributed]'" in message
    assert "pip install '.[distributed]'" in message


def test_loggers_are_silent_no_longer_than_needed():
    heard = [logging.getLogger("distributed.client").isEnabledFor(logging.CRITICAL)]
    with clusters._quiet():
        heard += [logging.getLogger("distributed.new").isEnabledFor(logging.CRITICAL)]
    heard += [logging.getLogger("distributed.client").isEnabledFor(logging.CRITICAL)]
    assert heard == [True, False, True]


@pytest.mark.parametrize("listens", [False, True])
def test_where_no_scheduler_answers(monkeypatch, listens):
    assert clusters._PATIENCE < 10
    monkeypatch.setattr(clusters, "_PATIENCE", 1)
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        if listens:
            server.listen()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        told = f"no Dask scheduler answers at {address} (no answer in 1 s); start one"
        assert told in refused_run("--dask", address)


def test_an_interrupt_ends_the_wait_for_a_scheduler_that_is_silent(monkeypatch, handlers):
    monkeypatch.setattr(clusters, "_PATIENCE", 20)
    connections = queue.SimpleQueue()
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()

        def interrupt():
            connections.put(server.accept()[0])
            os.kill(os.getpid(), signal.SIGINT)

        thread = threading.Thread(target=interrupt)
        thread.start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        try:
            with pytest.raises(interrupts.Cancelled), clusters.connected(address):
                pass
        finally:
            thread.join()
            connections.get().close()
            gc.collect()
