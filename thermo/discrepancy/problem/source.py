"""A channel, its present model and the library: the engine's problem with any effects added."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.discrepancy.problem import Factor, Problem, Theta
from errormodel.discrepancy.search.choices import Choice
from errormodel.linear import independent
from errormodel.model import ErrorModel
from errormodel.noise.model import NoiseModel
from thermo.discrepancy.blocks import Blocks, blocks_of
from thermo.discrepancy.factors import Seen, factors_of, saturated_columns
from thermo.discrepancy.problem.candidates import EffectCandidates, representatives
from thermo.discrepancy.problem.refit import Fitted, Linearisation, refit
from thermo.library import term, thermal_library
from thermo.library.effects import Context, Form, ThermalEffect, context_of
from thermo.library.polynomial import ORDER_NAMES
from thermo.recording.channel import Channel

STEP_TRIALS = 320  # instants at which a step is tried


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
        return refit(Linearisation(self.channel, self.blocks, model, free), values, noise)

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
            candidates=self._candidates(fitted).of(self.effects),
            saturated=np.zeros((fitted.residual.size, 0)),
        )

    def _candidates(self, fitted: Fitted) -> EffectCandidates:
        return EffectCandidates(
            self.channel,
            self.blocks,
            fitted,
            runs=self.seen.runs,
            forms=self.forms,
            finer=self.instants_about,
        )

    def _problem(self, chosen: Sequence[Choice], noise: NoiseModel) -> Problem:
        fitted = self.fitted(chosen, noise)
        names = {c.name for c in chosen}
        left = [e for e in self.effects if e.name not in names]
        candidates = self._candidates(fitted).of(left)
        if self._reps is None:
            self._reps = representatives(candidates, fitted.residual.size)
        return Problem(
            times=self.blocks.times,
            residual=fitted.residual,
            base=fitted.jacobian,
            candidates=candidates,
            saturated=independent(np.hstack([fitted.jacobian, self._repeating, self._reps]), 1e-4),
            factors=self.factors,
            events=frozenset(e.name for e in self.effects if e.event),
        )
