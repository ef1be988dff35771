"""A Dask client for an address that was typed: of a cluster that there is, or of processes here."""

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
from sweeps.interrupts import check, raised_at_once
from sweeps.text import shortened

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

#: How long a scheduler may take to answer [s].
_PATIENCE = 6

_ALLOWED = "tcp://HOST:PORT or tls://HOST:PORT of a Dask scheduler, or local:N for N processes here"
_SCHEDULER = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})")


def check_address(address: str) -> None:
    """Refuse what is no address for `connected`, before anything is imported or started."""
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
    """Yield a client of the cluster at an address, and disable all logging meanwhile.

    The address, which `check_address` has accepted, is ``tcp://host:port`` of a scheduler;
    ``tls://host:port`` of one that asks for certificates, which Dask's own configuration names; or
    ``local:N``, which starts N processes with a thread each on this machine, which no other user
    can reach, and ends them. Raises Refused if Dask is not installed, or no scheduler takes this
    process in.
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
        with raised_at_once():  # Dask looks at no flag while it waits for an answer
            registered = _registered(address)
        with registered as client:
            yield client


def _registered(address: str) -> Client:
    """Return a client that a scheduler has taken in."""
    import distributed

    class Client(distributed.Client):
        def __del__(self) -> None:
            """Do not wait for a scheduler that never took it in; ``with`` closes all others."""

    try:
        return Client(address, timeout=_PATIENCE, set_as_default=False)
    except Exception as error:  # whatever another program answers
        reason = shortened(str(error)) or f"no answer in {_PATIENCE} s"
        raise Refused(
            f"the Dask scheduler at {address} answers, but does not take this process in "
            f"({reason}); look at what it logs, and whether it has the same version of Dask"
        ) from None


def _refuse_silence(address: str) -> None:
    """Refuse an address where nothing, or something else than a scheduler, answers in time.

    A client itself waits forever where something listens and does not answer.
    """
    from distributed import Security, rpc

    async def kind() -> str:
        """Ask what answers at the address."""
        arguments = Security().get_connection_args("client")
        async with rpc(address, timeout=2 * _PATIENCE, connection_args=arguments) as remote:
            return str((await remote.identity())["type"])

    async def awaited() -> str:
        """Wait for the answer, and look up for signals meanwhile."""
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
    except Exception as error:  # whatever another program answers
        server, why = "", shortened(str(error), 200)
    if server != "Scheduler":
        advice = "start one with the command dask scheduler, or give the address that it shows"
        if address.startswith("tls:"):
            advice += "; the certificates are those of distributed.comm.tls in Dask's configuration"
        raise Refused(f"no Dask scheduler answers at {address} ({why}); {advice}")


def dashboard(client: Client) -> str:
    """Say where the cluster can be watched: on its dashboard, or else by its scheduler's address.

    A scheduler serves the dashboard where bokeh is installed; that of ``local:N`` serves none.
    """
    if client.cluster is None and find_spec("bokeh"):
        return f"dashboard: {client.dashboard_link}"
    return f"scheduler: {client.scheduler.address}"


@contextmanager
def _processes(number: int) -> Iterator[LocalCluster]:
    """Start workers with one thread each, and end them at once, also in the middle of a task.

    Who reaches a scheduler or a worker of Dask runs code there. So they talk with a certificate
    that is made for this run and never leaves these processes, and serve no pages.
    """
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    try:
        security = Security.temporary()
    except ImportError:
        raise Refused(
            "local:N makes a certificate with the package cryptography, which is not "
            "installed; install it with pip install 'vibroimpact[distributed]'"
        ) from None
    settings = {
        # The profiler of the workers would look into the kernel a hundred times a second.
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
    """Kill the workers, which have nothing that anybody needs."""
    for worker in list(cluster.workers.values()):
        worker.close_gracefully()  # it is not to be started again
        with suppress(psutil.NoSuchProcess):
            if worker.pid is not None:  # which psutil takes for this process
                psutil.Process(worker.pid).kill()


@contextmanager
def _signals_kept_away() -> Iterator[None]:
    """Keep signals from the threads that are started in the block, and from their processes.

    A Ctrl-C at a terminal goes to all processes at once, and is for this one to handle. Windows
    has no such mask; there the workers end with this process.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    resource_tracker.ensure_running()  # which would let them through again, if started later
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _quiet() -> Iterator[None]:
    """Disable all logging, of Dask and of everything else; the errors tell what matters."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
