"""Real ports for emulated devices: a pseudo-terminal that looks like a serial port, and a TCP server."""

from __future__ import annotations

import os
import pty
import select
import socket
import threading
import time
import tty
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from sim_backend.emulators.wire import Clean, Disturbance, EmulatedDevice

Lock = AbstractContextManager[Any, Any]

POLL_S = 0.05
LOCALHOST = "127.0.0.1"
LARGEST_READ = 4096


class PtyPort:
    """A device on a pseudo-terminal, under a name that stays when the cable is pulled and put back.

    Parameters
    ----------
    emulated
        The device.
    path
        Name of the port, made as a link; its folder is made and taken away with it.
    disturbance
        Faults on the wire; None for none.
    lock
        Held while the device answers.

    Attributes
    ----------
    taken
        How many bytes the device has taken.
    """

    def __init__(
        self,
        emulated: EmulatedDevice,
        path: Path,
        disturbance: Disturbance | None = None,
        lock: Lock | None = None,
    ) -> None:
        self._lock: Lock = nullcontext() if lock is None else lock
        self.path = path
        self.taken = 0
        self._emulated = emulated
        self._disturbance: Disturbance = Clean() if disturbance is None else disturbance
        self._ends: tuple[int, int] | None = None
        self._thread: threading.Thread | None = None

    def plug(self) -> None:
        """Put the cable in; harmless when it is in."""
        if self._ends is not None:
            return
        master, slave = pty.openpty()
        tty.setraw(master)
        tty.setraw(slave)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        self._ends = (master, slave)
        self._thread = threading.Thread(target=self._serve, args=(master,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Pull the cable; harmless when it is out."""
        if self._ends is None:
            return
        ends, self._ends = self._ends, None
        self.path.unlink(missing_ok=True)
        if self._thread is not None:
            self._thread.join()
        for end in ends:
            os.close(end)
        if not any(self.path.parent.iterdir()):
            self.path.parent.rmdir()

    def _serve(self, master: int) -> None:
        while self._ends is not None and self._ends[0] == master:
            if not select.select([master], [], [], POLL_S)[0]:
                continue
            asked = os.read(master, LARGEST_READ)
            for data in _answers(self._emulated, self._disturbance, asked, self._lock):
                os.write(master, data)
            self.taken += len(asked)


class TcpPort:
    """A device that listens on a port of this machine, for one program at a time; `plug` and `unplug` the cable.

    Attributes
    ----------
    host, tcp_port
        Where it listens.
    taken
        How many bytes the device has taken.
    """

    def __init__(
        self, emulated: EmulatedDevice, disturbance: Disturbance | None = None, lock: Lock | None = None
    ) -> None:
        self._lock: Lock = nullcontext() if lock is None else lock
        self.taken = 0
        self._emulated = emulated
        self._disturbance: Disturbance = Clean() if disturbance is None else disturbance
        with socket.create_server((LOCALHOST, 0)) as found:
            self.host, self.tcp_port = found.getsockname()
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None

    def plug(self) -> None:
        """Listen; harmless when it does."""
        if self._listener is not None:
            return
        self._listener = socket.create_server((self.host, self.tcp_port))
        self._thread = threading.Thread(target=self._serve, args=(self._listener,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Hang up and listen no longer; harmless when it does not."""
        if self._listener is None:
            return
        listener, self._listener = self._listener, None
        if self._thread is not None:
            self._thread.join()
        listener.close()

    def _serve(self, listener: socket.socket) -> None:
        while self._listener is listener:
            if not select.select([listener], [], [], POLL_S)[0]:
                continue
            connection, _ = listener.accept()
            with connection:
                self._talk(connection, listener)

    def _talk(self, connection: socket.socket, listener: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while self._listener is listener:
            if not select.select([connection], [], [], POLL_S)[0]:
                continue
            try:
                data = connection.recv(LARGEST_READ)
                if not data:
                    return
                for reply in _answers(self._emulated, self._disturbance, data, self._lock):
                    connection.sendall(reply)
                self.taken += len(data)
            except OSError:
                return  # the program hung up


def _answers(emulated: EmulatedDevice, disturbance: Disturbance, data: bytes, lock: Lock) -> list[bytes]:
    """Return what goes back for bytes that came, waiting where it comes late."""
    with lock:
        answers = [unasked] if (unasked := emulated.unasked()) else []
        replies = emulated.receive(disturbance.request(data))
    for reply in replies:
        for delay, part in disturbance.reply(reply):
            if delay > 0:
                time.sleep(delay)
            answers.append(part)
    return answers
