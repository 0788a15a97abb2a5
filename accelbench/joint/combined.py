"""A rig run and its accelerometers' chamber models in one filter, judged, as a result."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from accelbench.joint.result_file import CombinedResult, make_combined
from sinscal.calibration.noise import noise_of_run
from sinscal.calibration.rig import Mode
from sinscal.combination.combine import Combination, combine
from sinscal.judgement.judge import Judged, judge_calibration
from sinscal.library import BASIC
from sinscal.model.chamber import ChamberModel
from sinscal.model.priors import PriorFile
from sinscal.recording.run import RigRun


def combine_and_judge(
    run: RigRun,
    chambers: Sequence[ChamberModel],
    mode: Mode,
    *,
    groups: Sequence[str] = (),
    priors: PriorFile | None = None,
    turn_on: Mapping[str, float] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Combination, Judged, CombinedResult]:
    """Combine a rig run with chamber models, and judge the calibration.

    Parameters
    ----------
    run, chambers, mode, priors, turn_on, tell
        As `sinscal.combination.combine.combine` takes them.
    groups : sequence of str
        Estimated in addition to the basic ones.

    Returns
    -------
    Combination, Judged, CombinedResult

    Raises
    ------
    InputError
        If the run lacks what the mode needs.
    """
    noise = noise_of_run(run, angle=mode == "precise" and run.rig_angle_rad is not None)
    made = combine(
        run,
        chambers,
        mode,
        groups=(*BASIC, *(g for g in groups if g not in BASIC)),
        priors=priors,
        turn_on=turn_on,
        noise=noise.noise,
        tell=tell,
    )
    flag = np.asarray(run.flag)
    judged = judge_calibration(
        made.calibration,
        [int(np.sum(flag[rows])) for rows in run.cycles],
        (),
        noise_known=not noise.estimated,
        warnings=noise.warnings,
    )
    return made, judged, make_combined(made, judged, run, chambers)
