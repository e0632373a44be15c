"""Processes that the console starts, each at the other end of a socket: frames go both ways, and neither waits."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Callable

from mesotap.console.frames import HEAD, FrameError, Message, frame, lengths, message_in

ENDING_S = 30.0
"""For which a session that is told to end is waited for: it takes the surfaces apart and looks whether they are."""

BEAT_S = 1.0
"""Between two words to a process that ends where it hears none; see `session_link.SILENT_S`."""

LONGEST_LINE = 1 << 16
"""Bytes of a line on standard error; of a longer one only that it was long is passed on."""

Heard = Callable[[Message, bytes], None]


class Child:
    """One process.

    Parameters
    ----------
    module
        Its program, which is given the descriptor of its socket.
    heard
        Called with each frame that it sends.
    gone
        Called when it has ended, with its exit code.
    niceness
        By how much it gives way to others.
    beats
        Whether it is told every second that the console is there.
    said
        Called with each line that it, or what outlives it, writes to standard error, where the line goes as well;
        None leaves standard error alone.
    """

    def __init__(
        self,
        module: str,
        heard: Heard,
        gone: Callable[[int], None],
        niceness: int = 0,
        beats: bool = False,
        said: Callable[[str], None] | None = None,
    ) -> None:
        self._module, self._heard, self._gone, self._niceness, self._beats = module, heard, gone, niceness, beats
        self._process: asyncio.subprocess.Process | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._listening: asyncio.Task[None] | None = None
        self._beating: asyncio.Task[None] | None = None
        self._said = said
        self._relaying: tuple[asyncio.ReadTransport, asyncio.Task[None]] | None = None

    @property
    def running(self) -> bool:
        """Whether it was started and has not ended."""
        return self._listening is not None and not self._listening.done()

    async def start(self) -> None:
        """Start it."""
        ours, theirs = socket.socketpair()
        errors = await self._errors()
        nowhere = asyncio.subprocess.DEVNULL
        command = [sys.executable, "-m", self._module, str(theirs.fileno())]
        if self._niceness:
            command = ["nice", "-n", str(self._niceness), *command]
        try:
            self._process = await asyncio.create_subprocess_exec(
                *command,
                stdin=nowhere,
                stdout=nowhere,
                stderr=errors,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        finally:
            theirs.close()
            if errors is not None:
                os.close(errors)
        reader, self._writer = await asyncio.open_connection(sock=ours)
        self._listening = asyncio.create_task(self._listen(reader))
        if self._beats:
            self._beating = asyncio.create_task(self._beat())

    def tell(self, message: Message, numbers: bytes = b"") -> None:
        """Send a frame; one that has ended is told nothing."""
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(frame(message, numbers))

    async def end(self, at_once: bool = False) -> None:
        """Close the connection, upon which it ends, and wait for that; ``at_once``: it has nothing to put away."""
        if self._writer is not None:
            self._writer.close()
        if at_once and self._process is not None and self.running:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
        if self._listening is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(self._listening), ENDING_S)
        if self._relaying is not None:
            self._relaying[0].close()

    async def _errors(self) -> int | None:
        """Return what it is given as standard error, whose lines are passed on for as long as anybody holds it."""
        if self._said is None:
            return None
        ours, theirs = os.pipe()
        reader = asyncio.StreamReader(LONGEST_LINE)
        pipe = os.fdopen(ours, "rb", 0)
        loop = asyncio.get_running_loop()
        transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), pipe)
        self._relaying = transport, asyncio.create_task(self._relay(reader, self._said))
        return theirs

    async def _relay(self, reader: asyncio.StreamReader, said: Callable[[str], None]) -> None:
        while True:
            try:
                line = await reader.readline()
            except ValueError:
                line = b"a line that is too long to be passed on\n"
            if not line:
                return
            with contextlib.suppress(OSError):
                os.write(sys.stderr.fileno(), line)
            said(line.decode(errors="replace").strip())

    async def _beat(self) -> None:
        while self.running:
            self.tell({"do": "beat"})
            await asyncio.sleep(BEAT_S)

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        process = self._process
        assert process is not None  # noqa: S101 - it was started
        try:
            while True:
                message, numbers = lengths(await reader.readexactly(HEAD.size))
                text = await reader.readexactly(message)
                self._heard(message_in(text), await reader.readexactly(numbers) if numbers else b"")
        except (asyncio.IncompleteReadError, ConnectionError, FrameError):
            pass
        if self._writer is not None:
            self._writer.close()
        self._gone(await process.wait())
