"""Lateness of a 10 Hz, 16-channel run on emulated instruments, in real time.

    python benchmarks/bench_schedule.py [SECONDS]

Controller, emulated chamber (TCP), multimeter and head (pseudo-terminals), the physical twin and
the durable store share the machine, so this is an upper bound of what the controller adds.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from drivers.clock import RealClock
from drivers.station import StationConfig
from thermo.launch.emulated import run_emulated
from thermo.planning.default_station import default_station
from thermo.planning.sequence import Sequence
from thermo.station.job import make_job
from thermo.store.store import open_store

ACCELEROMETERS = 8  # an output and a thermistor each: 16 channels
RATE_HZ = 10.0


def sequence(seconds: float) -> Sequence:
    return Sequence.model_validate(
        {
            "name": "lateness",
            "accelerometers": tuple(
                {"serial": f"A{k}", "nominal_scale": 1.3} for k in range(ACCELEROMETERS)
            ),
            "temperature": {
                "start_c": 25.0,
                "segments": ({"kind": "ramp", "to_c": 25.0 + seconds / 60, "rate_c_per_min": 1.0},),
            },
            "positions": {"angles_deg": (90.0,)},
            "sampling": {"period_s": 1 / RATE_HZ, "settle_s": 0.0, "switch_s": 0.002},
        }
    )


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    asked = sequence(seconds)
    data = default_station(asked).model_dump()
    data["digitiser"]["nplc"] = 0.02
    with tempfile.TemporaryDirectory() as folder:
        url = Path(folder) / "bench.sqlite"
        config = StationConfig.model_validate(data)
        outcome = run_emulated(make_job(asked, url, config), clock=RealClock())
        with open_store(url) as store:
            frame = store.readings(outcome.test_id)
    ms = 1000 * frame.groupby("slot")["lateness_s"].first().to_numpy()
    print(f"{outcome.status}: {len(ms)} scans of {2 * ACCELEROMETERS} channels at {RATE_HZ:g} Hz")
    print(f"slots without a reading: {outcome.skipped}")
    print(
        f"lateness: median {np.median(ms):.2f} ms, p99 {np.percentile(ms, 99):.2f} ms, "
        f"max {ms.max():.2f} ms"
    )
    # drift: the mean lateness of the last fifth against that of the first
    fifth = max(1, len(ms) // 5)
    print(f"drift over the run: {np.mean(ms[-fifth:]) - np.mean(ms[:fifth]):+.2f} ms")


if __name__ == "__main__":
    main()
