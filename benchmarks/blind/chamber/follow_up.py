"""Do what the workflow proposes: measure the same accelerometer again by its sequence file.

    python -m benchmarks.blind.chamber.follow_up --work build/hidden

after the benchmark has been run and scored in that folder. For the sets whose answer left something
open (effects that the protocol cannot show, lags too fast to be told from a rate term) the
command is asked again for its proposal; the sequence is carried out by the generator, and the
workflow answers for both records together.
"""

import argparse
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind.benchmark import BARE
from benchmarks.blind.chamber.answering import ask_workflow
from benchmarks.blind.chamber.physics import Corners, Protocol
from benchmarks.blind.chamber.truth import write_more
from benchmarks.blind.scoring import Scored, score

ROOT = Path(__file__).parents[3]
GROUPS = ("invisible", "fast lag")


def corners_of(temperature: Mapping[str, Any]) -> Corners:
    """Return the corners of one run of a sequence file's `[temperature]`."""
    minute, now = 0.0, float(temperature["start_c"])
    corners = [(minute, now)]
    for kind, value, rate in _steps(temperature["segments"]):
        if kind == "hold":
            minute += value
        else:
            minute, now = minute + abs(value - now) / rate, value
        corners.append((minute, now))
    return tuple(corners)


def _steps(segments: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, float, float]]:
    for one in segments:
        if "positions" in one or (one["kind"] == "hold" and "temp_c" in one):
            raise ValueError(f"a segment that this generator cannot do: {dict(one)}")
        if one["kind"] == "hold":
            yield "hold", one["duration_min"], 0.0
        elif one["kind"] == "ramp":
            yield "ramp", one["to_c"], one["rate_c_per_min"]
        else:
            for _ in range(one.get("count", 1)):
                for end in ("high_c", "low_c"):
                    yield "ramp", one[end], one["rate_c_per_min"]
                    yield "hold", one.get("soak_min", 0.0), 0.0


def protocol_of(text: str) -> Protocol:
    """Return the protocol that a sequence file describes."""
    asked = tomllib.loads(text)
    positions, sampling, temperature = asked["positions"], asked["sampling"], asked["temperature"]
    period = float(sampling["period_s"])
    return Protocol(
        name="proposed",
        runs=tuple(corners_of(temperature) for _ in range(temperature.get("repeats", 1))),
        angles_deg=tuple(map(float, positions["angles_deg"])),
        random_order=positions.get("order", "fixed") == "random",
        dwell_s=period * positions.get("readings_per_position", 1),
        period_s=period,
        rest_s=3600.0 * temperature.get("rest_h", 0.0),
        mount_deg=float(asked.get("accelerometers", [{}])[0].get("mount_deg", 0.0)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """What became of an open question."""

    before: Scored
    after: Scored | None  # None where nothing was proposed
    d: float  # of the hidden effect in the new record


def follow(work: Path, number: int, program: Path) -> Settled:
    """Carry out the proposal for one data set and ask again."""
    name = f"set-{number:04d}"
    folder, sequence = work / "data" / name, work / "next" / f"{name}.toml"
    key = json.loads((work / "keys" / f"{name}.json").read_text(encoding="utf-8"))
    sequence.parent.mkdir(parents=True, exist_ok=True)
    sequence.unlink(missing_ok=True)  # of an earlier time: the command writes over nothing
    first = ask_workflow(folder, program, *BARE, "--experiment-out", str(sequence))
    before = score(name, key, first)
    if before.outcome == "named" or not sequence.exists():  # settled, or nothing proposed
        return Settled(before=before, after=None, d=0.0)
    protocol = protocol_of(sequence.read_text(encoding="utf-8"))
    d = write_more(folder / "next.csv", key, protocol, [*key["seed"], 1])
    answer = ask_workflow(folder, program, *BARE, files=("run.csv", "next.csv"))
    hidden = {n: {**v, "d": d[n]} for n, v in key["hidden"].items()}
    after = score(name, {**key, "group": "single", "hidden": hidden}, answer)
    return Settled(before=before, after=after, d=min(d.values()))


def table(settled: Sequence[Settled]) -> str:
    """Return one line for each question."""
    head = "| hidden | protocol | first | d in the new record | then |\n|---|---|---|---|---|\n"
    lines: list[str] = []
    for s in settled:
        hidden = ", ".join(f"{n} {v['size']:.3g} {v['unit']}" for n, v in s.before.hidden.items())
        said = [*s.before.bare, *(" or ".join(a) for a in s.before.aliases)]
        first = f"{s.before.verdict} {', '.join(said)}"
        then = "nothing proposed"
        if s.after is not None:
            named = [*s.after.bare, *(" or ".join(a) for a in s.after.aliases)]
            then = f"{s.after.outcome}: {', '.join(named) or s.after.verdict}"
        elif s.before.outcome == "named":
            then = "not needed"
        lines.append(f"| {hidden} | {s.before.protocol} | {first} | {s.d:.1f} | {then} |")
    return head + "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Carry out the experiments that were proposed.")
    parser.add_argument("--work", type=Path, default=ROOT / "build/hidden")
    parser.add_argument("--program", type=Path, default=ROOT)
    asked = parser.parse_args(argv)
    settled: list[Settled] = []
    for path in sorted((asked.work / "keys").glob("set-*.json")):
        if json.loads(path.read_text(encoding="utf-8"))["group"] in GROUPS:
            settled.append(
                follow(asked.work.resolve(), int(path.stem[4:]), asked.program.resolve())
            )
            sys.stderr.write(f"\r{path.stem} ")
    sys.stdout.write("\n" + table(settled) + "\n")
    open_first = [s for s in settled if s.before.outcome != "named"]
    after = Counter(s.after.outcome if s.after else "nothing proposed" for s in open_first)
    sys.stdout.write(f"\nopen at first: {len(open_first)}; then {dict(after)}\n")
    return 0 if after["named"] == len(open_first) else 1


if __name__ == "__main__":
    sys.exit(main())
