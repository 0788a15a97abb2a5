"""Log-ins: sessions that expire, kept on the server under a random token."""

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from accelbench.panel.access.users import Role, may
from errormodel.errors import WorkbenchError

COOKIE = "accelbench_session"
IDLE_S = 12 * 3600.0  # a night's test and its morning
LONGEST_S = 7 * 24 * 3600.0
MOST_SESSIONS = 1000


class NotAllowedError(WorkbenchError):
    """The visitor is not logged in any more, or has no role that may do it."""


@dataclass(slots=True)
class Visitor:
    """A person at a browser: name, role, and until when the log-in holds."""

    name: str
    role: Role
    began_s: float = 0.0
    seen_s: float = 0.0
    ended: bool = False
    is_dark: bool | None = None  # None: as the browser has it


@dataclass(slots=True)
class Sessions:
    """The log-ins of a page.

    Parameters
    ----------
    everybody : Visitor, optional
        Who everybody is where there are no users.
    clock : callable
        Seconds that only grow.
    """

    everybody: Visitor | None = None
    clock: Callable[[], float] = time.monotonic
    _known: dict[str, Visitor] = field(default_factory=dict[str, Visitor])

    def begin(self, name: str, role: Role) -> str:
        """Log a person in and return the token of the session."""
        for token in [t for t, v in self._known.items() if not self.holds(v)]:
            del self._known[token]
        while len(self._known) >= MOST_SESSIONS:
            self._known.pop(next(iter(self._known))).ended = True
        token, now_s = secrets.token_urlsafe(32), self.clock()
        self._known[token] = Visitor(name, role, began_s=now_s, seen_s=now_s)
        return token

    def find(self, token: str | None) -> Visitor | None:
        """Return who has a token; None if nobody, or the log-in has expired."""
        if self.everybody is not None:
            return self.everybody
        visitor = self._known.get(token or "")
        if visitor is None or not self.holds(visitor):
            return None
        visitor.seen_s = self.clock()
        return visitor

    def end(self, token: str | None) -> None:
        """Log a person out; pages that are still open can do nothing more."""
        visitor = self._known.pop(token or "", None)
        if visitor is not None:
            visitor.ended = True

    def holds(self, visitor: Visitor) -> bool:
        """Tell whether a log-in still holds."""
        if visitor is self.everybody:
            return True
        now_s = self.clock()
        fresh = now_s - visitor.seen_s < IDLE_S and now_s - visitor.began_s < LONGEST_S
        return fresh and not visitor.ended

    def need(self, visitor: Visitor, role: Role) -> None:
        """Refuse what a visitor may not do.

        Raises
        ------
        NotAllowedError
            If the log-in has expired, or its role does not include `role`.
        """
        if not self.holds(visitor):
            raise NotAllowedError("the log-in has expired; log in again")
        if not may(visitor.role, role):
            raise NotAllowedError(f"{visitor.name} may {visitor.role}; this needs {role}")
        visitor.seen_s = self.clock()
