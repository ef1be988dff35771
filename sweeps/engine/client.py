"""A Dask client for a typed address."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING

import psutil

from sweeps.errors import Refused
from sweeps.interrupts import SIGNALS, check, raised_at_once
from sweeps.text import shortened

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

#: Longest wait for the answer of a scheduler [s].
_PATIENCE = 6
#: The loggers that are silent while a cluster is used, with those below them.
_LOGGERS = ("asyncio", "dask", "distributed", "tornado")

_ALLOWED = "tcp://HOST:PORT or tls://HOST:PORT of a Dask scheduler, or local:N for N processes here"
_SCHEDULER = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})")


def check_address(address: str) -> None:
    """Refuse an address that `connected` does not accept, before it imports or starts anything."""
    if address.startswith("local:"):
        cores = os.cpu_count() or 1
        number = address.removeprefix("local:")
        if not (number.isascii() and number.isdecimal() and 1 <= int(number) <= cores):
            raise Refused(
                f"the address {address} is not allowed; expected: local:N with an integer N from "
                f"1 to {cores}"
            )
        return
    match = _SCHEDULER.fullmatch(address)
    if not match or not 1 <= int(match[3]) <= 65535:
        meant = (
            f"; did you mean tcp://{address}?" if _SCHEDULER.fullmatch("tcp://" + address) else ""
        )
        raise Refused(f"the address {address!r} is not allowed; expected: {_ALLOWED}{meant}")


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Yield a client of the cluster at an address, and silence the loggers of Dask meanwhile.

    `check_address` must have accepted the address. It is ``tcp://host:port`` for a scheduler,
    ``tls://host:port`` for a scheduler that requires the certificates of Dask's own configuration,
    or ``local:N``, which starts N processes with one thread each on this machine and ends them;
    other users cannot reach them. Raises Refused if Dask is not installed or no scheduler accepts
    the connection.
    """
    try:
        import distributed
    except ImportError:
        raise Refused(
            "a cluster needs Dask, which is not installed; install it with pip install "
            "'vibroimpact[distributed]', or in a clone pip install '.[distributed]'"
        ) from None
    with _quiet():
        if address.startswith("local:"):
            with _processes(int(address.removeprefix("local:"))) as cluster:
                with distributed.Client(
                    cluster, direct_to_workers=True, set_as_default=False
                ) as client:
                    yield client
            return
        _refuse_silence(address)
        with raised_at_once():  # Dask checks no flag while it waits for an answer
            registered = _registered(address)
        with registered as client:
            yield client


def _registered(address: str) -> Client:
    """Return a client that a scheduler has accepted."""
    import distributed

    class Client(distributed.Client):
        def __del__(self) -> None:
            """Skip Dask's wait for a scheduler that refused it; ``with`` closes all others."""

    try:
        return Client(address, timeout=_PATIENCE, set_as_default=False)
    except Exception as error:  # any program may answer at the address
        reason = shortened(str(error)) or f"no answer in {_PATIENCE} s"
        raise Refused(
            f"the Dask scheduler at {address} answers, but does not accept this process "
            f"({reason}); check its log, and whether it has the same version of Dask"
        ) from None


def _refuse_silence(address: str) -> None:
    """Refuse an address where no scheduler answers in time.

    A client alone would wait forever for a program that listens but does not answer.
    """
    from distributed import Security, rpc

    async def kind() -> str:
        """Ask the server at the address for its type."""
        arguments = Security().get_connection_args("client")
        async with rpc(address, timeout=2 * _PATIENCE, connection_args=arguments) as remote:
            return str((await remote.identity())["type"])

    async def awaited() -> str:
        """Check for signals while waiting for the answer."""
        task = asyncio.create_task(asyncio.wait_for(kind(), _PATIENCE))
        while not task.done():
            await asyncio.wait({task}, timeout=0.1)
            check()
        return task.result()

    try:
        server = asyncio.run(awaited())
        why = f"it is the address of a {shortened(server.lower())}"
    except TimeoutError:
        server, why = "", f"no answer in {_PATIENCE} s"
    except Exception as error:  # any program may answer at the address
        server, why = "", shortened(str(error), 200)
    if server != "Scheduler":
        advice = "start one with the command dask scheduler, or give the address that it shows"
        if address.startswith("tls:"):
            advice += "; the certificates are those of distributed.comm.tls in Dask's configuration"
        raise Refused(f"no Dask scheduler answers at {address} ({why}); {advice}")


def dashboard(client: Client) -> str:
    """Return the link of the dashboard, or the address of the scheduler if there is no dashboard.

    A scheduler serves a dashboard if bokeh is installed; the scheduler of ``local:N`` serves none.
    """
    if client.cluster is None and find_spec("bokeh"):
        return f"dashboard: {client.dashboard_link}"
    return f"scheduler: {client.scheduler.address}"


@contextmanager
def _processes(number: int) -> Iterator[LocalCluster]:
    """Start workers with one thread each; at the end, kill them even in the middle of a task.

    Anybody who can connect to a Dask scheduler or worker can run code there. Therefore these
    processes communicate with a certificate that is made for this run and never leaves them, and
    they serve no web pages.
    """
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    try:
        security = Security.temporary()
    except ImportError:
        raise Refused(
            "local:N makes a certificate with the package cryptography, which is not "
            "installed; install it with pip install cryptography"
        ) from None
    settings = {
        # The profiler of the workers would interrupt the kernel a hundred times a second.
        "distributed.worker.profile.enabled": False,
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    with dask.config.set(settings), ExitStack() as stack:
        with _signals_kept_away():
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=number,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    security=security,
                    scheduler_kwargs={"dashboard": False},
                    dashboard_address="127.0.0.1:0",  # any port: 8787 may be taken
                    silence_logs=logging.CRITICAL,
                )
            )
            stack.callback(_kill, cluster)
        yield cluster


def _kill(cluster: LocalCluster) -> None:
    """Kill the workers, which hold no data that is still needed."""
    for worker in list(cluster.workers.values()):
        worker.close_gracefully()  # so that it is not restarted
        with suppress(psutil.NoSuchProcess):
            if worker.pid is not None:  # psutil takes None for this process
                psutil.Process(worker.pid).kill()


@contextmanager
def _signals_kept_away() -> Iterator[None]:
    """Block signals in the threads that are started in the ``with`` block, and in their processes.

    Ctrl-C in a terminal reaches all processes, but only this one should handle it. Windows has no
    signal mask; there the workers end with this process.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # if started later, it would unblock the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the loggers of Dask and of what it is built on; errors report what matters."""
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in _LOGGERS]
    loggers = [logging.getLogger(name) for name in {*_LOGGERS, *names}]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
