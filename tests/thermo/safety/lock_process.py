"""Take a chamber's lock, say what came of it, and hold it until standard input ends.

Arguments: salt, URL, user id (the present one if 0), and "fork" to let a child hold it alone.
"""

import os
import sys

from drivers.station import ChamberConfig
from thermo.safety.chamber_lock import ChamberHeldError, ChamberLock


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    salt, url, uid, *fork = sys.argv[1:]
    config = ChamberConfig(model="watlow_f4t", url=url)
    "host".encode("idna")  # imported lazily, from where another user may not read
    if int(uid):
        os.setuid(int(uid))
    try:
        lock = ChamberLock.take(config, salt=salt)
    except ChamberHeldError as err:
        say(f"refused {err}")
        return
    if fork and os.fork():
        os._exit(0)  # as a killed controller: its child keeps what it inherited
    say(f"held {lock.fds}")
    sys.stdin.read()


if __name__ == "__main__":
    main()
