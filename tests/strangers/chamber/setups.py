"""Set-ups of chamber tests, drawn from a seed: programme, positions, sampling, faults."""

from dataclasses import dataclass

import numpy as np

from tests.strangers.chamber.physics import Accelerometer, Array, Faults, Run, record

Plan = tuple[Array, Array, Array, Array | None]
UNITS = [("mA", 1.3), ("V", 0.25), ("count", 8.0e5), ("m/s2", 9.80665), ("g", 1.0), ("mA", -1.3)]
# fmt: off
HEADS = {
    "four": [0, 90, 180, 270], "eight": list(range(0, 360, 45)), "six": list(range(0, 360, 60)),
    "up down": [90, 270], "twelve": list(range(0, 360, 30)), "odd angles": [30, 150, 200, 310],
    "three": [0, 90, 270], "up": [90], "none": [90], "forces": [90],
}
_random = np.random.default_rng(5).standard_normal((14, 3))
AXES = np.vstack([np.eye(3), -np.eye(3), _random / np.linalg.norm(_random, axis=1)[:, None]])
PROGRAMMES = {  # (share of the run, share of the range)
    "loop": [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0)],
    "from above": [(0.0, 1.0), (0.5, 0.0), (1.0, 1.0)],
    "from the middle": [(0.0, 0.5), (0.25, 1.0), (0.75, 0.0), (1.0, 0.5)],
    "heating": [(0.0, 0.0), (1.0, 1.0)], "cooling": [(0.0, 1.0), (1.0, 0.0)],
    "soak each end": [(0, 0), (0.15, 0), (0.45, 1), (0.6, 1), (0.9, 0), (1, 0)],
    "two soaks": [(0.0, 0.0), (0.5, 0.0), (0.5001, 1.0), (1.0, 1.0)],
    "one temperature": [(0.0, 0.5), (1.0, 0.5)],
    "stairs": [(k / 11 + share, 1 - abs(k - 5) / 5) for k in range(11) for share in (0.0, 0.06)],
}
# kind: what of Faults is drawn, and between which sizes
KINDS: dict[str, dict[str, tuple[float, float]]] = {
    "sound": {}, "sound, drift": {"drift_ug": (1.0, 10.0), "drift_tau_s": (1000.0, 9000.0)},
    "Student 3": {"tails": (3.0, 3.0)}, "bursts": {"burst_share": (0.001, 0.05)},
    "walk": {"walk_ug_per_rt_h": (3.0, 40.0)}, "flicker": {"flicker_ug": (2.0, 40.0)},
    "linear": {"linear_ug_per_h": (1.0, 30.0)}, "daily": {"daily_ug": (5.0, 100.0)},
    "step": {"step_ug": (10.0, 300.0)}, "runs K0": {"run_k0_ug": (5.0, 200.0)},
    "runs K1": {"run_k1_ppm": (5.0, 200.0)}, "runs thermistor": {"run_temp_c": (0.02, 1.0)},
    "odd run": {"odd_run_ug": (20.0, 500.0)}, "gradient": {"rate_ug": (3.0, 60.0)},
    "gradient of scale": {"rate_ppm": (3.0, 60.0)}, "lag": {"lag_s": (20.0, 900.0)},
    "loop of bias": {"loop_ug": (3.0, 80.0), "loop_width_c": (3.0, 40.0)},
    "loop of scale": {"loop_ppm": (3.0, 80.0), "loop_width_c": (3.0, 40.0)},
    "thermistor noise": {"temp_noise_c": (0.01, 0.5)},
    "thermistor steps": {"temp_step_c": (0.02, 1.0)},
    "output steps": {"output_step_ug": (10.0, 2000.0)},
    "unsettled": {"settle_ug": (20.0, 5000.0), "settle_s": (3.0, 60.0)},
    "knee of bias": {"kink_ug": (10.0, 300.0)}, "knee of scale": {"k1_kink_ppm": (10.0, 300.0)},
    "K2 over temperature": {"k2_slope": (0.05, 2.0)},
    "misalignment over temperature": {"delta_slope": (0.05, 2.0)},
    "asymmetry": {"asymmetry_ug": (10.0, 300.0)}, "saturation": {"saturate_g": (0.9, 0.999)},
    "head, stated": {"head_urad": (1.0, 20.0), "state_head": (1.0, 1.0)},
    "thermistor, stated": {"temp_offset_c": (-0.5, 0.5), "state_temp": (1.0, 1.0)},
}
# fmt: on


@dataclass(frozen=True)
class SetUp:
    """A campaign of runs of one accelerometer, drawn whole from `seed`."""

    seed: list[int]
    kinds: list[str]
    sensor: Accelerometer
    unit: str
    nominal: float
    faults: Faults
    programme: str
    head: str
    range_c: tuple[float, float]
    hours: float
    runs: int
    rows: int
    dwell: int
    sampling: str
    t_ref_c: float
    gravity: float
    there: float

    def truth(self, constant: bool = False) -> dict[str, float]:
        """Return the true coefficients, those of an unknown input over the nominal scale."""
        found = self.sensor.coefficients(self.t_ref_c, constant)
        ratio = self.sensor.scale / self.nominal if constant else 1.0
        return {name: ratio * value for name, value in found.items()}

    def plan(self, rng: np.random.Generator, haste: float = 1.0) -> Plan:
        """Return times, temperatures, angles and forces of one run, `haste` times as fast."""
        time = np.linspace(0.0, 3600.0 * self.hours / haste, self.rows).round(3)
        if self.sampling == "jitter":
            time[1:] += rng.uniform(0.0, 0.8, self.rows - 1) * time[1]
        if self.sampling == "gaps":
            time = time + 900.0 * (time > 0.3 * time[-1]) + 1800.0 * (time > 0.7 * time[-1])
        share, level = np.array(PROGRAMMES[self.programme], dtype=float).T
        low, high = self.range_c
        temp = np.asarray(low + (high - low) * np.interp(time / time[-1], share, level))
        if self.programme in ("two soaks", "stairs"):
            keep = np.exp(-np.diff(time, prepend=time[0]) / 300.0)
            for k in range(1, self.rows):
                temp[k] += keep[k] * (temp[k - 1] - temp[k])
        visit = np.arange(self.rows) // self.dwell
        if self.head == "forces":
            return time, temp, np.zeros(self.rows), AXES[visit % len(AXES)]
        angles = np.array(HEADS[self.head], dtype=float)
        return time, temp, angles[visit % len(angles)], None

    def record(self, haste: float = 1.0, site: float = 1.0, more: int = 0) -> list[Run]:
        """Record all runs, or, with `more`, one run that the fit has not seen."""
        rng = np.random.default_rng([*self.seed, 7, more])
        out: list[Run] = []
        odd = 1 if self.runs > 1 and not more else -1
        for k in range(1 if more else self.runs):
            fault = self.faults
            k0 = fault["run_k0_ug"] * rng.standard_normal() + fault["odd_run_ug"] * (k == odd)
            sensor = self.sensor.shifted(k0, fault["run_k1_ppm"] * rng.standard_normal())
            offset = fault["temp_offset_c"] + fault["run_temp_c"] * rng.standard_normal()
            fault = Faults(fault | {"temp_offset_c": offset})
            began = 3600.0 * (self.hours + 2.0) * (k + (self.runs if more else 0))
            out.append(record(sensor, fault, self.plan(rng, haste), rng, began, site))
        return out

    def following(self) -> Run:
        """Record the run that comes after those fitted, perhaps faster, at its own site."""
        haste = float(np.random.default_rng([*self.seed, 9]).choice([1.0, 3.0]))
        return self.record(haste, self.there / self.gravity, more=1)[0]


def draw(seed: int, number: int) -> SetUp:
    """Draw set-up `number` of a seed: kinds in turn, one in six with a second one."""
    rng = np.random.default_rng([seed, number])
    names = list(KINDS)
    kinds = [names[number % len(names)]]
    if rng.random() < 1.0 / 6.0:
        kinds.append(str(rng.choice(names[2:])))
    sizes: dict[str, float] = {"temp_noise_c": 0.002}
    for kind in kinds:
        for name, (low, high) in KINDS[kind].items():
            sizes[name] = rng.uniform(low, high)
            if low > 0.0:
                sizes[name] = low * (high / low) ** rng.random()
    sizes["white_ug"] = float(rng.choice([1.0, 5.0, 20.0]))
    unit, nominal = UNITS[rng.integers(len(UNITS))]
    programme = str(rng.choice(list(PROGRAMMES), p=[0.3, *[0.7 / 8] * 8]))
    head = str(rng.choice(list(HEADS), p=[0.2, 0.2, *[0.6 / 8] * 8]))
    centre, half = rng.uniform(0.0, 40.0), float(rng.choice([2.0, 10.0, 30.0, 55.0]))
    runs = int(rng.choice([1, 2, 2, 3, 4, 8]))
    gravity, there = rng.choice([9.80665, 9.7803, 9.8322], 2).tolist()
    return SetUp(
        seed=[seed, number],
        kinds=kinds,
        sensor=_sensor(nominal, head == "forces", rng),
        unit=unit,
        nominal=nominal,
        faults=Faults(sizes),
        programme=programme,
        head=head,
        range_c=(round(centre - half, 1), round(centre + half, 1)),
        hours=float(rng.choice([2.0, 5.0, 10.0])),
        runs=runs,
        rows=min(400, 1200 // runs),
        dwell=int(rng.choice([1, 3, 8])),
        sampling=str(rng.choice(["even", "jitter", "gaps"], p=[0.6, 0.2, 0.2])),
        t_ref_c=float(rng.choice([25.0, 25.0, 0.0, 45.0])),
        gravity=gravity,
        # without a known input nobody can say what of K0 is the site's
        there=there if head != "none" else gravity,
    )


def _sensor(nominal: float, triaxial: bool, rng: np.random.Generator) -> Accelerometer:
    orders = rng.integers(1, 5, 2)
    k0 = rng.normal(0.0, [1500.0, 20.0, 0.15, 8e-4, 8e-6])[: orders[0] + 1]
    k1 = rng.normal(0.0, [120.0, 0.3, 1e-3, 8e-6])[: orders[1]]
    static = dict(
        zip(["k2", "k3", "delta_o", "k_ip"], rng.normal(0.0, [15, 8, 150, 8]), strict=True)
    )
    if triaxial:
        static |= {"delta_p": rng.normal(0.0, 150.0), "k_io": rng.normal(0.0, 8.0)}
    scale = nominal * rng.normal(1.0, 0.004)
    return Accelerometer(scale, tuple(map(float, k0)), tuple(map(float, k1)), static)
