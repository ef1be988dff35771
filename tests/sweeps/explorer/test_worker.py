"""The thread of the page: only the newest request is finished, errors are said, nothing is lost."""

import threading
import time
from dataclasses import replace

import pytest
from bokeh.document import Document

from sweeps import Refused, StoreError
from sweeps.explorer import live_diagram
from sweeps.explorer.figures import Step, Worker
from sweeps.explorer.live_page import LivePage
from sweeps.explorer.view import MAP_TAB
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


def test_a_finer_picture_is_shown_after_the_time_of_all_steps_of_its_request():
    seconds = []
    worker = Worker(lambda call: call(), seconds.append)
    steps = [
        Step("map", i, lambda: time.sleep(0.2), lambda _, passed: seconds.append(passed))
        for i in range(2)
    ]
    try:
        worker.ask(steps)
        worker.submit(int).result()
    finally:
        worker.shutdown()
    assert seconds[1] >= seconds[0] + 0.2 >= 0.4


@pytest.mark.parametrize(
    "error", [Refused("too much"), MemoryError("too much"), OSError("too much")]
)
def test_a_step_that_failed_is_computed_at_the_next_request(error):
    """Until it succeeds its place is late, and each request says the error again."""
    seen = []
    worker = Worker(lambda call: call(), seen.append)
    outcomes = [error, error, None]

    def compute():
        if (outcome := outcomes.pop(0)) is not None:
            raise outcome
        return "picture"

    step = Step("picture", 1, compute, lambda result, seconds: seen.append(result))
    for expected in (["too much"], ["too much"] * 2, ["too much", "too much", "picture"]):
        assert worker.is_late("picture")
        worker.ask([step])
        worker.submit(int).result()
        assert seen == expected
    assert not worker.is_late("picture")
    worker.shutdown()


def test_an_error_of_an_earlier_request_is_not_said():
    posts, said = [], []
    worker = Worker(posts.append, said.append)

    def fail():
        raise Refused("too much")

    worker.ask([Step("picture", 1, fail, lambda *_: None)])
    worker.submit(int).result()
    worker.ask([])
    worker.shutdown()
    for post in posts:
        post()
    assert posts and said == []


@pytest.fixture
def page(view, tmp_path, monkeypatch):
    """Return a page over the start x0, whose calls between threads wait in its list `posts`."""
    document, posts = Document(), []
    monkeypatch.setattr(document, "add_next_tick_callback", posts.append)
    view = replace(view, record={**view.record, "transient": 5, "periods": 2})
    page = LivePage(document, view.with_axis("x0"), tmp_path)
    page.posts, page.diagram.size = posts, (20, 16)
    yield page
    page.worker.shutdown()


def settle(page):
    """Compute all steps, and let the browser paint each picture."""
    page.worker.submit(int).result()
    while page.posts:
        page.posts.pop(0)()
        page.diagram.painted.value = page.diagram.sent
    page._show_progress()


def test_an_error_stays_while_what_failed_is_asked_for(page):
    """The start moves no periodic orbit, so there are no exact branches along it."""
    error, said = page.controls.error, "do not depend on x0"
    page.change(lambda view: replace(view, exact=True))
    settle(page)
    assert said in error.text
    page.change(lambda view: view.moved(v0=0.1))
    settle(page)
    assert error.text.count(said) == 1
    fields = page.controls.fields
    right = {name: field.value for name, field in fields.items()}
    for name, typed in (("h", "-1"), ("R", "2")):  # only the text that is said to be wrong stays
        fields[name].value = typed
        settle(page)
        assert said in error.text and f"{name} = {typed} is not allowed" in error.text
        assert [fields[each].value for each in fields] == [*{**right, name: typed}.values()]
    page._save()
    settle(page)
    assert said in error.text and "R = 2" not in error.text
    assert page.controls.saved.text.startswith("saved: ")
    assert fields["R"].value == right["R"]
    page.change(lambda view: replace(view, exact=False))
    settle(page)
    assert error.text == ""


@pytest.mark.parametrize("error", [MemoryError("no memory"), StoreError("no memory")])
def test_a_picture_that_fails_is_said_to_be_the_previous_one(page, monkeypatch, error):
    """In the step that computes it, or in the estimate of its memory before."""
    waits, is_step = page.diagram._waits, isinstance(error, MemoryError)
    page._compute()
    settle(page)
    assert not waits.visible

    def fail(*arguments):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(live_diagram, "compute_all" if is_step else "check_memory", fail)
        page.change(lambda view: view.moved(R=0.5))
        settle(page)
        assert page.controls.error.text == "no memory"
        assert waits.visible and waits.text == "this is the previous picture"
    page.change(lambda view: view)
    settle(page)
    assert page.controls.error.text == waits.text == "" and not waits.visible


def test_a_slow_connection_carries_the_first_and_the_last_picture_of_a_map(page):
    """The others wait until the browser has painted, and would hold up what the user does."""
    page.map.size, sent = (60, 40), []
    page.map.source.on_change("data", lambda attr, old, new: sent.append(new["image"][0].shape))
    page.change(lambda view: replace(view, tab=MAP_TAB))
    page.worker.submit(int).result()
    while page.posts:
        page.posts.pop(0)()
    assert sent == 2 * [(40, 60)] and page.map.filling._done == 2400
    assert page.controls.status.text.startswith("2,400 points")
