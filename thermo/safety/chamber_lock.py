"""One master a chamber: a lock on what a station file's link leads to, not on its spelling.

The lock is a listening socket in the kernel's abstract namespace (Linux). Its name can be bound
once on a machine, whoever asks and whatever the environment; it is gone with the last process that
holds it, however that ends, so there is nothing stale to clear away and no file that somebody else
could lock, remove or make first. The kernel itself tells who holds it (SO_PEERCRED). A child that
inherits the descriptor holds the same lock: the guardian keeps it without a gap when the
controller dies. `docs/decisions/0009-one-master-a-chamber.md` has the reasoning.
"""

import contextlib
import errno
import hashlib
import ipaddress
import json
import os
import socket
import stat
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import LinkError
from drivers.links.modbus import parse_modbus_url
from drivers.station import ChamberConfig
from thermo.safety.processes import process_state, user_name

PATIENCE_S = 60.0  # for a guardian that makes the chamber safe; a running test is not waited for
RACE_S = 1.0  # two that begin at once: the loser looks again so long before it says who won
ANSWER_S = 0.5  # for a guardian to say which test it guards
PAUSE_S = 0.1
THIS_MACHINE = "this machine"


class ChamberHeldError(LinkError):
    """Another process holds the chamber; nothing was sent to it."""

    def __init__(self, url: str, holder: "Holder") -> None:
        super().__init__(
            f"chamber {url}: held by {holder.sentence}; not commanded. "
            "`accelbench make-safe STATION.toml --force` makes it safe in any case"
        )
        self.holder = holder


@dataclass(frozen=True, slots=True, kw_only=True)
class Holder:
    """Process that holds a chamber; what could not be learnt is None or empty.

    Attributes
    ----------
    user : str
    pid : int or None
        The controller that took the lock, also when only its guardian holds it now.
    state : str
        "runs", "stopped", "gone" (its guardian holds the lock), or "" when unknown.
    held_s : float or None
        Since that process began, s.
    test_id : str
    guardian_pid : int or None
    phase : str
        What the guardian does: "watching", "taking over", …
    """

    user: str = ""
    pid: int | None = None
    state: str = ""
    held_s: float | None = None
    test_id: str = ""
    guardian_pid: int | None = None
    phase: str = ""

    @property
    def is_guardian(self) -> bool:
        """True when only a guardian is left, which lets go when the chamber is safe."""
        return self.state == "gone"

    @property
    def sentence(self) -> str:
        """The holder in words."""
        who = f"process {self.pid}" if self.pid else "a process that does not identify itself"
        if self.is_guardian:
            guardian = f" {self.guardian_pid}" if self.guardian_pid else ""
            who = f"the guardian{guardian} of the dead process {self.pid}, making it safe"
        elif self.state == "stopped":
            who += " (stopped)"
        parts = [f"{self.user or 'an unknown user'}, {who}"]
        if self.test_id:
            parts.append(f"test {self.test_id}")
        if self.held_s is not None:
            parts.append(f"for {_duration(self.held_s)}")
        return ", ".join(parts)


class ChamberLock:
    """The right to command a chamber, held until `release` or the end of every holder.

    Made by `take`. Its descriptors are given to the guardian (`pass_fds`), which holds the same
    lock.
    """

    def __init__(self, sockets: Sequence[socket.socket]) -> None:
        self._sockets = list(sockets)

    @classmethod
    def take(
        cls, config: ChamberConfig, *, patience_s: float = PATIENCE_S, salt: str = ""
    ) -> "ChamberLock":
        """Take the lock of the chamber that a station file's link leads to.

        Parameters
        ----------
        config : ChamberConfig
        patience_s : float
            Real seconds to wait for a guardian whose controller is dead.
        salt : str
            Another one is another set of locks; for tests.

        Raises
        ------
        ChamberHeldError
            If somebody holds it; the message says who, and since when.
        LinkError
            If the chamber's host has no address.
        """
        names = lock_names(config, salt=salt)
        began_s = time.monotonic()
        while True:
            sockets: list[socket.socket] = []
            try:
                for name in names:
                    sockets.append(_bound(name))
                return cls(sockets)
            except OSError as err:
                for one in sockets:
                    one.close()
                if err.errno != errno.EADDRINUSE:
                    raise LinkError(f"chamber {config.url}: lock: {err.strerror}") from None
            holder = find_holder(config, salt=salt)
            waited_s = time.monotonic() - began_s
            if holder is not None:
                limit_s = patience_s if holder.is_guardian else min(RACE_S, patience_s)
                if waited_s >= limit_s:
                    raise ChamberHeldError(config.url, holder)
            time.sleep(PAUSE_S)

    @classmethod
    def inherit(cls, fds: Sequence[int]) -> "ChamberLock":
        """Take over the descriptors that a parent process passed on."""
        return cls([socket.socket(fileno=fd) for fd in fds])

    @property
    def fds(self) -> tuple[int, ...]:
        """The descriptors to pass on."""
        return tuple(one.fileno() for one in self._sockets)

    def tell(self, told: dict[str, object]) -> None:
        """Tell one process that asks who holds the chamber; never waits."""
        for one in self._sockets:
            one.setblocking(False)
            with contextlib.suppress(OSError):
                asker, _ = one.accept()
                with asker:
                    asker.setblocking(False)
                    asker.send(json.dumps(told).encode())

    def release(self) -> None:
        """Let go; harmless when done twice. What a child inherited it still holds."""
        for one in self._sockets:
            one.close()
        self._sockets.clear()


def find_holder(config: ChamberConfig, *, salt: str = "") -> Holder | None:
    """Return who holds a chamber, or None when nobody does.

    Raises
    ------
    LinkError
        If the chamber's host has no address.
    """
    for name in lock_names(config, salt=salt):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(ANSWER_S)
            try:
                asking.connect(name)
            except ConnectionRefusedError:
                continue
            except OSError:  # too many ask at once: somebody holds it all the same
                return Holder()
            return _ask_holder(asking)
    return None


def _ask_holder(asking: socket.socket) -> Holder:
    size = struct.calcsize("3i")
    pid, uid, _ = struct.unpack(
        "3i", asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    )
    told: dict[str, object] = {}
    with contextlib.suppress(OSError, ValueError, TypeError):
        told = dict(json.loads(asking.recv(4096)))
    state, held_s = process_state(pid, uid)
    guardian = told.get("guardian_pid")
    return Holder(
        user=user_name(uid),
        pid=pid or None,
        state=state,
        held_s=held_s,
        test_id=str(told.get("test_id", "")),
        guardian_pid=guardian if isinstance(guardian, int) else None,
        phase=str(told.get("phase", "")),
    )


def lock_names(config: ChamberConfig, *, salt: str = "") -> tuple[str, ...]:
    """Return the names of a chamber's locks; all must be held, any one shared is a conflict.

    A host is every address it has, with all of this machine's own being one; the port is the one
    in force. A serial port is its device, however it is linked to. Transport and unit do not
    count: two units of one gateway are one chamber here, for some controllers answer to any unit.

    Raises
    ------
    LinkError
        If the URL is of no known kind, or the host has no address.
    """
    try:
        end = parse_modbus_url(config.url)
    except ValueError as err:
        raise LinkError(f"chamber: {err}") from None
    if end.transport == "rtu":
        places = [_device(end.host)]
    else:
        places = [f"{address} port {end.port}" for address in _addresses(end.host, config.url)]
    digests = (hashlib.sha256(f"{salt}{place}".encode()).hexdigest() for place in places)
    return tuple(sorted({f"\0accelbench-chamber-{digest[:32]}" for digest in digests}))


def _device(path: str) -> str:
    real = os.path.realpath(path)
    with contextlib.suppress(OSError):
        found = os.stat(real)
        if stat.S_ISCHR(found.st_mode):  # two nodes of one device are one
            return f"device {found.st_rdev}"
    return f"device {real}"


def _addresses(host: str, url: str) -> set[str]:
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as err:
        reason = getattr(err, "strerror", None) or str(err)
        raise LinkError(f"chamber {url}: {host!r} has no address: {reason}") from None
    return {THIS_MACHINE if _is_own(a[4]) else _plain(str(a[4][0])) for a in found}


def _plain(address: str) -> str:
    """Return an address in one spelling; IPv4 in IPv6's clothes is IPv4."""
    with contextlib.suppress(ValueError):
        parsed = ipaddress.ip_address(address)
        mapped = getattr(parsed, "ipv4_mapped", None)
        return str(mapped or parsed)
    return address


def _is_own(where: tuple[object, ...]) -> bool:
    """Return True if an address is one of this machine's: only those can be bound."""
    address = _plain(str(where[0]))
    with contextlib.suppress(ValueError):
        parsed = ipaddress.ip_address(address.partition("%")[0])
        if parsed.is_loopback or parsed.is_unspecified:
            return True
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    scope = where[3] if len(where) > 3 else 0
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((address, 0, 0, scope) if family == socket.AF_INET6 else (address, 0))
    except OSError:
        return False
    return True


def _bound(name: str) -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        made.bind(name)
        made.listen(socket.SOMAXCONN)
    except BaseException:
        made.close()
        raise
    return made


def _duration(time_s: float) -> str:
    minutes, seconds = divmod(int(time_s), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
