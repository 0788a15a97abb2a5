"""Run-to-run stability told in words and tables."""

from collections.abc import Iterator, Sequence

from rich.console import RenderableType

from accelbench.commands.stability.document import definition
from accelbench.shell.console import number, table, value_and_sigma
from errormodel.statistics.variance import Component, VarianceFit
from thermo.selection.residuals import DIRECTIONS
from thermo.stability.coefficients import CURVE, CoefficientStability
from thermo.stability.components import FACTORS
from thermo.stability.curves import Distance
from thermo.stability.judge import AccelerometerStability, Stability
from thermo.stability.limits import FALSE_ALARM, Criterion

TOLD = ("k0", "k1")
FEW_RUNS = 4  # a trend of 3 σ is found in a third of cases or fewer
SUSPECT = 0.05


def stability_text(result: Stability) -> Iterator[RenderableType]:
    """Tell it in words and tables."""
    yield from headline(result)
    yield ""
    names = ("K0 1σ µg", "K0 limits", "K0 max−min µg", "K1 1σ ppm", "curves rms µg", "max µg")
    made = table("serial", "rank", "verdict", "grade", "runs", *names, right=("rank", *names))
    for one in sorted(result.accelerometers, key=lambda a: a.rank):
        made.add_row(*summary_row(one))
    yield made
    yield LIMITS_TEXT
    for one in result.accelerometers:
        yield ""
        yield from _one_text(one)
    yield ""
    yield from component_lines(result.components)
    yield ""
    yield definition(result)


def headline(result: Stability) -> Iterator[str]:
    """Say how many pass, and what is wrong with those that do not."""
    verdicts = [a.verdict for a in result.accelerometers]
    counts = [f"{verdicts.count(v)} {v}" for v in ("pass", "fail", "undecided") if v in verdicts]
    said = f": {', '.join(counts)}" if counts else "; no limits given"
    yield f"{len(verdicts)} accelerometer(s), {len(result.order)} runs{said}"
    for event in result.events:
        yield f"  {event.sentence}"
    for out in result.left_out:
        yield f"  {out.sentence}"
    for one in result.accelerometers:
        for c in one.criteria:
            if c.verdict != "pass":
                yield f"  {one.serial}: {criterion_text(c)}"
        for line in movements(one):
            yield f"  {one.serial}: {line}"


def movements(one: AccelerometerStability) -> Iterator[str]:
    """Say what an accelerometer does over the runs beyond chance."""
    for c in one.coefficients:
        if c.name in one.trends:
            yield f"{trend_text(c)} (p = {number(c.scatter.trend_p, 1)})"
    for p in one.patterns:
        yield p.sentence
    if one.loops is not None and one.loops_differ:
        yield one.loops.sentence


def marks_of(one: AccelerometerStability) -> list[str]:
    """Return the same in a word each."""
    marks = ["drifts"] if one.trends else []
    marks += [p.kind for p in one.patterns]
    marks += ["loops differ"] if one.loops_differ else []
    return list(dict.fromkeys(marks))


def trend_text(c: CoefficientStability) -> str:
    """Say how a coefficient moves with time, or from run to run."""
    per = (
        f"{number(c.trend_per_run, 3)} {c.unit} a run"
        if c.trend_per_day is None
        else f"{number(c.trend_per_day, 3)} {c.unit} a day"
    )
    return f"{c.name} drifts by {per}, {number(c.trend_in_all, 3)} {c.unit} from first to last run"


def criterion_text(c: Criterion) -> str:
    """Say a criterion in a line."""
    lo, hi = c.bounds
    words = {"pass": "is kept", "fail": "is exceeded", "undecided": "cannot be decided"}
    return (
        f"{c.name} {sigma_text(c.value, c.bounds)} {c.unit} ({number(lo, 3)} to {number(hi, 3)}): "
        f"limit {number(c.limit)} {words[c.verdict]}"
    )


def summary_row(one: AccelerometerStability) -> list[str]:
    """Return the cells of an accelerometer in the table of the batch."""
    k0, k1 = (one.coefficient(n) for n in TOLD)
    apart = one.k0_distance
    return [
        one.serial,
        str(one.rank),
        one.verdict,
        grade_text(one),
        str(len(one.runs.runs)),
        sigma_text(k0.scatter.sigma_run, sigma_limits(one, k0)) if k0 else "–",
        limits_text(sigma_limits(one, k0)) if k0 else "–",
        number(k0.scatter.max_minus_min, 3) if k0 else "–",
        sigma_text(k1.scatter.sigma_run, sigma_limits(one, k1)) if k1 else "–",
        number(apart.rms if apart else None, 3),
        number(apart.largest if apart else None, 3),
    ]


def grade_text(one: AccelerometerStability) -> str:
    """Write the grade that is shown to be kept, and the better one that the runs do not exclude."""
    if one.grade == one.grade_best:
        return one.grade or "–"
    return f"{one.grade or 'none'} ({one.grade_best}?)"


def sigma_limits(one: AccelerometerStability, c: CoefficientStability) -> tuple[float, float]:
    """Return the limits of a sigma between runs: those of the verdict where there is one."""
    return _shown(one, f"{c.name} sigma_run", c.scatter.ci95)


def largest_limits(one: AccelerometerStability, apart: Distance) -> tuple[float, float]:
    """Return the limits of the largest distance of K0 curves in the same way."""
    return _shown(one, f"{CURVE} max", apart.largest_bounds(FALSE_ALARM))


def _shown(
    one: AccelerometerStability, criterion: str, usual: tuple[float, float]
) -> tuple[float, float]:
    return next((c.bounds for c in one.criteria if c.name == criterion), usual)


def sigma_text(sigma: float, limits: tuple[float, float]) -> str:
    """Write a sigma; one that the runs do not show is written as its upper limit."""
    return f"< {number(limits[1], 3)}" if sigma == 0.0 else number(sigma, 3)


def limits_text(pair: Sequence[float]) -> str:
    """Write two limits."""
    return f"{number(pair[0], 3)} to {number(pair[1], 3)}"


COLUMNS = (
    "coefficient", "unit", "mean", "1σ between runs", "1σ limits", "max−min", "max−min limits",
    "estimation 1σ", "trend p",
)  # fmt: skip


LIMITS_TEXT = (
    "limits: 95 %, or where an acceptance limit is set those of the verdict (all limits of an "
    "accelerometer together wrong in 5 % of cases)"
)


def coefficient_row(one: AccelerometerStability, c: CoefficientStability) -> list[str]:
    """Return the cells of a coefficient of an accelerometer; headed by `COLUMNS`."""
    s = c.scatter
    limits = sigma_limits(one, c)
    return [
        c.name,
        f"{c.unit} from nominal" if c.from_nominal else c.unit,
        value_and_sigma(s.mean, s.mean_sigma),
        sigma_text(s.sigma_run, limits),
        limits_text(limits),
        number(s.max_minus_min, 3),
        limits_text(_shown(one, f"{c.name} max_minus_min", s.max_minus_min_ci95)),
        number(s.sigma_estimation, 3),
        number(s.trend_p, 2),
    ]


def _one_text(one: AccelerometerStability) -> Iterator[RenderableType]:
    yield f"{one.serial}: {len(one.runs.runs)} runs, {one.verdict}"
    made = table(*COLUMNS, right=COLUMNS[2:])
    for c in one.coefficients:
        made.add_row(*coefficient_row(one, c))
    yield made
    for line in stability_sentences(one):
        yield f"  {line}"


def stability_sentences(one: AccelerometerStability) -> Iterator[str]:
    """Tell what the table of coefficients does not hold, a sentence a line."""
    for c in one.criteria:
        yield criterion_text(c)
    if one.k0_distance:
        yield _distance_text("K0", one.k0_distance, "µg", largest_limits(one, one.k0_distance))
    if one.k1_distance:
        limits = one.k1_distance.largest_bounds(FALSE_ALARM)
        yield _distance_text("K1", one.k1_distance, "ppm", limits)
    if one.shape:
        yield (
            "K0 over temperature: runs and directions spread "
            f"{sigma_text(one.shape.spread_ug, one.shape.spread_ci95_ug)} µg rms about their mean "
            f"({limits_text(one.shape.spread_ci95_ug)}), which bends "
            f"{sigma_text(one.shape.bend_ug, one.shape.bend_ci95_ug)} µg rms from a line"
        )
    yield from movements(one)
    yield from _no_movement(one)
    yield _chart_text(one)
    yield from one.notes


def _no_movement(one: AccelerometerStability) -> Iterator[str]:
    """Say what cannot be said of a trend: so few runs hardly show one."""
    runs = len(one.runs.runs)
    if one.trends:
        return
    if runs > FEW_RUNS:
        yield "no coefficient shows a significant trend over the runs"
        return
    looks = [
        f"{trend_text(c)} (p = {number(c.scatter.trend_p, 1)})"
        for c in one.coefficients
        if c.scatter.trend_p is not None and c.scatter.trend_p < SUSPECT
    ]
    said = f", but {'; '.join(looks)}" if looks else ""
    yield f"{runs} runs cannot separate a trend from scatter{said}"


def _distance_text(name: str, one: Distance, unit: str, limits: tuple[float, float]) -> str:
    text = (
        f"{name} curves of the runs lie {number(one.rms, 3)} {unit} rms apart, "
        f"{number(one.largest, 3)} {unit} at most ({limits_text(limits)})"
    )
    if one.largest_at:
        low, high, temp_c, direction = one.largest_at
        text += f", runs {low} and {high} at {temp_c:.0f} °C, {DIRECTIONS[direction]}"
    return text


def _chart_text(one: AccelerometerStability) -> str:
    charted = [c for c in one.coefficients if c.name in TOLD and c.chart.limits]
    if not charted:
        return "control charts: values only, limits need 8 runs"
    said = [
        f"{c.name}: {', '.join(c.run_ids[k] for k in c.chart.outside) or 'no run'} outside"
        for c in charted
    ]
    alarm = charted[0].chart.false_alarm or 0.0
    return f"control charts: {'; '.join(said)} (each chart has {alarm:.0%} chance of a false alarm)"


def component_lines(found: VarianceFit | None) -> Iterator[str]:
    """Tell the variance components."""
    if found is None:
        yield "variance components: these runs cannot separate any"
        return
    yield "variance components of the error, 1 σ in µg (95 % limits):"
    for c in found.components:
        yield f"  {component_text(c)}"


def component_text(c: Component) -> str:
    """Say a component in a line."""
    return (
        f"{c.name} {sigma_text(c.sigma, c.ci95)} ({limits_text(c.ci95)}), {c.dof} degree(s) of "
        f"freedom: {FACTORS[c.name]}"
    )
