"""Candidates of the search: what each effect would do to the block means about a fitted model."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.columns import derivative
from errormodel.discrepancy.problem import Candidate, Signature, Theta
from errormodel.linear import independent
from errormodel.record import Record
from errormodel.terms import InputChange, Term
from thermo.discrepancy.blocks import Blocks
from thermo.discrepancy.problem.refit import MICRO, Fitted
from thermo.library import STATIC_NAMES, term
from thermo.library.effects import Form, ThermalEffect
from thermo.library.polynomial import ORDER_NAMES
from thermo.recording.channel import Channel
from thermo.recording.runs import FORCES


class EffectCandidates:
    """Effects as candidates about a fitted model."""

    def __init__(
        self,
        channel: Channel,
        blocks: Blocks,
        fitted: Fitted,
        *,
        runs: int,
        forms: Callable[[ThermalEffect], Sequence[Form]],
        finer: Callable[[Theta], tuple[Theta, ...]],
    ) -> None:
        self.channel, self.blocks, self.fitted = channel, blocks, fitted
        self.runs, self.forms, self.finer = runs, forms, finer
        record = channel.record
        model, values = fitted.model, fitted.values
        for change in (t for t in model.terms if isinstance(t, InputChange)):
            record, _ = change.change(record, values, None)
        self.record: Record = record
        design, _ = model.design(channel.record, values)
        scale = np.array([values[c.name] for c in model.coefficients_in("scale")])
        inputs = np.array([values[c.name] for c in model.coefficients_in("input")])
        gain = [values[c.name] for c in model.coefficients_in("gain")]
        self.by_input = (gain[0] if gain else 1.0) * (1.0 + design.scale @ scale)
        self.by_scale = (gain[0] if gain else 1.0) * (design.base + design.input @ inputs)

    def of(self, effects: Sequence[ThermalEffect]) -> tuple[Candidate, ...]:
        """Return the effects' candidates, those that can be added to the model."""
        made: list[Candidate] = []
        for effect in effects:
            forms = self.forms(effect)
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
        return self.channel.has_input or not needy

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
            finer=None if form.smooth else self.finer,
            # one run tells nothing of what repeats: everything is judged beside its own noise
            event=effect.event or self.runs == 1,
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
        fitted, record = self.fitted, self.channel.record
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
        record = self.channel.record
        for name in form.terms:
            one = term(name)
            if isinstance(one, InputChange):
                record, _ = one.change(record, values, None)
        return record


def representatives(candidates: Sequence[Candidate], rows: int) -> FloatArray:
    """Return signatures that stand for what may be missing and would repeat, for the noise."""
    pieces: list[FloatArray] = []
    for candidate in (c for c in candidates if not c.event):
        every = candidate.grid_signatures
        chosen = every[:: max(1, len(every) // 4)]
        for s in chosen:
            pieces.append(s.columns if s.offset is None else s.offset[:, None])
    return independent(np.hstack([np.zeros((rows, 0)), *pieces]), 1e-4)
