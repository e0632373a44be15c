"""What the console's processes say to each other, and the server to a page: a message and numbers that belong to it.

A frame is two unsigned 32-bit little-endian lengths, the message as JSON (padded with spaces so that the numbers after
it begin at a multiple of 8 bytes), and the numbers as they are in memory. Between processes a frame follows the other
on a stream; to a page each is one binary message of the WebSocket.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any

HEAD = struct.Struct("<II")
ALIGNED = 8
LARGEST_MESSAGE = 4 * 2**20
LARGEST_NUMBERS = 256 * 2**20

Message = dict[str, Any]


class FrameError(ValueError):
    """What came is no frame."""


def frame(message: Message, numbers: bytes = b"") -> bytes:
    """Return a message and its numbers as one frame.

    Examples
    --------
    >>> taken(frame({"kind": "load", "mn": 3.5}))
    ({'kind': 'load', 'mn': 3.5}, b'')
    """
    text = json.dumps(finite(message), separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(len(text) + HEAD.size) % ALIGNED)
    return HEAD.pack(len(text), len(numbers)) + text + numbers


def finite(value: Any) -> Any:
    """Return JSON types with None for what is no number: a page could not read it."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    return value


def lengths(head: bytes) -> tuple[int, int]:
    """Return the lengths of message and numbers; `FrameError` if they are more than anybody sends."""
    message, numbers = HEAD.unpack(head)
    if message > LARGEST_MESSAGE or numbers > LARGEST_NUMBERS:
        raise FrameError(f"a frame of {message} and {numbers} bytes")
    return message, numbers


def message_in(text: bytes) -> Message:
    """Return the message of a frame; `FrameError` if it is none."""
    try:
        message = json.loads(text)
    except ValueError as error:
        raise FrameError("a message that is not JSON") from error
    if not isinstance(message, dict):
        raise FrameError("a message that is not an object")
    return message


def taken(whole: bytes) -> tuple[Message, bytes]:
    """Take one frame apart."""
    message, numbers = lengths(whole[: HEAD.size])
    if len(whole) != HEAD.size + message + numbers:
        raise FrameError("a frame of another length than it says")
    return message_in(whole[HEAD.size : HEAD.size + message]), whole[HEAD.size + message :]


def read_frame(read: Callable[[int], bytes]) -> tuple[Message, bytes] | None:
    """Read one frame with ``read(n)``, which returns n bytes, or fewer at the end; None at the end."""
    head = read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    message, numbers = lengths(head)
    text, rest = read(message), read(numbers) if numbers else b""
    return None if len(text) < message or len(rest) < numbers else (message_in(text), rest)
