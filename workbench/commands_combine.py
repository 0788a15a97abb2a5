"""`accelbench combine`: a SINS calibrated on the rig with its accelerometers' chamber models."""

import json
from pathlib import Path

import click
import numpy as np

from errormodel.atomic import write_files
from sinscal.combine import combine as combine_run
from sinscal.combined import ChamberModel
from sinscal.judged import judge
from sinscal.noise_estimate import noise_of_run
from sinscal.priors import read_priors
from sinscal.recording import read_rig_run
from sinscal.terms import BASIC, GROUPS
from thermo.modelfile import AccelerometerModel, ModelFile, read_model, reporting_factors
from workbench.combine_output import combined_document, combined_text
from workbench.console import emit, show_warnings_at_once
from workbench.outputs import checked_output, force_option, json_option, with_sidecars

FAILED = 1


@click.command()
@click.option("--thermal", type=Path, required=True, help="MODEL.json of fit.")
@click.option("--rig", type=Path, required=True, help="DATA.csv: the rig run, with temperatures.")
@click.option("--accelerometers", metavar="SX,SY,SZ",
              help="Serial numbers on x, y, z; by default the model file's three, in order.",
              )  # fmt: skip
@click.option("--mode", type=click.Choice(["coarse", "precise"]), default="coarse",
              help="Raw sensors; raw sensors and the rig's angle.")  # fmt: skip
@click.option(
    "--groups", multiple=True, metavar="NAME", help="Also estimate, e.g. lever_arm; repeatable."
)
@click.option("--priors", type=Path, help="PRIORS.toml: other sigmas and means beforehand.")
@click.option("--turn-on-ug", type=click.FloatRange(min=0.0), default=0.0,
              help="Sigma by which K0 may have changed since the chamber, µg.")  # fmt: skip
@click.option("--turn-on-ppm", type=click.FloatRange(min=0.0), default=0.0,
              help="Sigma by which K1 may have changed since the chamber, ppm.")  # fmt: skip
@click.option("--out", type=Path, help="RESULT.json to write: the compensation file for flight.")
@force_option
@json_option
def combine(
    thermal: Path,
    rig: Path,
    accelerometers: str | None,
    mode: str,
    groups: tuple[str, ...],
    priors: Path | None,
    turn_on_ug: float,
    turn_on_ppm: float,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Calibrate a SINS that warms itself, rig and chamber correcting each other.

    Exit code 1 when rig and chamber contradict each other or the iteration does not come to rest.
    In Python: sinscal.combine.combine.
    """
    if out is not None:
        inputs = [thermal, *with_sidecars([rig]), *([priors] if priors else [])]
        checked_output(out, inputs, force=force)
    asked = _groups(groups)
    chambers = _chambers(read_model(thermal), accelerometers)
    known = read_priors(priors) if priors else None
    run = read_rig_run(rig)
    show_warnings_at_once()
    noise = noise_of_run(run, angle=mode == "precise" and run.rig_angle_rad is not None)
    made = combine_run(
        run,
        chambers,
        "precise" if mode == "precise" else "coarse",
        groups=(*BASIC, *asked),
        priors=known,
        turn_on={"k0": 1e-6 * turn_on_ug, "k1": 1e-6 * turn_on_ppm},
        noise=noise.noise,
        tell=lambda text: click.echo(text, err=True),
    )
    flag = np.asarray(run.flag)
    judged = judge(
        made.calibration,
        [int(np.sum(flag[rows])) for rows in run.cycles],
        (),
        noise_known=not noise.estimated,
        warnings=noise.warnings,
    )
    document = combined_document(made, judged, run, chambers)
    text = list(combined_text(document))
    if out is not None:
        content = json.dumps(document, ensure_ascii=False, indent=1) + "\n"
        write_files([(out, content.encode())])
        document["out"] = str(out)
        text.append(f"result file: {out}")
    emit(document, text, as_json=as_json)
    failed = bool(made.test.contradictions) or not made.calibration.converged
    return FAILED if failed else 0


def _groups(asked: tuple[str, ...]) -> tuple[str, ...]:
    names = tuple(n.strip() for one in asked for n in one.split(",") if n.strip())
    for name in names:
        if name not in GROUPS:
            raise click.UsageError(f"--groups {name}: expected one of {', '.join(GROUPS)}")
    return tuple(dict.fromkeys(n for n in names if n not in BASIC))


def _chambers(model: ModelFile, asked: str | None) -> list[ChamberModel]:
    """Return the chamber models of x, y, z."""
    serials = (
        [s.strip() for s in asked.split(",")] if asked else [a.serial for a in model.accelerometers]
    )
    if len(serials) != 3 or len(set(serials)) != 3:
        raise click.UsageError(
            f"--accelerometers: {len(serials)} serial numbers ({', '.join(serials)}), "
            "expected three different ones, of x, y, z"
        )
    return [chamber_model(model.of(serial)) for serial in serials]


def chamber_model(one: AccelerometerModel) -> ChamberModel:
    """Return a fitted model as the rig takes it: in the model's own units."""
    model = one.error_model()
    factors = reporting_factors(model, one.nominal_scale)
    scale = np.array([factors[n] for n in model.names])
    values = one.values()
    return ChamberModel(
        serial=one.serial,
        model=model,
        values=np.array([values[n] for n in model.names]),
        cov=np.array(one.covariance) / np.outer(scale, scale),
        gravity_m_s2=one.gravity_m_s2,
        t_ref_c=one.t_ref_c,
        valid_c=one.valid_c,
    )
