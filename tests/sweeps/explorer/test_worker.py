"""The thread of the page: only the newest request is finished, and errors are said once."""

import threading
import time

from sweeps import Refused
from sweeps.explorer.figures import Step, Worker
from sweeps.interrupts import check


def test_only_the_newest_request_is_finished():
    started, shown, others = threading.Event(), [], set(threading.enumerate())
    worker = Worker(lambda call: call(), shown.append)

    def compute(i):
        started.set()
        for _ in range(1000 if i else 1):
            check()
            time.sleep(0.01)
        return i

    def step(i):
        return Step("picture", i, lambda: compute(i), lambda result, seconds: shown.append(result))

    try:
        worker.ask([step(0)])  # the first one compiles, and is not cancelled
        worker.submit(int).result()
        for i in (1, 2, 3):
            started.clear()
            worker.ask([step(i)])
            assert started.wait(300)
        assert shown == [0]
        worker.ask([step(0)])
        worker.submit(int).result()
    finally:
        worker.shutdown()
    assert shown == [0]  # a result already shown is not computed again
    assert set(threading.enumerate()) <= others


def test_an_error_of_a_step_is_said_once():
    said = []
    worker = Worker(lambda call: call(), said.append)

    def fail():
        raise Refused("too much")

    step = Step("picture", 1, fail, lambda *_: None)
    for _ in range(2):
        worker.ask([step])
        worker.submit(int).result()
    worker.shutdown()
    assert said == ["too much"]
