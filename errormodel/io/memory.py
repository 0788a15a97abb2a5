"""Memory that a table needs, and refusal of what would not fit before it is read."""

import resource
from contextlib import suppress
from pathlib import Path

from errormodel.errors import InputError

# A fit holds about this many times its table: the readings, the signals made of them, and the
# derivative of a model of some fifteen coefficients (benchmarks/bench_memory.py measures it).
FACTOR = 6
KIB = 1024


def available_bytes() -> int | None:
    """Return how much memory this process can still take, None where the system does not say.

    The least of what the machine has free, what the control groups of the process allow and
    what its own limit of address space leaves.
    """
    found = [_of_machine(), *_of_control_groups(), _of_address_space()]
    known = [value for value in found if value is not None]
    return max(min(known), 0) if known else None


def refuse_what_does_not_fit(path: Path, needed: float, what: str) -> None:
    """Refuse a file that would need more memory than there is.

    Parameters
    ----------
    path : Path
    needed : float
        Bytes.
    what : str
        What needs them, in words: "1000 rows of 6 columns".

    Raises
    ------
    InputError
        Saying how much is needed and available.
    """
    available = available_bytes()
    if available is not None and needed > available:
        problem = (
            f"{what} need about {needed / 1e9:.3g} GB of memory, {available / 1e9:.3g} GB are "
            "available; thin the readings out, or give runs or accelerometers one by one"
        )
        raise InputError(path, "", problem)


def _of_machine() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * KIB
    return None


def _of_control_groups() -> list[int]:
    """Return what each control group of this process and those around it leave."""
    left: list[int] = []
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds == "":  # version 2
                root, names = Path("/sys/fs/cgroup"), ("memory.max", "memory.current")
            elif "memory" in kinds.split(","):
                root = Path("/sys/fs/cgroup/memory")
                names = ("memory.limit_in_bytes", "memory.usage_in_bytes")
            else:
                continue
            own = root / name.lstrip("/")
            for folder in (own, *own.parents):
                if folder.is_relative_to(root) and (value := _group_left(folder, *names)):
                    left.append(value)
    return left


def _group_left(folder: Path, limit: str, usage: str) -> int | None:
    """Return a group's limit less its use; what is cached of files is given back at need."""
    with suppress(OSError, ValueError):
        most, used = int((folder / limit).read_text()), int((folder / usage).read_text())
        for line in (folder / "memory.stat").read_text().splitlines():
            name, _, value = line.partition(" ")
            if name in {"inactive_file", "total_inactive_file"}:
                used -= int(value)
                break
        return max(most - used, 1)
    return None


def _of_address_space() -> int | None:
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return None
    with suppress(OSError, ValueError, IndexError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        return most - pages * resource.getpagesize()
    return most
