"""The event loop behind the blocking classes: one thread for all of them, begun by the first call.

A program that forks gets a new one in the child; connections do not go along.
"""

from __future__ import annotations

import asyncio
import atexit
import concurrent.futures
import os
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import Any, Generic, Protocol, TypeVar

T = TypeVar("T")

# How long an interrupt may take: Python sees one that comes while another thread runs, or just before
# the wait begins, only when the wait ends.
_INTERRUPT_S = 0.5


class _Context(Protocol):
    async def __aexit__(self, kind: object, error: object, trace: object) -> None: ...


C = TypeVar("C", bound=_Context)
B = TypeVar("B", bound="Blocking[Any]")

_lock = threading.Lock()
_loop: asyncio.AbstractEventLoop | None = None
_thread: threading.Thread | None = None


def run(work: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Runs what `work` begins on the package's loop and waits for it. An interrupt cancels it.

    The loop's thread makes the coroutine, because an interrupt may come before each line here: it leaves
    nothing behind that is never awaited.
    """
    loop = _running()
    if threading.current_thread() is _thread:
        raise RuntimeError("a callback must not call blocking methods: it would wait for itself")
    future: concurrent.futures.Future[T] = concurrent.futures.Future()
    tasks: list[asyncio.Task[T]] = []

    async def working() -> T:
        return await work()

    def begin() -> None:
        tasks.append(loop.create_task(working()))
        tasks[0].add_done_callback(end)

    def end(task: asyncio.Task[T]) -> None:
        if task.cancelled():
            future.cancel()
        elif (error := task.exception()) is not None:
            future.set_exception(error)
        else:
            future.set_result(task.result())

    def cancel() -> None:
        for task in tasks:
            task.cancel()

    try:
        loop.call_soon_threadsafe(begin)
        while True:
            try:
                return future.result(_INTERRUPT_S)
            except concurrent.futures.TimeoutError:
                if future.done():
                    # It came meanwhile, or it is the work's own.
                    return future.result()
    except BaseException:
        loop.call_soon_threadsafe(cancel)
        raise


def iterate(items: AsyncIterator[T]) -> Iterator[T]:
    """The items of an asynchronous iterator."""
    async def following() -> tuple[T] | None:
        try:
            return (await items.__anext__(),)
        except StopAsyncIteration:
            return None

    try:
        while (found := run(following)) is not None:
            yield found[0]
    finally:
        close = getattr(items, "aclose", None)
        if close is not None:
            run(close)


class Blocking(Generic[C]):
    """What the blocking classes share."""

    def __init__(self, twin: C) -> None:
        self._twin = twin

    def __enter__(self: B) -> B:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        run(lambda: self._twin.__aexit__(kind, error, trace))


def _running() -> asyncio.AbstractEventLoop:
    global _loop, _thread
    with _lock:
        if _loop is None:
            _loop = asyncio.new_event_loop()
            _thread = threading.Thread(target=_loop.run_forever, name="covis", daemon=True)
            _thread.start()
            atexit.register(_stop)
        return _loop


def _stop() -> None:
    """Cancels what still runs, so that nothing is torn off in the middle at the end of the program."""
    loop, thread = _loop, _thread
    if loop is None or thread is None or not thread.is_alive():
        return
    asyncio.run_coroutine_threadsafe(_cancel_all(), loop).result(5)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(5)


async def _cancel_all() -> None:
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def _forget() -> None:
    global _loop, _thread, _lock
    _loop = _thread = None
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
