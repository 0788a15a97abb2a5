"""The temperature model of each accelerometer, fitted jointly over all readings of all runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from errormodel.arrays import FloatArray
from errormodel.errors import InputError, NotSeparableError
from errormodel.files import read_toml
from errormodel.fit import ModelFit, fit, fit_values
from errormodel.model import ErrorModel
from errormodel.record import Record
from thermo.head_errors import with_head_accuracy
from thermo.inputs import Channel, channel_of
from thermo.recording import RecordedRuns
from thermo.residuals import ResidualSummary, summarise
from thermo.selection import Selection, select_model
from thermo.terms import LIBRARY, term


class TermsFile(BaseModel):
    """TERMS.toml: the terms to fit, in place of those that the data choose.

    `start` holds start values of nonlinear parameters, in their own units; `head_arcsec` is what
    the indexing head's angle may be wrong by, 1 sigma, and goes into the covariance.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    terms: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    t_ref_c: Annotated[float, Field(ge=-200, le=400, allow_inf_nan=False)] = 25.0
    start: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    head_arcsec: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] = 0.0

    @field_validator("terms")
    @classmethod
    def _known(cls, names: tuple[str, ...] | None) -> tuple[str, ...] | None:
        for name in names or ():
            if name not in LIBRARY:
                raise ValueError(f"no term {name!r}; expected some of {', '.join(LIBRARY)}")
        if names is not None and len(set(names)) != len(names):
            raise ValueError("a term stands twice")
        return names

    @model_validator(mode="after")
    def _start_is_of_the_model(self) -> "TermsFile":
        model = self.model()
        known = {p.name: p for p in model.parameters} if model else {}
        for name, value in self.start.items():
            if name not in known:
                raise ValueError(f"start: {name!r} is no nonlinear parameter of the terms")
            if not known[name].lo <= value <= known[name].hi:
                lo, hi = known[name].lo, known[name].hi
                raise ValueError(f"start: {name} must be between {lo:g} and {hi:g}")
        return self

    def model(self) -> ErrorModel | None:
        """Return the model of the terms named; None when the data are to choose."""
        return None if self.terms is None else ErrorModel(tuple(term(n) for n in self.terms))


def read_terms(path: Path | str) -> TermsFile:
    """Read TERMS.toml.

    Raises
    ------
    InputError
        If it cannot be read or names an unknown term.
    """
    return read_toml(path, TermsFile)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AccelerometerFit:
    """One accelerometer's model, what it leaves, and how it predicts runs it was not fitted to.

    Attributes
    ----------
    channel : Channel
        The readings that were fitted.
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
    heldout_runs : tuple of str
        The runs asked to be held out; empty when each was left out in turn.
    digests : mapping
        Run id → digest of every run used.
    head_arcsec : float
        The head's accuracy that the covariance allows for, ″.
    """

    channel: Channel
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
    heldout_runs: tuple[str, ...]
    digests: Mapping[str, str]
    head_arcsec: float = 0.0

    @property
    def serial(self) -> str:
        """Serial number."""
        return self.channel.serial

    @property
    def worse_than_none(self) -> bool:
        """Whether the model leaves more than constants alone do, by more than rounding."""
        return self.summary.rms_ug > 1.01 * self.raw.rms_ug


def fit_runs(
    runs: RecordedRuns,
    *,
    terms: TermsFile | None = None,
    holdout: Sequence[str] = (),
) -> tuple[AccelerometerFit, ...]:
    """Fit every accelerometer in recorded runs.

    Parameters
    ----------
    runs : RecordedRuns
    terms : TermsFile, optional
        What to fit; by default the data choose (`thermo.selection.select_model`).
    holdout : sequence of str
        Runs to keep out of the fit and to predict instead.

    Returns
    -------
    tuple of AccelerometerFit
        In the order of the serial numbers in the runs.

    Raises
    ------
    InputError
        If a run to hold out is not there, or nothing is left to fit.
    NotSeparableError
        If the data cannot separate the terms given.
    """
    wanted = terms or TermsFile()
    missing = [r for r in holdout if r not in runs.run_ids]
    if missing:
        known = ", ".join(runs.run_ids)
        raise InputError(runs.source, "", f"no run {missing[0]!r} to hold out; expected {known}")
    digests = {r: runs.digest(r) for r in runs.run_ids}
    return tuple(_fit_one(runs, s, wanted, tuple(holdout), digests) for s in runs.serials)


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
    result = _fit_channel(model, channel, terms.start)
    residual_ug, raw_ug = _residual_ug(result, channel), _constants_only_ug(channel)
    heldout = _held_out(model, result, everything, holdout)
    rate = channel.record["rate_c_per_min"]
    if terms.head_arcsec:
        result = with_head_accuracy(result, channel.record, terms.head_arcsec)
    return AccelerometerFit(
        channel=channel,
        fit=result,
        selection=selection,
        t_ref_c=terms.t_ref_c,
        valid_c=(float(channel.temp_c.min()), float(channel.temp_c.max())),
        valid_rate_c_per_min=(float(rate.min()), float(rate.max())),
        residual_ug=residual_ug,
        raw_ug=raw_ug,
        raw=summarise(channel, raw_ug),
        summary=summarise(channel, residual_ug),
        heldout=heldout,
        heldout_runs=tuple(r for r in everything.run_ids if r in holdout),
        digests={r: digests[r] for r in kept},
        head_arcsec=terms.head_arcsec,
    )


def _check_inputs(terms: TermsFile, model: ErrorModel, channel: Channel, source: str) -> None:
    """Refuse what needs an input the recording does not give, in words."""
    if channel.has_input:
        return
    if terms.head_arcsec:
        what = "head_arcsec needs the head's angle; give position_deg"
        raise InputError(source, f"serial {channel.serial}", what)
    needy = [
        t.name
        for t in model.terms
        if t.name == "k1" or any(s.startswith("a_") for s in t.needs) or _scales(t)
    ]
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
        return fit(model, channel.record, start=start)
    except NotSeparableError as err:
        raise NotSeparableError(err.groups, f"serial {channel.serial}: the data") from None
    except ValueError as err:
        raise InputError(f"serial {channel.serial}", "", str(err)) from None


def _residual_ug(result: ModelFit, channel: Channel) -> FloatArray:
    return _left_ug(result.model, channel.record, result.as_dict())


def _left_ug(model: ErrorModel, record: Record, values: Mapping[str, float]) -> FloatArray:
    left = model.simulate(record, values)
    np.subtract(np.asarray(record.output), left, out=left)
    return np.multiply(left, 1e6, out=left)


def _constants_only_ug(channel: Channel) -> FloatArray:
    """Return the residual of a model without temperature: K0 and, if it can be had, K1.

    Referred to the input: divided by K1.
    """
    record = channel.record
    columns = np.column_stack([np.ones(len(record)), record["a_i_g"]])
    output = np.asarray(record.output)
    solution, _, rank, _ = np.linalg.lstsq(columns, output, rcond=1e-3)
    if rank < 2:
        columns = columns[:, :1]
        output = output - record["a_i_g"]
        return 1e6 * (output - output.mean())
    return 1e6 * (output - columns @ solution) / solution[1]


def _held_out(
    model: ErrorModel, result: ModelFit, everything: Channel, holdout: tuple[str, ...]
) -> ResidualSummary | None:
    """Predict runs that were not fitted: those asked for, or each in turn."""
    if holdout:
        present = tuple(r for r in everything.run_ids if r in holdout)
        if not present:
            return None
        unseen = everything.take(everything.runs_mask(present))
        return summarise(unseen, _residual_ug(result, unseen))
    if len(everything.run_ids) < 2:
        return None
    residual_ug = np.empty(len(everything.record))
    record = everything.record.with_only(model.needs)  # parts of it are then small
    for rows in record.run_slices:
        mine = np.arange(len(record))[rows]
        try:
            seen = record.take(np.delete(np.arange(len(record)), mine))
            values = fit_values(model, seen, start=result.as_dict())
        except NotSeparableError:
            return None  # this run alone carries some coefficient: it cannot be predicted
        residual_ug[rows] = _left_ug(model, record.take(mine), values)
    return summarise(everything, residual_ug)
