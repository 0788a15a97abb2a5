"""A chamber, a multimeter and a head in a process of their own, spoilt on command.

Written from the makers' tables alone: it shares no code with the drivers nor with the emulators of
the project. One plant moves behind all three. Everything that is written to the chamber and every
value that is served goes to a log, a JSON document a line, with the machine's monotonic time.

    bench.py FOLDER SPEED MODEL SERIAL,SERIAL…
"""

import json
import os
import socket
import sys
import threading
import time
from pathlib import Path

from bench_chamber import Chamber
from bench_lines import Digitiser, Head
from bench_plant import Log, Plant


def control(folder: Path, chamber: Chamber, digitiser: Digitiser, head: Head) -> None:
    """Answer a command a connection until the socket is asked to end."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(folder / "panel"))
    listener.listen(8)
    sys.stdout.write(json.dumps({"port": chamber.port, "digitiser": digitiser.path,
                                 "head": head.path}) + "\n")  # fmt: skip
    sys.stdout.flush()
    while True:
        connection, _ = listener.accept()
        with connection:
            device, *words = connection.recv(4096).decode().split()
            if device == "end":
                return
            if device == "chamber":
                chamber.log.say("panel", words=words)
                chamber.panel(words)
            elif device == "digitiser":
                digitiser.panel(words)
            elif device == "head":
                head.panel(words)
            state = {
                "setpoint_c": chamber.setpoint_c, "mode": chamber.mode, "ramp": chamber.ramp,
                "profile": chamber.profile, "state": chamber.state, "air_c": chamber.plant.air_c,
                "t": time.monotonic(),
            }  # fmt: skip
            connection.sendall(json.dumps(state).encode())


def main() -> None:
    folder, speed, model, serials = sys.argv[1:5]
    log = Log(Path(folder) / "bench.jsonl")
    plant = Plant(float(speed))
    names = serials.split(",")
    chamber = Chamber(plant, log, model)
    threading.Thread(target=orphaned, daemon=True).start()
    control(Path(folder), chamber, Digitiser(plant, log, names), Head(plant, log))


def orphaned() -> None:
    """End when nobody is left to ask for it."""
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    main()
