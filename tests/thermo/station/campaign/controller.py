"""A controller forked from this process, which tells every acknowledged reading to a file."""

import json
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import accelbench.commands.run.work
import thermo.launch.real
from accelbench.cli import main as run_command


class Teller:
    """Every acknowledged reading, a line each in a file that a killed process leaves behind."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def on_reading(self, run, rows):
        said = [[run, r.slot, r.attempt, r.serial, r.output] for r in rows]
        os.write(self._fd, "".join(json.dumps(s) + "\n" for s in said).encode())

    def on_progress(self, progress):
        pass

    def on_event(self, event):
        pass


def tell(path: Path) -> None:
    """Let tests that this process runs tell their acknowledged readings to a file."""
    inner = thermo.launch.real.run_on_station

    def told(*args, observers=(), **more):
        if "FAULTS_SILENCE_S" in os.environ:
            more["silence_s"] = float(os.environ["FAULTS_SILENCE_S"])
        return inner(*args, observers=[*observers, Teller(path)], **more)

    accelbench.commands.run.work.run_on_station = told


class Process:
    """`accelbench ARGS…` in a process of its own, without paying for its imports again."""

    def __init__(self, folder, args, *, acks=None, fds=None, tty=None, **environment) -> None:
        self.args = args
        self.out, self.err = (folder / f"{time.monotonic_ns()}.{n}" for n in ("out", "err"))
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        self.code: int | None = None
        if self.pid == 0:
            try:
                self._become(folder, acks, fds or {}, tty, environment)
            finally:
                os._exit(99)

    def _become(self, folder, acks, fds, tty, environment) -> None:
        os.setsid()
        for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}:
            if signal.getsignal(number) is not signal.SIG_DFL:
                signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        os.dup2(os.open("/dev/null", os.O_RDONLY), 0)
        for number, path in ((1, self.out), (2, self.err)):
            if number in fds and fds[number] is None:
                os.close(number)
            else:
                os.dup2(fds[number] if number in fds else os.open(path, flags), number)
        if tty is not None:
            os.close(os.open(tty, os.O_RDWR))  # the session's leader gets its terminal by opening
        os.closerange(3, 256)
        os.chdir(folder)
        os.environ.update(environment)
        if fds or tty:  # how the interpreter ends is part of the answer then
            os.execv(sys.executable, [sys.executable, __file__, str(acks),
                                      *self.args])  # fmt: skip
        if acks is not None:
            tell(acks)
        sys.argv = ["accelbench", *self.args]
        try:
            code = run_command()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(code)

    def kill(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def poll(self) -> int | None:
        if self.code is None:
            done, status = os.waitpid(self.pid, os.WNOHANG)
            if done:
                self.code = os.waitstatus_to_exitcode(status)
        return self.code

    def wait(self, patience_s: float) -> int | None:
        give_up = time.monotonic() + patience_s
        while self.poll() is None and time.monotonic() < give_up:
            time.sleep(0.02)
        return self.code

    def children(self) -> list[int]:
        path = Path(f"/proc/{self.pid}/task/{self.pid}/children")
        found = []
        for task in Path(f"/proc/{self.pid}/task").glob("*/children"):
            found += [int(p) for p in task.read_text().split()]
        return found or [int(p) for p in path.read_text().split()]

    def text(self) -> str:
        return "".join(p.read_text(errors="replace") for p in (self.out, self.err) if p.exists())


if __name__ == "__main__":
    tell(Path(sys.argv[1]))
    sys.argv = ["accelbench", *sys.argv[2:]]
    sys.exit(run_command())
