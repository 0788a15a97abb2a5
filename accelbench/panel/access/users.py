"""Users of the page: names, roles, passwords; the file of them, and log-ins that come too fast."""

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from pydantic import BaseModel, ConfigDict, Field, model_validator

from errormodel.errors import InputError
from errormodel.io.atomic import write_files
from errormodel.io.toml import read_toml
from errormodel.io.toml_write import toml_text

Role: TypeAlias = Literal["view", "operate", "administer"]
ROLES: tuple[Role, ...] = ("view", "operate", "administer")  # each may do what those before may
LEAST_PASSWORD = 10  # characters

# of one address, before it has to wait; each further failure doubles the wait
FREE_FAILURES = 3
FIRST_WAIT_S = 2.0
LONGEST_WAIT_S = 900.0
MOST_ADDRESSES = 10_000

_HASHER = PasswordHasher()


class User(BaseModel):
    """One user of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}$")]
    role: Role
    password: Annotated[str, Field(pattern=r"^\$argon2id\$")]


class UserFile(BaseModel):
    """The users of a page; `password` holds an Argon2 hash, never the password itself."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    user: tuple[User, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> "UserFile":
        names = [u.name.lower() for u in self.user]
        if len(set(names)) != len(names):
            raise ValueError("a name is listed twice")
        return self


def may(role: Role, needed: Role) -> bool:
    """Tell whether a role includes another."""
    return ROLES.index(role) >= ROLES.index(needed)


def read_users(path: Path) -> UserFile:
    """Read a file of users.

    Raises
    ------
    InputError
        If it is none, or has no user.
    """
    found = read_toml(path, UserFile)
    if not found.user:
        raise InputError(path, "", "no user; `accelbench panel-user` adds one")
    return found


def add_user(path: Path, name: str, role: Role, password: str) -> None:
    """Add a user to a file, or give one a new role and password; the file is made if needed.

    Raises
    ------
    InputError
        If the password is shorter than ten characters, or the name is none.
    """
    if len(password) < LEAST_PASSWORD:
        raise InputError("password", "", f"has fewer than {LEAST_PASSWORD} characters")
    before = read_toml(path, UserFile).user if path.exists() else ()
    try:
        made = User(name=name, role=role, password=_HASHER.hash(password))
    except ValueError:
        raise InputError(name, "name", "expected letters, digits, _ . @ -") from None
    kept = [u for u in before if u.name.lower() != name.lower()]
    text = toml_text({"user": [u.model_dump() for u in (*kept, made)]})
    write_files([(path, text.encode())])
    path.chmod(0o600)


def check_password(users: UserFile, name: str, password: str) -> User | None:
    """Return the user of a name and password; None if there is none.

    A name that is unknown takes as long as a wrong password.
    """
    found = next((u for u in users.user if u.name.lower() == name.lower()), None)
    try:
        _HASHER.verify(found.password if found else _nobody(), password)
    except (VerificationError, InvalidHashError):
        return None
    return found


_NOBODY: list[str] = []


def _nobody() -> str:
    """Return the hash of a password that nobody has."""
    if not _NOBODY:
        _NOBODY.append(_HASHER.hash(secrets.token_hex()))
    return _NOBODY[0]


@dataclass(slots=True)
class LoginLimit:
    """Makes an address wait after wrong log-ins, twice as long each time."""

    clock: Callable[[], float] = time.monotonic
    _failures: dict[str, tuple[int, float]] = field(default_factory=dict[str, tuple[int, float]])

    def wait_s(self, address: str) -> float:
        """Return the seconds that an address still has to wait."""
        _, until_s = self._failures.get(address, (0, 0.0))
        return max(0.0, until_s - self.clock())

    def failed(self, address: str) -> None:
        """Count a wrong log-in."""
        if len(self._failures) >= MOST_ADDRESSES:
            self._failures.pop(next(iter(self._failures)))
        count = self._failures.pop(address, (0, 0.0))[0] + 1
        over = count - FREE_FAILURES
        wait_s = min(LONGEST_WAIT_S, FIRST_WAIT_S * 2.0 ** min(over, 20)) if over >= 0 else 0.0
        self._failures[address] = (count, self.clock() + wait_s)

    def succeeded(self, address: str) -> None:
        """Forget the wrong log-ins of an address."""
        self._failures.pop(address, None)
