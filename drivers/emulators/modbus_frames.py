"""Modbus frames and requests as bytes; no code is shared with the client.

What one side gets wrong the other notices.
"""

from collections.abc import Sequence
from typing import Protocol


class RefusedError(Exception):
    """The register bank refuses; `code` is the Modbus exception."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class Bank(Protocol):
    """Registers behind the server."""

    def read(self, address: int, count: int) -> Sequence[int]:
        """Return `count` 16-bit words from `address` on, or raise RefusedError."""
        ...

    def write(self, address: int, words: Sequence[int]) -> None:
        """Store words from `address` on, or raise RefusedError."""
        ...


def crc16(data: bytes) -> int:
    """Return the CRC of Modbus RTU: polynomial 0xA001 reflected, from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def answer(bank: Bank, pdu: bytes) -> bytes:
    """Answer one request.

    Parameters
    ----------
    bank : Bank
    pdu : bytes
        Function code and data, without address and CRC.

    Returns
    -------
    bytes
        The reply's PDU; an exception reply where the request is refused.
    """
    function = pdu[0]
    try:
        if function in (3, 4):
            return _answer_read(bank, pdu)
        if function == 6 and len(pdu) == 5:
            bank.write(word_at(pdu, 1), [word_at(pdu, 3)])
            return pdu
        if function == 16 and len(pdu) >= 6:
            return _answer_write(bank, pdu)
        raise RefusedError(3 if function in (6, 16) else 1)
    except RefusedError as refusal:
        return bytes((function | 0x80, refusal.code))


def _answer_read(bank: Bank, pdu: bytes) -> bytes:
    if len(pdu) != 5 or not 1 <= word_at(pdu, 3) <= 125:
        raise RefusedError(3)
    words = bank.read(word_at(pdu, 1), word_at(pdu, 3))
    body = b"".join(word.to_bytes(2, "big") for word in words)
    return bytes((pdu[0], len(body))) + body


def _answer_write(bank: Bank, pdu: bytes) -> bytes:
    count, size = word_at(pdu, 3), pdu[5]
    if not 1 <= count <= 123 or size != 2 * count or len(pdu) != 6 + size:
        raise RefusedError(3)
    bank.write(word_at(pdu, 1), [word_at(pdu, 6 + 2 * i) for i in range(count)])
    return pdu[:5]


def word_at(data: bytes | bytearray, at: int) -> int:
    """Return the 16-bit word that begins at a byte."""
    return int.from_bytes(data[at : at + 2], "big")


def take_rtu(buffer: bytearray, *, idle: bool) -> tuple[int, bytes] | None:
    """Take one whole RTU request off the front of what was received.

    Parameters
    ----------
    buffer : bytearray
        Received bytes; what is taken, and what cannot begin a frame, is removed.
    idle : bool
        The line has been silent longer than a frame may pause.

    Returns
    -------
    (int, bytes) or None
        Unit and PDU; None when more must come first.
    """
    while len(buffer) >= 4:
        function = buffer[1]
        if 1 <= function <= 6:
            size = 8
        elif function in (15, 16):
            size = 9 + buffer[6] if len(buffer) > 6 else len(buffer) + 1
        else:  # its length is not known: only the silence after it ends it
            size = len(buffer) if idle else len(buffer) + 1
        if size <= len(buffer):
            frame = bytes(buffer[:size])
            if crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little"):
                del buffer[:size]
                return frame[0], frame[1:-2]
        elif not idle and size <= 256:
            return None
        del buffer[0]  # no frame begins here
    if idle:
        buffer.clear()
    return None
