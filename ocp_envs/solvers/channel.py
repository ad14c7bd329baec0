"""Messages between two processes of this program: pickles, each preceded by its length, over two file descriptors."""

from __future__ import annotations

import os
import pickle
import select
import struct
import time
from typing import Any

_HEADER = struct.Struct("<Q")


class Silent(Exception):
    """No message arrived within the limit."""


class Gone(Exception):
    """The other end is closed."""


class Channel:
    """One end of a connection, which reads from the file descriptor ``source`` and writes to ``sink``."""

    def __init__(self, source: int, sink: int) -> None:
        self._source, self._sink, self._pending = source, sink, bytearray()

    def send(self, message: object) -> None:
        """Send ``message``, which must be picklable.

        Raises:
            Gone: the other end is closed.
        """
        body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
        data = memoryview(_HEADER.pack(len(body)) + body)
        try:
            while data:
                data = data[os.write(self._sink, data) :]
        except OSError as error:
            raise Gone from error

    def receive(self, limit: float | None = None) -> Any:
        """The next message; all of it must arrive within ``limit`` seconds, if given.

        Raises:
            Silent: it did not arrive in time.
            Gone: the other end is closed.
        """
        deadline = None if limit is None else time.monotonic() + limit
        size = _HEADER.unpack(self._take(_HEADER.size, deadline))[0]
        return pickle.loads(self._take(size, deadline))

    def _take(self, size: int, deadline: float | None) -> bytes:
        while len(self._pending) < size:
            if deadline is not None:
                left = max(0.0, deadline - time.monotonic())
                if not select.select([self._source], [], [], left)[0]:
                    raise Silent
            data = os.read(self._source, 1 << 16)
            if not data:
                raise Gone
            self._pending += data
        taken = bytes(self._pending[:size])
        del self._pending[:size]
        return taken
