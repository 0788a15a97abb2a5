"""Python functions for what the commands of `accelbench rig` do."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from accelbench.result import Result, named_rows, no_pictures
from sinscal.judgement.options import Options

if TYPE_CHECKING:
    from accelbench.shell.plotting import Picture
    from sinscal.discrepancy.find import RigDiscrepancy
    from sinscal.flight.covariance import FlightCovariance, FlightNoise
    from sinscal.flight.trajectory import FlightPlan
    from sinscal.judgement.judge import Judged
    from sinscal.judgement.result_file import RigResult
    from sinscal.model.larger_model import RigModelFile
    from sinscal.planning.covariance import RigCovariance
    from sinscal.recording.run import RigRun
    from sinscal.triad.rests import RestCalibration
    from sinscal.twin.rehearse import Rehearsal
    from sinscal.twin.rig_file import RigFile


def calibrate(run: "RigRun", options: Options | None = None) -> "Result[tuple[Judged, RigResult]]":
    """Calibrate a SINS from its rig run and test the result; the twin of `rig calibrate`.

    Parameters
    ----------
    run : RigRun
        As `read_run` reads it.
    options : Options, optional
        By default the coarse mode with the basic groups.

    Returns
    -------
    Result
        `found` contains the calibration with its tests, and the content of the result file.

    Raises
    ------
    InputError
        If the run lacks data that the options need.
    """
    from accelbench.commands.rig_calibrate.text import calibration_document, verdict
    from sinscal.judgement.procedure import calibrate_and_judge
    from sinscal.judgement.result_file import make_result

    judged = calibrate_and_judge(run, options or Options())
    result = make_result(judged, run)
    document = calibration_document(result)

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.rig_calibrate.figures import calibration_pictures

        return calibration_pictures(judged, run, result)

    return Result(
        title=verdict(result),
        found=(judged, result),
        document=document,
        rows=lambda: named_rows(document["parameters"]),
        pictures=pictures,
    )


def covariance(
    programme: "RigFile",
    mode: Literal["coarse", "precise"] = "coarse",
    *,
    groups: Sequence[str] = (),
) -> "Result[RigCovariance]":
    """Predict the sigmas of a calibration before the test; the twin of `rig covariance`.

    Parameters
    ----------
    programme : RigFile
        As `read_programme` reads it.
    mode : "coarse" or "precise"
        Without or with the rig's angle.
    groups : sequence of str
        Groups of errors in addition to biases, scale errors and misalignments.

    Returns
    -------
    Result
        One row per parameter, with its prior sigma and its sigma after the test.
    """
    from accelbench.commands.rig_plan.text import analysis_document
    from sinscal.planning.advice import analyse_programme

    found, advice = analyse_programme(programme, mode, groups)
    document = analysis_document({mode: found}, {mode: advice})

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.rig_plan.figures import draw_budget, draw_planned_sigmas

        return [draw(found, mode) for draw in (draw_planned_sigmas, draw_budget)]

    return Result(
        title=f"{mode}: {len(found.names)} parameters",
        found=found,
        document=document,
        rows=lambda: named_rows(document[mode]["parameters"]),
        pictures=pictures,
    )


def simulate(
    programme: "RigFile", errors: Mapping[str, float] | None = None, *, seed: int = 1
) -> "Rehearsal":
    """Simulate the run of a rig programme; the twin of `rig simulate`.

    Parameters
    ----------
    programme : RigFile
    errors : mapping of str to float, optional
        The sensors' errors, SI; by default those of the programme's file.
    seed : int
        Random seed of the noise.

    Returns
    -------
    Rehearsal
        `run` is the rig run, `values` the true errors.
    """
    from sinscal.twin.rehearse import rehearse

    values = dict(programme.errors) if errors is None else dict(errors)
    return rehearse(programme, values, seed=seed, source="errors")


def flight(
    result: "RigResult",
    plan: "FlightPlan | None" = None,
    noise: "FlightNoise | None" = None,
    *,
    every_s: float = 10.0,
) -> "Result[FlightCovariance]":
    """Compute the position error in flight after a calibration; the twin of `rig flight`.

    Parameters
    ----------
    result : RigResult
        From `read_result`, or the second element of `found` of `calibrate`.
    plan : FlightPlan, optional
    noise : FlightNoise, optional
        Noise of the sensors and of the alignment.
    every_s : float
        Time between two rows of the table, s.

    Returns
    -------
    Result
        One row per time, with the position error.
    """
    from accelbench.commands.rig_flight.given import GivenCalibration
    from accelbench.commands.rig_flight.text import flight_document, fly_calibration
    from sinscal.flight.covariance import FlightNoise
    from sinscal.flight.trajectory import FlightPlan
    from sinscal.model.residual_errors import Calibration

    plan, noise = plan or FlightPlan(), noise or FlightNoise()
    one = Calibration.of_sensors(list(result.names), np.array(result.covariance))
    flown = fly_calibration(
        GivenCalibration(name=result.mode, calibration=one), plan, noise, every_s=every_s
    )
    found = flown.found
    return Result(
        title=f"position error {found.rho_end_m:.0f} m at the end",
        found=found,
        document=flight_document(plan, noise, [flown]),
        rows=lambda: [
            {"time_s": float(t), "rho_m": float(rho)}
            for t, rho in zip(found.time_s, found.rho_m, strict=True)
        ],
        pictures=no_pictures,
    )


def triad(
    file: Path | str, *, gravity_m_s2: float | None = None, with_temperature: bool = False
) -> "Result[RestCalibration]":
    """Calibrate an accelerometer triad from rests in many positions; the twin of `rig triad`.

    Parameters
    ----------
    file : path
        A recorded rig run.
    gravity_m_s2 : float, optional
        Local gravity; by default that of the run's site.
    with_temperature : bool
        True to fit slopes over temperature.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the rests do not separate the parameters.
    """
    from accelbench.commands.rig_triad.text import triad_document
    from sinscal.triad.rests import calibrate_at_rest, rests_of_run

    found = calibrate_at_rest(
        rests_of_run(Path(file), gravity_m_s2), gauge="lower", with_temperature=with_temperature
    )
    document = triad_document(found)

    def pictures() -> "Iterable[Picture]":
        from accelbench.commands.rig_triad.figures import draw_triad

        return [draw_triad(found)]

    return Result(
        title=f"triad of {file}",
        found=found,
        document=document,
        rows=lambda: named_rows(document["parameters"]),
        pictures=pictures,
    )


def discrepancy(
    run: "RigRun", *, present: "RigModelFile | None" = None, seed: int = 1
) -> "Result[RigDiscrepancy]":
    """Find and name the effect that the rig filter lacks; the twin of `discrepancy rig`.

    Parameters
    ----------
    run : RigRun
    present : RigModelFile, optional
        The present model; by default the basic errors alone.
    seed : int
        Random seed of the simulated nulls.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        If the run lacks what the mode needs.
    """
    from accelbench.commands.discrepancy.rig.text import rig_document
    from sinscal.discrepancy.find import find_rig_discrepancy

    found = find_rig_discrepancy(run, present=present, seed=seed)
    document = rig_document(found)
    return Result(
        title=f"discrepancy: {document['verdict']}",
        found=found,
        document=document,
        rows=lambda: [{"verdict": document["verdict"], "effects": document.get("effects")}],
        pictures=no_pictures,
    )
