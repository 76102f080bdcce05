"""The same cell with awaitables: `async with await connect_async() as cell: await cell.assemble(seed=7)`.

Each awaitable runs the method of `Cell` with the same name in a thread: there is one implementation.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

from crosspih_common.client.cell import NEEDED, Cell
from crosspih_common.client.connecting import CONNECT_S, connect
from crosspih_common.client.streaming import DEPTH, Stream
from crosspih_common.config import CellFile, Workcell
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import Payload, Topic
from crosspih_common.messages import Event

P = ParamSpec("P")
R = TypeVar("R")
PayloadT = TypeVar("PayloadT", bound=Payload)
THREADS = 16  # calls and streams of one cell that wait at the same time
ABORT_AGAIN_S = 0.2


class Awaited(Generic[P, R]):
    """A method of Cell as an awaitable method of AsyncCell. With `aborts`, a cancellation first ends the assembly, as
    Ctrl-C does, and waits until the peg is out."""

    def __init__(self, method: Callable[Concatenate[Cell, P], R], *, aborts: bool = False) -> None:
        self._method, self._aborts = method, aborts
        self.__doc__ = method.__doc__

    def __get__(self, instance: AsyncCell, owner: type[AsyncCell]) -> Callable[P, Coroutine[Any, Any, R]]:
        async def awaited(*args: P.args, **kwargs: P.kwargs) -> R:
            call = partial(self._method, instance.cell, *args, **kwargs)
            waiting = asyncio.get_running_loop().run_in_executor(instance.threads, call)
            try:
                return await asyncio.shield(waiting)
            except asyncio.CancelledError:
                if self._aborts:
                    await instance._end_assembly(waiting)
                waiting.add_done_callback(_forget)
                raise

        awaited.__doc__, awaited.__name__ = self.__doc__, self._method.__name__
        return awaited


def _forget(done: asyncio.Future[Any]) -> None:
    """Drop the exception of a call that nobody awaits any more."""
    if not done.cancelled():
        done.exception()


class AsyncStream(Generic[PayloadT]):
    """A Stream for `async with` and `async for`; see Stream."""

    def __init__(self, stream: Stream[PayloadT], threads: ThreadPoolExecutor) -> None:
        self._stream, self._threads = stream, threads
        self._taken: deque[PayloadT] = deque()

    @property
    def path(self) -> str:
        """The path of the topic."""
        return self._stream.path

    @property
    def dropped(self) -> int:
        """How many samples were dropped because the reader was slower than the topic."""
        return self._stream.dropped

    async def __aenter__(self) -> AsyncStream[PayloadT]:
        await asyncio.get_running_loop().run_in_executor(self._threads, self._stream.__enter__)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Stop listening; a loop over the stream ends."""
        await asyncio.get_running_loop().run_in_executor(self._threads, self._stream.close)

    async def __aiter__(self) -> AsyncIterator[PayloadT]:
        loop = asyncio.get_running_loop()
        while True:
            while self._taken:
                yield self._taken.popleft()
            self._taken += await loop.run_in_executor(self._threads, self._stream.take_all)
            if not self._taken:
                return


class AsyncCell:
    """`Cell` for asyncio: the same methods, each of which is awaited. `connect_async` opens one."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.threads = ThreadPoolExecutor(THREADS, thread_name_prefix="crosspih-client")

    wait_for_services = Awaited(Cell.wait_for_services)
    clock = Awaited(Cell.clock)
    speed = Awaited(Cell.speed)
    require_sound_cell = Awaited(Cell.require_sound_cell)
    status = Awaited(Cell.status)
    wrench = Awaited(Cell.wrench)
    joints = Awaited(Cell.joints)
    reset = Awaited(Cell.reset)
    locate = Awaited(Cell.locate)
    calibrate_ft = Awaited(Cell.calibrate_ft)
    withdraw = Awaited(Cell.withdraw)
    abort = Awaited(Cell.abort)
    pause = Awaited(Cell.pause)
    resume = Awaited(Cell.resume)
    assemble = Awaited(Cell.assemble, aborts=True)

    async def __aenter__(self) -> AsyncCell:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Leave the bus; streams end."""
        await asyncio.get_running_loop().run_in_executor(self.threads, self.cell.close)
        self.threads.shutdown(wait=False)

    @property
    def workcell(self) -> Workcell:
        """The cell's drawing."""
        return self.cell.workcell

    @property
    def file(self) -> CellFile:
        """The cell's file."""
        return self.cell.file

    @property
    def simulated(self) -> bool:
        """Whether the running cell has a simulator. Known since the cell was opened, so this does not wait."""
        return self.cell.simulated

    def alive(self) -> set[str]:
        """The services that live now."""
        return self.cell.alive()

    @overload
    def stream(
        self, topic: Topic[PayloadT], depth: int = ..., timeout_s: float | None = ...
    ) -> AsyncStream[PayloadT]: ...

    @overload
    def stream(self, topic: str, depth: int = ..., timeout_s: float | None = ...) -> AsyncStream[Any]: ...

    def stream(self, topic: Topic[Any] | str, depth: int = DEPTH, timeout_s: float | None = None) -> AsyncStream[Any]:
        """See Cell.stream: `async with cell.stream("planning/phase") as stream: async for phase in stream`."""
        return AsyncStream(self.cell.stream(topic, depth, timeout_s), self.threads)

    def events(self, depth: int = DEPTH, timeout_s: float | None = None) -> AsyncStream[Event]:
        """See Cell.events."""
        return AsyncStream(self.cell.events(depth, timeout_s), self.threads)

    async def _end_assembly(self, waiting: asyncio.Future[Any]) -> None:
        """End this client's assembly once it has begun, and wait for its end."""
        loop, aborted = asyncio.get_running_loop(), False
        while not waiting.done():
            if not aborted:
                try:
                    aborted = await loop.run_in_executor(self.threads, self.cell.abort_own)
                except CrosspihError:
                    break  # the planner is gone: the outcome is learned from the bus
            await asyncio.wait([waiting], timeout=None if aborted else ABORT_AGAIN_S)
        await asyncio.wait([waiting])


async def connect_async(
    endpoint: str | None = None,
    cell: str | Path | None = None,
    *,
    timeout_s: float = CONNECT_S,
    needed: tuple[str, ...] = NEEDED,
) -> AsyncCell:
    """The running cell for asyncio; see `connect` for the arguments and what it raises."""
    return AsyncCell(await asyncio.to_thread(connect, endpoint, cell, timeout_s=timeout_s, needed=needed))


__all__ = ["AsyncCell", "AsyncStream", "connect_async"]
