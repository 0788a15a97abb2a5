"""Missing effects that a planned test can show, and those that it cannot separate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.constants import T_REF_C
from errormodel.discrepancy.foresight import SAME, foresee_candidates
from errormodel.discrepancy.scan import View
from thermo.discrepancy.baseline import bare_baseline
from thermo.discrepancy.problem.source import ThermalSource
from thermo.library import thermal_library
from thermo.library.effects import ThermalEffect
from thermo.library.passing import MAX_RUNS
from thermo.planning.foresight import ASSUMED_NOISE, planned_channel
from thermo.planning.plan import RunPlan
from thermo.twin.planted import plain_accelerometer


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectsForeseen:
    """Effects that a planned test cannot show or separate.

    Attributes
    ----------
    invisible : tuple of str
        Effects that the runs cannot show, whatever their size.
    alike : tuple of (str, str)
        Pairs in which one effect imitates the other to 98 %.
    """

    invisible: tuple[str, ...]
    alike: tuple[tuple[str, str], ...]

    def lines(self) -> tuple[str, ...]:
        """Return the foresight as plain lines for `--dry-run`."""
        lines: list[str] = []
        if self.invisible:
            lines.append(
                f"Missing effects that it cannot show at all: {', '.join(self.invisible)}."
            )
        lines += [f"Missing effects that it can hardly separate: {a} ~ {b}." for a, b in self.alike]
        return tuple(lines) or ("It would show every missing effect of the library.",)


def foresee_effects(
    runs: Sequence[RunPlan],
    *,
    t_ref_c: float = T_REF_C,
    mount_deg: float = 0.0,
    effects: Sequence[ThermalEffect] | None = None,
) -> EffectsForeseen:
    """Foresee which effects the runs will show beside bias and scale factor over temperature.

    Parameters
    ----------
    runs : sequence of RunPlan
        The runs that will be searched together; at most the first twelve.
    t_ref_c : float
        Reference temperature, °C.
    mount_deg : float
        Angle by which the accelerometer is turned on the head, °.
    effects : sequence of ThermalEffect
        By default those of the library in use.
    """
    effects = thermal_library().effects if effects is None else effects
    channel = planned_channel(runs[:MAX_RUNS], t_ref_c, mount_deg)
    model = bare_baseline(channel)
    # a lag shows only in what depends on temperature: the emulated type's coefficients
    usual = plain_accelerometer(channel.serial).values
    values = {n: usual[n] for n in model.names}
    record = replace(channel.record, output=model.simulate(channel.record, values))
    source = ThermalSource(replace(channel, record=record), model, effects)
    per_block = source.blocks.usual
    noise = replace(ASSUMED_NOISE.scaled(1e6), white=1e6 * ASSUMED_NOISE.white / per_block**0.5)
    view = View(source.outline(noise), noise)
    found = foresee_candidates(view, view.problem.candidates)
    names = [n for n in found.names if n not in found.invisible]
    both = np.minimum(found.imitated, found.imitated.T)
    at = [found.names.index(n) for n in names]
    return EffectsForeseen(
        invisible=tuple(e.name for e in effects if e.name not in names and not e.changes),
        alike=tuple(
            (names[i], names[j])
            for i in range(len(names))
            for j in range(i + 1, len(names))
            if both[at[i], at[j]] > SAME
        ),
    )
