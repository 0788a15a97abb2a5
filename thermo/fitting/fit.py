"""The temperature model of each accelerometer, fitted jointly over all readings of all runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.errors import InputError, NotSeparableError
from errormodel.fit import ModelFit, fit
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.progress import track
from errormodel.run_effects import RunEffect
from thermo.fitting.terms_wanted import TermsFile, read_terms
from thermo.recording.channel import (
    Channel,
    channel_of,
    refuse_without_signals,
    refuse_without_temperature,
)
from thermo.recording.files import RecordedRuns
from thermo.recording.runs import FORCES
from thermo.selection.orders import BY_RUN, Selection, referred_to_input, select_model
from thermo.selection.residuals import ResidualSummary, constants_only_ug, summarise
from thermo.selection.support import Support, settled, support_of
from thermo.uncertainty.doubts import Doubts, doubts_of
from thermo.uncertainty.head_accuracy import ARCSEC, output_by_angle, with_head_accuracy
from thermo.uncertainty.held_out import held_out, heldout_sigma_ug
from thermo.uncertainty.linearised import linearised
from thermo.uncertainty.run_differences import with_run_effects

# A smaller ratio to nominal is none: nothing can be referred to the input by it.
LEAST_K1 = 1e-9

__all__ = ["AccelerometerFit", "TermsFile", "fit_runs", "read_terms"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AccelerometerFit:
    """One accelerometer's model, what it leaves, and how it predicts runs it was not fitted to.

    Attributes
    ----------
    channel : Channel
        The readings that were fitted.
    own_scale : float
        K1 found, output unit per g; that of the recording where K1 cannot be had. What is given
        in µg, and `noise`, is referred to the input by it.
    fit : ModelFit
    selection : Selection or None
        None when the terms were given.
    t_ref_c : float
    valid_c, valid_rate_c_per_min : pair of float
        The range of temperature and of its rate in the fitted readings.
    residual_ug : ndarray, shape (n,)
        Of the fitted readings.
    raw, summary : ResidualSummary
        With constants only, and with the model.
    heldout : ResidualSummary or None
        Of readings predicted without their run; None with a single run, or where the others
        cannot give every coefficient.
    heldout_sigma_ug : float or None
        Of its rms, for what further runs leave; None where one run was fitted.
    run_effects : tuple of RunEffect
        How the runs differ; empty with a single one.
    support : Support
        Where there were readings.
    doubts : Doubts
        What the estimates and sigmas do not say by themselves.
    heldout_runs : tuple of str
        The runs asked to be held out; empty when each was left out in turn.
    digests : mapping
        Run id → digest of every run used.
    head_arcsec : float
        The head's accuracy that the covariance allows for, ″.
    """

    channel: Channel
    own_scale: float
    fit: ModelFit
    selection: Selection | None
    t_ref_c: float
    valid_c: tuple[float, float]
    valid_rate_c_per_min: tuple[float, float]
    residual_ug: FloatArray
    raw_ug: FloatArray
    raw: ResidualSummary
    summary: ResidualSummary
    heldout: ResidualSummary | None
    heldout_sigma_ug: float | None
    heldout_runs: tuple[str, ...]
    digests: Mapping[str, str]
    run_effects: tuple[RunEffect, ...]
    support: Support
    doubts: Doubts
    head_arcsec: float = 0.0

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.channel.serial

    @property
    def noise(self) -> NoiseModel:
        """Noise within the runs, at the input."""
        return self.fit.noise.scaled(abs(self.channel.nominal_scale / self.own_scale))

    @property
    def worse_than_none(self) -> bool:
        """True when the model leaves more than constants alone do, by more than rounding."""
        return self.summary.rms_ug > 1.01 * self.raw.rms_ug


def fit_runs(
    runs: RecordedRuns,
    *,
    terms: TermsFile | None = None,
    holdout: Sequence[str] = (),
    at_one_temperature: bool = False,
) -> tuple[AccelerometerFit, ...]:
    """Fit every accelerometer in recorded runs.

    Parameters
    ----------
    runs : RecordedRuns
    terms : TermsFile, optional
        What to fit; by default the data choose (`thermo.selection.orders.select_model`).
    holdout : sequence of str
        Runs to keep out of the fit and to predict instead.
    at_one_temperature : bool
        Whether runs without any temperature are taken as all at the reference temperature.

    Returns
    -------
    tuple of AccelerometerFit
        In the order of the serial numbers in the runs.

    Raises
    ------
    InputError
        If a run to hold out is not there, nothing is left to fit, or a run has no temperature.
    NotSeparableError
        If the data cannot separate the terms given.
    """
    wanted = terms or TermsFile()
    missing = [r for r in holdout if r not in runs.run_ids]
    if missing:
        known = ", ".join(runs.run_ids)
        raise InputError(runs.source, "", f"no run {missing[0]!r} to hold out; expected {known}")
    if not at_one_temperature:
        for serial in runs.serials:
            refuse_without_temperature(runs, serial)
    digests = {r: runs.digest(r) for r in runs.run_ids}
    return tuple(_fit_one(runs, s, wanted, tuple(holdout), digests) for s in track(runs.serials))


def _fit_one(
    runs: RecordedRuns,
    serial: str,
    terms: TermsFile,
    holdout: tuple[str, ...],
    digests: Mapping[str, str],
) -> AccelerometerFit:
    everything = channel_of(runs, serial, t_ref_c=terms.t_ref_c)
    kept = tuple(r for r in everything.run_ids if r not in holdout)
    if not kept:
        raise InputError(runs.source, f"serial {serial}", "no run is left to fit")
    all_kept = kept == everything.run_ids
    channel = everything if all_kept else everything.take(everything.runs_mask(kept))
    given = terms.model()
    selection = None if given else select_model(channel)
    model = given or (selection.model if selection else ErrorModel(()))
    _check_inputs(terms, model, channel, runs.source)
    found = _fit_channel(model, channel, terms.start)
    return _told(found, everything, kept, terms, selection, {r: digests[r] for r in kept})


def _told(
    found: ModelFit,
    everything: Channel,
    kept: tuple[str, ...],
    terms: TermsFile,
    selection: Selection | None,
    digests: Mapping[str, str],
) -> AccelerometerFit:
    """Put an accelerometer's result together; what is judged is in g of the K1 found."""
    k1 = found.value("k1") if "k1" in found.names else 1.0
    k1 = k1 if abs(k1) > LEAST_K1 else 1.0
    own = everything.referred(k1)
    mine = everything
    if kept != everything.run_ids:
        rows = everything.runs_mask(kept)
        mine, channel = everything.take(rows), own.take(rows)
    else:
        channel = own
    holdout = tuple(r for r in everything.run_ids if r not in kept)
    referred = _times_k1(found, 1.0 / k1)
    predicted = held_out(referred, own, holdout)
    line = linearised(referred, channel.record)
    noise_cov = line.fit.cov
    line = with_run_effects(line, settled(channel))
    head = None
    if terms.head_arcsec:
        head = terms.head_arcsec * ARCSEC * output_by_angle(line.fit, line.record)
        line = with_head_accuracy(line, terms.head_arcsec)
    lost = selection.not_separable if selection else None
    doubts, result = doubts_of(line, channel, terms.t_ref_c, lost, head)
    raw_ug = constants_only_ug(np.asarray(channel.record.output), channel.record["a_i_g"], 1.0)
    residual_ug = 1e6 * line.residual
    support = support_of(channel)
    return AccelerometerFit(
        channel=mine,
        own_scale=own.nominal_scale,
        fit=_times_k1(result, k1),
        selection=referred_to_input(selection, abs(k1)) if selection else None,
        t_ref_c=terms.t_ref_c,
        valid_c=(support.temp_c[0][0], support.temp_c[-1][1]),
        valid_rate_c_per_min=support.rate_c_per_min,
        residual_ug=residual_ug,
        raw_ug=raw_ug,
        raw=summarise(channel, raw_ug),
        summary=summarise(channel, residual_ug),
        heldout=predicted,
        heldout_sigma_ug=(
            heldout_sigma_ug(line, noise_cov, predicted.rms_ug) if predicted else None
        ),
        heldout_runs=holdout,
        digests=digests,
        run_effects=line.run_effects,
        support=support,
        doubts=doubts,
        head_arcsec=terms.head_arcsec,
    )


def _times_k1(found: ModelFit, k1: float) -> ModelFit:
    """Return a fit as it is of readings of a unit k1 times smaller."""
    change = np.where(np.array(found.names) == "k1", k1, 1.0)
    return replace(
        found,
        values=found.values * change,
        cov=found.cov * np.outer(change, change),
        noise=found.noise.scaled(abs(k1)),
        rms=found.rms * abs(k1),
    )


def _check_inputs(terms: TermsFile, model: ErrorModel, channel: Channel, source: str) -> None:
    """Refuse what needs an input or a signal that the recording does not give, in words."""
    refuse_without_signals(model, channel, source)
    if channel.has_input:
        return
    if terms.head_arcsec:
        what = "head_arcsec needs the head's angle; give position_deg"
        raise InputError(source, f"serial {channel.serial}", what)
    needy = [t.name for t in model.terms if t.name == "k1" or t.needs & set(FORCES) or _scales(t)]
    if needy:
        raise InputError(
            source,
            f"serial {channel.serial}",
            f"{', '.join(needy)} need a known input; give position_deg or a_i_g, a_p_g, a_o_g",
        )


def _scales(effect: object) -> bool:
    return getattr(effect, "place", "") == "scale"


def _fit_channel(model: ErrorModel, channel: Channel, start: Mapping[str, float]) -> ModelFit:
    try:
        return fit(model, channel.record, start=start, by_run=BY_RUN)
    except NotSeparableError as err:
        raise NotSeparableError(err.groups, f"serial {channel.serial}: the data") from None
    except ValueError as err:
        raise InputError(f"serial {channel.serial}", "", str(err)) from None
