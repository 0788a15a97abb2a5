"""Expected sigmas of a planned test, and the coefficients that it cannot separate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.constants import STANDARD_GRAVITY_M_S2
from errormodel.covariance import expected_covariance
from errormodel.fit import examine
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from thermo.compensation.model_file import reported_units, reporting_factors
from thermo.library import term
from thermo.planning.plan import RunPlan
from thermo.recording.channel import Channel, direction_of
from thermo.recording.runs import head_force_g
from thermo.recording.signals import Conditions, emulated_columns, mounting_signals, signals_of
from thermo.selection.orders import separable_names, usual_equation

# What a quartz-flexure accelerometer and its meter show together; the batch fit estimates it.
ASSUMED_NOISE = NoiseModel(white=5e-6, drift=3e-6, drift_tau_s=3600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreseen:
    """One coefficient's expected sigma, in the unit of the report."""

    name: str
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CoefficientForesight:
    """Expected results of a planned test.

    Attributes
    ----------
    runs : int
        How many are fitted together.
    mount_deg : float
        How far the accelerometer is mounted turned on the head, °.
    expected : tuple of Foreseen
    confounded : tuple of tuple of str
        Groups the plan cannot separate; a group of one has no effect in it at all.
    noise : NoiseModel
        What was assumed.
    """

    runs: int
    mount_deg: float
    expected: tuple[Foreseen, ...]
    confounded: tuple[tuple[str, ...], ...]
    noise: NoiseModel

    def lines(self) -> tuple[str, ...]:
        """Return the foresight as plain lines for `--dry-run`."""
        noise = self.noise
        runs = f"{self.runs} runs together" if self.runs > 1 else "the one run"
        turned = f", mounted turned by {self.mount_deg:g}°" if self.mount_deg else ""
        head = (
            f"Sigmas to expect of {runs}{turned}, with {1e6 * noise.white:g} µg of white noise a "
            f"reading and {1e6 * noise.drift:g} µg of drift over {noise.drift_tau_s / 3600:g} h:"
        )
        rows = tuple(f"  {e.name:<8} {e.sigma:10.3g} {e.unit}" for e in self.expected)
        if not self.confounded:
            return (head, *rows, "Every coefficient of the model equation can be separated.")
        lost = tuple(
            f"  {g[0]} has no effect in this plan" if len(g) == 1 else f"  {' ~ '.join(g)}"
            for g in self.confounded
        )
        return (head, *rows, "Cannot be separated with this plan:", *lost)


def foresee_coefficients(
    runs: Sequence[RunPlan],
    *,
    t_ref_c: float = 25.0,
    nominal_scale: float = 1.0,
    output_unit: str = "g",
    mount_deg: float = 0.0,
    noise: NoiseModel = ASSUMED_NOISE,
) -> CoefficientForesight:
    """Foresee what the model equation's coefficients will be known to.

    Parameters
    ----------
    runs : sequence of RunPlan
        The runs that will be fitted together.
    t_ref_c : float
        Reference temperature, °C.
    nominal_scale, output_unit : float, str
        For K1, in output units per g.
    mount_deg : float
        How far the accelerometer is mounted turned on the head, °.
    noise : NoiseModel
        Assumed noise of a reading, g.

    Returns
    -------
    CoefficientForesight
    """
    channel = planned_channel(runs, t_ref_c, mount_deg)
    names, lost = separable_names(channel)
    model = usual_equation(names)
    values = model.start_values()
    sigmas = np.sqrt(np.diag(expected_covariance(model, channel.record, values, noise)))
    factors = reporting_factors(model, nominal_scale)
    units = reported_units(model, output_unit)
    return CoefficientForesight(
        runs=len(runs),
        mount_deg=mount_deg,
        expected=tuple(
            Foreseen(name=n, sigma=float(s) * factors[n], unit=units[n])
            for n, s in zip(model.names, sigmas, strict=True)
        ),
        confounded=_partners(channel, names, lost),
        noise=noise,
    )


def _partners(
    channel: Channel, names: Sequence[str], lost: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """Return for each lost coefficient the ones it cannot be told from."""
    groups: list[tuple[str, ...]] = []
    kept = [n for n in names if "_t" not in n]
    for name in lost:
        model = ErrorModel(tuple(term(n) for n in [*kept, name]))
        found = examine(model, channel.record, model.start_values()).confounded
        groups += [g for g in found if name in g] or [(name,)]
    return tuple(dict.fromkeys(groups))


def planned_channel(runs: Sequence[RunPlan], t_ref_c: float, mount_deg: float = 0.0) -> Channel:
    """Return what an accelerometer will see, without an output; runs laid end to end.

    Parameters
    ----------
    runs : sequence of RunPlan
    t_ref_c : float
        Reference temperature, °C.
    mount_deg : float
        How far the accelerometer is mounted turned on the head, °.
    """
    time_s = np.concatenate([r.time_s for r in runs])
    run = np.repeat(np.arange(len(runs)), [len(r.time_s) for r in runs])
    temp_c = np.concatenate([r.temp_c for r in runs])
    position_deg = np.concatenate([r.position_deg for r in runs])
    force_g = head_force_g(position_deg + mount_deg)
    ends = np.concatenate([[0.0], np.cumsum([float(r.time_s[-1]) for r in runs])])
    at = Conditions(
        time_s=time_s,
        run=run,
        temp_c=temp_c,
        position_deg=position_deg,
        force_g=(force_g[:, 0], force_g[:, 1], force_g[:, 2]),
        elapsed_h=(ends[run] + time_s) / 3600.0,
        t_ref_c=t_ref_c,
    )
    at = replace(at, columns=emulated_columns(at))
    return Channel(
        serial="planned",
        run_ids=tuple(str(r.number) for r in runs),
        record=Record(
            time_s=time_s,
            run=run,
            signals=signals_of(at),
        ),
        temp_c=temp_c,
        position_deg=position_deg,
        direction=direction_of(at.smooth[1]),
        has_input=True,
        output_unit="g",
        nominal_scale=1.0,
        gravity_m_s2=STANDARD_GRAVITY_M_S2,
    )


def followed_by(first: Channel, then: Channel, pause_h: float = 24.0) -> Channel:
    """Return an accelerometer's runs and further ones as a channel; no output.

    Parameters
    ----------
    first, then : Channel
    pause_h : float
        From the end of the one to the beginning of the other.
    """
    one, two = first.record, then.record
    later_h = float(one["elapsed_h"].max()) + pause_h
    signals = {
        name: np.concatenate([one[name], two[name] + (later_h if name == "elapsed_h" else 0.0)])
        for name in one.signals
        if name in two.signals
    }
    force_g = np.column_stack([signals[n] for n in ("a_i_g", "a_p_g", "a_o_g")])
    signals |= mounting_signals(signals["head_deg"], force_g[:, 0], force_g[:, 1])
    return Channel(
        serial=first.serial,
        run_ids=(*first.run_ids, *(f"next {r}" for r in then.run_ids)),
        record=Record(
            time_s=np.concatenate([one.time_s, two.time_s]),
            run=np.concatenate([one.run, two.run + int(one.run[-1]) + 1]),
            signals=signals,
        ),
        temp_c=np.concatenate([first.temp_c, then.temp_c]),
        position_deg=np.concatenate([first.position_deg, then.position_deg]),
        direction=np.concatenate([first.direction, then.direction]),
        has_input=first.has_input,
        output_unit=first.output_unit,
        nominal_scale=first.nominal_scale,
        gravity_m_s2=first.gravity_m_s2,
    )
