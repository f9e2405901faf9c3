"""What a driver raises. Every message says what happened, where, what is allowed and what to do next (law 12).

`where` names the instrument and its port ('Watlow F4 at sim://chamber'); `request` is the request as a person reads it.
"""

from drivers.codecs.crc import CRCS

_SHOWN_BYTES = 16
_SHOWN_TEXT = 60
# KVH DSP-1760/1725/1750/1775, 36-byte frame: the first four bytes of every frame.
_KVH_HEADER = bytes.fromhex("FE81FF55")


class DriverError(Exception):
    """Something is wrong with an instrument or its link: the bench failed, not the DUT (law 9)."""


class NoReply(DriverError):
    """The instrument stayed silent for `timeout_s`, `tries` times."""

    def __init__(self, where: str, request: str, timeout_s: float, tries: int) -> None:
        super().__init__(
            f"{where}: no reply to '{request}' within {timeout_s:g} s ({tries} {'try' if tries == 1 else 'tries'}). "
            "Check that it is powered and allows remote control, then cable, baud rate and address"
        )
        self.where, self.request, self.timeout_s, self.tries = where, request, timeout_s, tries


class BadReply(DriverError):
    """Something answered, but not with what this protocol allows; `reply` holds the bytes as they came."""

    def __init__(self, where: str, request: str, reply: bytes, why: str) -> None:
        super().__init__(
            f"{where}: the reply to '{request}' is wrong: {why}. Received {show_bytes(reply)}, {looks_like(reply)}. "
            "Check that the port belongs to this instrument, and its baud rate and address"
        )
        self.where, self.request, self.reply, self.why = where, request, reply, why


class Refused(DriverError):
    """The instrument understood and said no; `code` is its own word for it."""

    def __init__(self, where: str, request: str, code: int | str, advice: str = "") -> None:
        reason = f"error {code}" if isinstance(code, int) else code
        tail = f". {advice}" if advice else ". See the instrument's front panel and its limits"
        super().__init__(f"{where}: '{request}' was refused: {reason}{tail}")
        self.where, self.request, self.code = where, request, code


class PortError(DriverError):
    """The port itself: it does not open, went away, or delivered more than could be held."""

    def __init__(self, port: str, why: str) -> None:
        super().__init__(f"port {port}: {why}")
        self.port, self.why = port, why


def show_bytes(data: bytes) -> str:
    """The first bytes in hexadecimal.

    >>> show_bytes(bytes(20))
    '20 bytes: 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 ...'
    """
    if not data:
        return "nothing"
    unit = "byte" if len(data) == 1 else "bytes"
    return f"{len(data)} {unit}: {data[:_SHOWN_BYTES].hex(' ').upper()}{' ...' if len(data) > _SHOWN_BYTES else ''}"


def looks_like(data: bytes) -> str:
    """What kind of instrument would say this, as far as the bytes tell.

    >>> looks_like(b"OK\\r\\n")
    "which looks like ASCII text 'OK'"
    >>> looks_like(bytes.fromhex("010302FF38F866"))
    'which looks like a Modbus RTU frame of address 1'
    """
    if _KVH_HEADER in data:
        return "which looks like a KVH gyro stream (header FE 81 FF 55)"
    if 5 <= len(data) <= 256 and CRCS["crc16-modbus"].of(data) == 0:
        return f"which looks like a Modbus RTU frame of address {data[0]}"
    text = data.strip(b"\r\n\0 ")
    if text and all(32 <= byte < 127 or byte in b"\r\n\t" for byte in text):
        shown = text.decode("ascii").split("\r")[0].split("\n")[0][:_SHOWN_TEXT]
        return f"which looks like ASCII text '{shown}'"
    if data and data.count(data[0]) == len(data) and len(data) > 1:
        return "which looks like an idle or short-circuited line"
    return "which looks like no protocol known here (a wrong baud rate looks like this)"
