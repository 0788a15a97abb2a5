"""Python functions for what the commands do: values instead of files.

Each function does the work of the command with the same name and returns a `Result`: the values,
the JSON document of the command, a table and figures.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from accelbench.result import Result, coefficients_of, named_rows, no_pictures
from accelbench.shell.library import library

if TYPE_CHECKING:
    from accelbench.shell.foreseen_plan import MountingForeseen
    from accelbench.shell.plotting import Picture
    from sinscal.combination.combine import Combination
    from sinscal.recording.run import RigRun
    from thermo.compensation.compensate import Compensated
    from thermo.compensation.model_file import ModelFile
    from thermo.discrepancy.find import Discrepancy
    from thermo.fitting.fit import AccelerometerFit
    from thermo.fitting.terms_wanted import TermsFile
    from thermo.planning.plan import Plan
    from thermo.recording.files import RecordedRuns
    from thermo.run_in.verdict import RunInVerdict
    from thermo.stability.judge import Stability
    from thermo.stability.limits import LimitsFile


def fit(
    runs: "RecordedRuns", *, terms: "TermsFile | None" = None, holdout: Sequence[str] = ()
) -> "Result[tuple[tuple[AccelerometerFit, ...], ModelFile]]":
    """Fit each accelerometer's error model over temperature; the twin of `accelbench fit`.

    Parameters
    ----------
    runs : RecordedRuns
        As `read_runs` gives them.
    terms : TermsFile, optional
        The terms to fit; by default they are selected from the data.
    holdout : sequence of str
        Runs to predict instead of fitting them.

    Returns
    -------
    Result
        `found` contains the fits and the model file for `compensate`.

    Raises
    ------
    InputError
        If the runs lack what a fit needs.
    NotSeparableError
        If the data cannot separate the given terms.
    """
    from accelbench.commands.fit.text import fit_document
    from thermo.compensation.model_file import make_model_file
    from thermo.fitting.fit import fit_runs

    fits = fit_runs(runs, terms=terms, holdout=holdout)
    model = make_model_file(fits)
    document = fit_document(fits, model)

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.fit.figures import pictures as drawn

        return drawn(fits, runs)

    return Result(
        title=f"temperature model of {', '.join(f.serial for f in fits)}",
        found=(fits, model),
        document=document,
        rows=lambda: coefficients_of(document),
        pictures=pictures,
    )


def compensate(runs: "RecordedRuns", model: "ModelFile") -> "Result[Compensated]":
    """Apply a model to every reading of recorded runs; the twin of `accelbench compensate`.

    Parameters
    ----------
    runs : RecordedRuns
    model : ModelFile
        From `read_model`, or the second element of `found` of `fit`.

    Returns
    -------
    Result
        The table has the columns of the file that the command writes.

    Raises
    ------
    InputError
        If an accelerometer has no model, or its output is not in the model's unit.
    """
    from thermo.compensation.compensate import compensate as compensated
    from thermo.compensation.compensated_files import compensated_frame

    values = compensated(runs, model)
    return Result(
        title=f"{len(runs)} readings compensated with model {model.model_id}",
        found=values,
        document={"model_id": model.model_id, "readings": len(runs)},
        rows=lambda: compensated_frame(runs, values).to_dict("records"),  # pyright: ignore
        pictures=no_pictures,
    )


def stability(
    runs: "RecordedRuns",
    *,
    terms: "TermsFile | None" = None,
    at_c: Sequence[float] = (),
    limits: "LimitsFile | None" = None,
) -> "Result[Stability]":
    """Compare the runs of one or many accelerometers; the twin of `accelbench stability`.

    Parameters and errors are those of `thermo.stability.judge.judge_stability`.

    Returns
    -------
    Result
    """
    from accelbench.commands.stability.document import stability_document
    from thermo.stability.judge import judge_stability

    result = judge_stability(runs, terms=terms, at_c=at_c, limits=limits)
    document = stability_document(result)

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.stability.figures import stability_pictures

        return stability_pictures(result)

    return Result(
        title=f"stability of {len(result.accelerometers)} accelerometer(s) over "
        f"{len(result.order)} runs",
        found=result,
        document=document,
        rows=lambda: coefficients_of(document),
        pictures=pictures,
    )


def runin(
    runs: "RecordedRuns",
    *,
    k0_limit_ug: float,
    k1_limit_ppm: float,
    confidence: float = 0.95,
    t_ref_c: float = 25.0,
) -> "Result[tuple[RunInVerdict, ...]]":
    """Test whether a run-in has settled, one run per cycle; the twin of `accelbench runin`.

    Parameters
    ----------
    runs : RecordedRuns
    k0_limit_ug, k1_limit_ppm : float
        Acceptable later changes of K0 and K1.
    confidence : float
        Required probability that the changes stay within these limits.
    t_ref_c : float
        Reference temperature of K0 and K1, °C.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If an accelerometer has fewer than three runs, or a single run does not determine K0 (or
        K1).
    """
    from accelbench.commands.run_in.text import run_in_document
    from thermo.planning.run_in_rule import RunInRule
    from thermo.run_in.cycles import judge_runs

    rule = RunInRule.model_validate(
        {
            "k0_limit_ug": k0_limit_ug,
            "k1_limit_ppm": k1_limit_ppm,
            "confidence": confidence,
            "t_ref_c": t_ref_c,
        }
    )
    verdicts = judge_runs(runs, rule)
    document = {"accelerometers": run_in_document(verdicts)}

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.run_in.figures import run_in_pictures

        return run_in_pictures(verdicts)

    return Result(
        title="run-in: "
        + ", ".join(f"{v.serial} {'settled' if v.settled else 'not settled'}" for v in verdicts),
        found=verdicts,
        document=document,
        rows=lambda: [
            {"serial": v["serial"], "cycles": v["cycles"], "settled": v["settled"],
             "settled_probability": v["settled_probability"], "sentence": v["sentence"]}
            for v in document["accelerometers"]
        ],
        pictures=pictures,
    )  # fmt: skip


def discrepancy(
    runs: "RecordedRuns",
    *,
    model: "TermsFile | Literal['bare'] | None" = None,
    effects: Path | str | None = None,
    seed: int = 1,
) -> "Result[tuple[Discrepancy, ...]]":
    """Find and name the effect that the model lacks; the twin of `accelbench discrepancy thermal`.

    Parameters
    ----------
    runs : RecordedRuns
    model : TermsFile or "bare", optional
        The present model; by default the equation that `fit` would choose.
    effects : path, optional
        A file of your own; the same as a block of `accelbench.library`.
    seed : int
        Random seed of the simulated nulls.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the runs lack what the search needs.
    """
    from accelbench.commands.discrepancy.text import discrepancy_document
    from thermo.discrepancy.find import find_discrepancy

    with library(*([] if effects is None else [effects])):
        found = find_discrepancy(runs, model=model, seed=seed)
    document = discrepancy_document(found)

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.discrepancy.figures import draw_verdict

        return [picture for one in found for picture in draw_verdict(one)]

    return Result(
        title="discrepancy: " + ", ".join(f"{d.serial} {d.verdict}" for d in found),
        found=found,
        document=document,
        rows=lambda: [
            {
                "serial": d.serial,
                "verdict": d.verdict,
                "effects": ", ".join(e.name for e in d.effects),
            }
            for d in found
        ],
        pictures=pictures,
    )


def foresee(plan: "Plan") -> "Result[tuple[MountingForeseen, ...]]":
    """Predict the sigmas of a planned test; the twin of `accelbench run --dry-run`.

    Parameters
    ----------
    plan : Plan
        From `make_plan`.

    Returns
    -------
    Result
        One row per coefficient and mounting, with its expected sigma.
    """
    from accelbench.shell.foreseen_plan import foresee_plan, plan_document

    foreseen = foresee_plan(plan)
    return Result(
        title=f"{plan.sequence.name}: {plan.runs} run(s), {plan.readings} readings",
        found=foreseen,
        document=plan_document(plan, foreseen),
        rows=lambda: [
            {"serials": ", ".join(one.serials), "name": e.name, "sigma": e.sigma, "unit": e.unit}
            for one in foreseen
            for e in one.coefficients.expected
        ],
        pictures=no_pictures,
    )


def combine(
    run: "RigRun",
    model: "ModelFile",
    *,
    serials: tuple[str, str, str] | None = None,
    mode: Literal["coarse", "precise"] = "coarse",
    groups: Sequence[str] = (),
) -> "Result[Combination]":
    """Calibrate a SINS with the chamber models of its accelerometers, in one filter.

    The twin of `accelbench combine`.

    Parameters
    ----------
    run : RigRun
        As `rig.read_run` reads it.
    model : ModelFile
        The chamber models.
    serials : tuple of str, optional
        Serial numbers on x, y and z; by default the three of the model in their order.
    mode : "coarse" or "precise"
        Without or with the rig's angle.
    groups : sequence of str
        Further groups of parameters to estimate.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the model lacks an accelerometer or the run lacks what the mode needs.
    """
    from accelbench.joint.chambers import chamber_model
    from accelbench.joint.combined import combine_and_judge

    names = serials or tuple(a.serial for a in model.accelerometers)
    chambers = [chamber_model(model.of(name)) for name in names]
    made, _, result = combine_and_judge(run, chambers, mode, groups=groups)
    document = result.model_dump(mode="json")

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.combine.figures import combine_pictures

        return combine_pictures(made, run, chambers, result)

    return Result(
        title="rig and chamber combined",
        found=made,
        document=document,
        rows=lambda: named_rows(document["parameters"]),
        pictures=pictures,
    )
