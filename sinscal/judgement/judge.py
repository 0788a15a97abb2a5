"""A calibration with its judgement: how far it can be trusted, by its own innovations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from sinscal.calibration.consistency import (
    Consistency,
    MeasurementRows,
    Refused,
    judge_innovations,
    normalised_rows,
    refused_of,
    rows_of_rig,
)
from sinscal.calibration.hold_out import HoldOut, shift_test
from sinscal.calibration.observability import Observability, observability
from sinscal.calibration.rig import RigCalibration
from sinscal.judgement.protection import Level
from sinscal.judgement.warnings import Calibration, warnings_of
from sinscal.model.larger_model import BiasDrift, BiasStep
from sinscal.sensitivity.drift import Drift
from sinscal.sensitivity.views import EffectView, tested_effects

# Warnings by which a run contradicts physics or what is stated beside it: none of them passes.
CONTRADICTIONS = ("_contradiction", "reversed_force")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judged:
    """A calibration with its judgement; `warnings` holds all of them, each begun by its name.

    `steps` are the jumps among the sensors' terms, `drifts` what was found to drift; `protection`
    the level of every parameter, None where raw sensors were not recorded; `limits` those asked
    for, by group, and `unprotected` the groups whose level is above, each with its worst parameter.
    """

    found: Calibration
    rows: MeasurementRows
    consistency: Consistency
    observability: Observability
    refused: tuple[Refused, ...]
    flagged: tuple[int, ...]
    warnings: tuple[str, ...]
    steps: tuple[BiasStep, ...] = ()
    drifts: tuple[Drift, ...] = ()
    protection: Mapping[str, Level] | None = None
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    unprotected: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def terms(self) -> tuple[BiasDrift, ...]:
        """The drifts among the sensors' terms."""
        return tuple(d.term for d in self.drifts if d.term)

    @property
    def passed(self) -> bool:
        """True when the calibration is consistent, and protected as far as was asked."""
        return self.consistency.passed and not self.unprotected


def judge_calibration(
    found: Calibration,
    flagged: Sequence[int],
    held: Sequence[HoldOut],
    noise_known: bool = True,
    warnings: Sequence[str] = (),
    views: Sequence[EffectView] | None = None,
) -> Judged:
    """Judge a calibration by its innovations, a cycle held out and what was known beforehand.

    Parameters
    ----------
    found : RigCalibration or NavCalibration
    flagged : sequence of int
        How many rows of each cycle were not used as measurements.
    held : sequence of HoldOut
    noise_known : bool
        Whether the noise is not from the same data.
    warnings : sequence of str
        Known before.
    views : sequence of EffectView, optional
        What the effects that are missing would do; without them they are not tested.
    """
    if isinstance(found, RigCalibration):
        rows = rows_of_rig(found.steps.h.shape[1])
    else:
        rows = MeasurementRows(names=found.layout.integrals, white=found.judged)
    p = len(found.sensors.names)
    nis, channels, bounded = judge_innovations(
        normalised_rows(found.filtered), found.cycle_of_step, rows
    )
    consistency = Consistency(
        nis=nis,
        channels=channels,
        bounded=bounded,
        held_out=tuple(held),
        prior=shift_test(found.values[:p], found.cov[:p, :p], found.prior.values, found.prior.cov),
        noise_known=noise_known,
        converged=found.converged,
        effects=None if views is None else tested_effects(views, nis.mean),
    )
    told = (*found.warnings, *warnings, *warnings_of(found, consistency))
    against = [w.partition(":")[0] for w in told]
    consistency = replace(
        consistency, contradictions=tuple(n for n in against if n.endswith(CONTRADICTIONS))
    )
    own = [found.layout.names.index(name) for name in found.names]
    return Judged(
        found=found,
        rows=rows,
        consistency=consistency,
        observability=observability(found.names, found.cov, found.start.sigmas[own]),
        refused=refused_of(found.filtered, found.cycle_of_step, found.time_s, rows),
        flagged=tuple(flagged),
        warnings=told,
    )
