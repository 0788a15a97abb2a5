"""The engine's problem of one accelerometer's chamber runs: signatures of effects, refits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import derivative
from errormodel.discrepancy.problem import Candidate, Factor, Problem, Signature, Theta
from errormodel.discrepancy.search.choices import Choice
from errormodel.linear import independent
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from errormodel.record import Record
from errormodel.terms import InputChange, Term
from thermo.discrepancy.blocks import Blocks, blocks_of
from thermo.discrepancy.factors import Seen, factors_of, saturated_columns
from thermo.library import STATIC_NAMES, term, thermal_library
from thermo.library.effects import Context, Form, ThermalEffect, context_of
from thermo.library.polynomial import ORDER_NAMES
from thermo.recording.channel import Channel
from thermo.recording.runs import FORCES

MICRO = 1e6
REFITS = 8
STEP_TRIALS = 320  # instants at which a step is tried


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitted:
    """A model fitted to block means under a noise: values in the model's unit.

    `jacobian` (b, p) and `residual` (b,) are block means in µg; `free` names the columns.
    """

    model: ErrorModel
    values: dict[str, float]
    jacobian: FloatArray
    residual: FloatArray
    free: tuple[str, ...]

    @property
    def idle(self) -> frozenset[str]:
        """Parameters that have no effect in these runs: nothing was learnt of them."""
        columns = zip(self.free, self.jacobian.T, strict=True)
        return frozenset(name for name, column in columns if not column.any())


class ThermalSource:
    """A channel, its present model and the library, as the engine asks for them."""

    def __init__(
        self,
        channel: Channel,
        model: ErrorModel,
        effects: Sequence[ThermalEffect] | None = None,
    ) -> None:
        self.channel, self.model = channel, model
        self.effects = thermal_library().effects if effects is None else tuple(effects)
        self.blocks: Blocks = blocks_of(channel)
        self.seen = Seen(channel, self.blocks)
        self._context = self._make_context()
        self._cached: dict[tuple[tuple[Choice, ...], NoiseModel], Problem] = {}
        self._fits: dict[tuple[tuple[Choice, ...], NoiseModel], Fitted] = {}
        self._reps: FloatArray | None = None

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """Factors that the residual may follow."""
        return factors_of(self.seen)

    @cached_property
    def _repeating(self) -> FloatArray:
        return saturated_columns(self.seen)

    def _make_context(self) -> Context:
        elapsed = self.channel.record["elapsed_h"][self.blocks.starts]
        order = np.sort(elapsed)
        inner = order[order.size // 100 + 2 : -(order.size // 100 + 2)]
        every = max(1, inner.size // STEP_TRIALS)
        return context_of(
            self.model,
            self.seen.runs,
            self.blocks.times.span_s,
            float(np.ptp(elapsed)),
            np.unique(inner[::every]).tolist(),
            (float(self.seen.temp.min()), float(self.seen.temp.max())),
        )

    def forms(self, effect: ThermalEffect) -> Sequence[Form]:
        """Return the forms of an effect that may be added to the present model."""
        return effect.forms(self._context)

    def instants_about(self, theta: Theta) -> tuple[Theta, ...]:
        """Return the instants of readings between an instant's neighbours on the grid of steps."""
        grid = np.array(self._context.step_times_h)
        k = int(np.argmin(np.abs(grid - theta[0])))
        lo, hi = grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)]
        elapsed = self.channel.record["elapsed_h"]
        inside = elapsed[(elapsed > lo) & (elapsed < hi)]
        every = max(1, inside.size // STEP_TRIALS)
        return tuple((t,) for t in inside[::every].tolist())

    def holds(self, effect: ThermalEffect) -> bool:
        """Tell whether the present model has an effect already."""
        return bool(self._alone(effect)) and not self.forms(effect)

    def holds_some(self, effect: ThermalEffect) -> bool:
        """Tell whether the present model has a term of an effect; an order is one of its own."""
        plain = {n for form in self._alone(effect)[:1] for n in form.terms}
        return bool(plain & self._context.term_names - ORDER_NAMES)

    def _alone(self, effect: ThermalEffect) -> Sequence[Form]:
        """Return the forms of an effect beside a model without any term."""
        return effect.forms(context_of(ErrorModel(()), self._context.runs, 1.0, 1.0, (1.0,)))

    def form_of(self, choice: Choice) -> Form:
        """Return the form that the engine chose."""
        effect = next(e for e in self.effects if e.name == choice.name)
        return self.forms(effect)[1 if choice.flexible else 0]

    def enlarged(self, chosen: Sequence[Choice]) -> tuple[ErrorModel, dict[str, float]]:
        """Return the model with effects added, and their nonlinear parameters."""
        model, held = self.model, dict[str, float]()
        for choice in chosen:
            form = self.form_of(choice)
            model = model.with_terms(*(term(n) for n in form.terms))
            held.update(zip(form.parameters, choice.theta, strict=True))
        return model, held

    def fitted(self, chosen: Sequence[Choice], noise: NoiseModel) -> Fitted:
        """Return the enlarged model refitted, every nonlinear parameter with it."""
        key = (tuple(chosen), noise)
        if key not in self._fits:
            self._fits[key] = self._fit(chosen, noise)
        return self._fits[key]

    def _fit(self, chosen: Sequence[Choice], noise: NoiseModel) -> Fitted:
        model, held = self.enlarged(chosen)
        fixed = {
            p for c in chosen if not self.form_of(c).smooth for p in self.form_of(c).parameters
        }
        values = {**model.start_values(), **held}
        free = tuple(n for n in model.names if n not in fixed)
        whitener = noise.whitener(self.blocks.times)
        best = self._linearised(model, values, free)
        cost = float(np.sum(whitener.whiten(best.residual) ** 2))
        for _ in range(REFITS):
            white = whitener.whiten(np.column_stack([best.jacobian, best.residual]))
            step = _solved(white[:, :-1], white[:, -1])
            better = None
            for share in (1.0, 0.5, 0.1):
                tried = self._linearised(model, _moved(model, best, step * share), free)
                trial = float(np.sum(whitener.whiten(tried.residual) ** 2))
                if trial < cost:
                    better = (tried, trial)
                    break
            if better is None:
                break
            gained = cost - better[1]
            best, cost = better
            if gained < 1e-6 * cost:
                break
        return best

    def _linearised(
        self, model: ErrorModel, values: Mapping[str, float], free: Sequence[str]
    ) -> Fitted:
        record = self.channel.record
        columns = derivative(model, record, values)
        keep = [model.names.index(n) for n in free]
        residual = np.asarray(record.output) - model.simulate(record, values)
        return Fitted(
            model=model,
            values=dict(values),
            jacobian=MICRO * self.blocks.mean(columns[:, keep]),
            residual=MICRO * self.blocks.mean(residual),
            free=tuple(free),
        )

    def problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        """Return the engine's problem of the enlarged model, refitted under a noise."""
        key = (tuple(chosen), noise)
        if key not in self._cached:
            self._cached[key] = self._problem(chosen, noise)
        return self._cached[key]

    def outline(self, noise: NoiseModel) -> Problem:
        """Return the problem of the present model without what the noise is estimated beside."""
        fitted = self.fitted((), noise)
        return Problem(
            times=self.blocks.times,
            residual=fitted.residual,
            base=fitted.jacobian,
            candidates=_Candidates(self, fitted).of(self.effects),
            saturated=np.zeros((fitted.residual.size, 0)),
        )

    def _problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        fitted = self.fitted(chosen, noise)
        names = {c.name for c in chosen}
        left = [e for e in self.effects if e.name not in names]
        candidates = _Candidates(self, fitted).of(left)
        if self._reps is None:
            self._reps = _representatives(candidates, fitted.residual.size)
        return Problem(
            times=self.blocks.times,
            residual=fitted.residual,
            base=fitted.jacobian,
            candidates=candidates,
            saturated=independent(np.hstack([fitted.jacobian, self._repeating, self._reps]), 1e-4),
            factors=self.factors,
            events=frozenset(e.name for e in self.effects if e.event),
        )


def _moved(model: ErrorModel, fitted: Fitted, step: FloatArray) -> dict[str, float]:
    """Return the values after a step, nonlinear parameters within their bounds."""
    bounds = {p.name: (p.lo, p.hi) for p in model.parameters}
    moved = dict(fitted.values)
    for name, change in zip(fitted.free, step.tolist(), strict=True):
        value = moved[name] + change
        if name in bounds:
            lo, hi = bounds[name]
            if lo > 0.0:  # a scale: no more than twice or half at once
                lo, hi = max(lo, moved[name] / 2.0), min(hi, max(moved[name] * 2.0, lo))
            value = min(max(value, lo), hi)
        moved[name] = value
    return moved


def _solved(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the least-squares step; directions without effect are left where they are."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    return np.linalg.lstsq(columns / norms, target, rcond=1e-9)[0] / norms


class _Candidates:
    """Effects as candidates about a fitted model."""

    def __init__(self, source: ThermalSource, fitted: Fitted) -> None:
        self.blocks, self.fitted = source.blocks, fitted
        self.source = source
        record = source.channel.record
        model, values = fitted.model, fitted.values
        for change in (t for t in model.terms if isinstance(t, InputChange)):
            record, _ = change.change(record, values, None)
        self.record: Record = record
        design, _ = model.design(source.channel.record, values)
        scale = np.array([values[c.name] for c in model.coefficients_in("scale")])
        inputs = np.array([values[c.name] for c in model.coefficients_in("input")])
        gain = [values[c.name] for c in model.coefficients_in("gain")]
        self.by_input = (gain[0] if gain else 1.0) * (1.0 + design.scale @ scale)
        self.by_scale = (gain[0] if gain else 1.0) * (design.base + design.input @ inputs)
        self.output = self.source.channel.record

    def of(self, effects: Sequence[ThermalEffect]) -> tuple[Candidate, ...]:
        """Return the effects' candidates, those that can be added to the model."""
        made: list[Candidate] = []
        for effect in effects:
            forms = self.source.forms(effect)
            if not forms or not self._possible(forms[0]):
                continue
            possible = [form for form in forms[1:2] if self._possible(form)]
            flexible = self._candidate(effect, possible[0], None) if possible else None
            made.append(self._candidate(effect, forms[0], flexible))
        return tuple(made)

    def _possible(self, form: Form) -> bool:
        """Tell whether the input and the signals that an effect needs are known."""
        effects = [term(n) for n in form.terms]
        if any(e.needs - set(self.record.signals) for e in effects):
            return False
        needy = any(e.needs & set(FORCES) for e in effects) or any(
            isinstance(e, Term) and e.place == "scale" for e in effects
        )
        return self.source.channel.has_input or not needy

    def _candidate(
        self, effect: ThermalEffect, form: Form, flexible: Candidate | None
    ) -> Candidate:
        terms = [term(n) for n in form.terms]
        bounds = {p.name: (p.lo, p.hi) for t in terms for p in t.parameters}
        changes = any(isinstance(t, InputChange) for t in terms)

        def signature(theta: Theta) -> Signature:
            values = dict(zip(form.parameters, theta, strict=True))
            if changes:
                return self._changed(form, values)
            return Signature(columns=self._columns(form, values))

        return Candidate(
            name=effect.name,
            signature=signature,
            grid=form.grid,
            bounds=tuple(bounds[p] for p in form.parameters) if form.smooth else (),
            finer=None if form.smooth else self.source.instants_about,
            # one run tells nothing of what repeats: everything is judged beside its own noise
            event=effect.event or self.source.seen.runs == 1,
            flexible=flexible,
            joint=ORDER_NAMES.issuperset(set(form.terms) - set(STATIC_NAMES)),
        )

    def _columns(self, form: Form, values: Mapping[str, float]) -> FloatArray:
        pieces: list[FloatArray] = []
        everything = {**self.fitted.values, **values}
        for name in form.terms:
            one = term(name)
            assert isinstance(one, Term)
            block, _ = one.columns(self.record, everything, None)
            factor = self.by_scale if one.place == "scale" else self.by_input
            pieces.append(factor[:, None] * block)
        return self.blocks.mean(np.hstack(pieces))

    def _changed(self, form: Form, values: Mapping[str, float]) -> Signature:
        """Return what a changed input does: to the output as it is, and to the baseline."""
        fitted, record = self.fitted, self.source.channel.record
        model = fitted.model.with_terms(*(term(n) for n in form.terms))
        everything = {**fitted.values, **values}
        if fitted.model.parameters:
            columns = derivative(fitted.model, self._lagged(form, everything), fitted.values)
            keep = [fitted.model.names.index(n) for n in fitted.free]
            base = columns[:, keep]
            after = model.simulate(record, everything)
        else:
            after, base = model.linearise(record, everything)
        before = fitted.model.simulate(record, fitted.values)
        return Signature(
            columns=np.zeros((self.blocks.starts.size, 0)),
            base=MICRO * self.blocks.mean(base),
            offset=MICRO * self.blocks.mean(after - before),
        )

    def _lagged(self, form: Form, values: Mapping[str, float]) -> Record:
        record = self.source.channel.record
        for name in form.terms:
            one = term(name)
            if isinstance(one, InputChange):
                record, _ = one.change(record, values, None)
        return record


def _representatives(candidates: Sequence[Candidate], rows: int) -> FloatArray:
    """Return signatures that stand for what may be missing and would repeat, for the noise."""
    pieces: list[FloatArray] = []
    for candidate in (c for c in candidates if not c.event):
        every = candidate.grid_signatures
        chosen = every[:: max(1, len(every) // 4)]
        for s in chosen:
            pieces.append(s.columns if s.offset is None else s.offset[:, None])
    return independent(np.hstack([np.zeros((rows, 0)), *pieces]), 1e-4)
