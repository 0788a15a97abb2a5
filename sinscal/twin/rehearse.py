"""A rig run rehearsed: the sensors' errors given or drawn from the priors, the run simulated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.errors import InputError
from sinscal.library import BASIC, rig_library
from sinscal.library.angle import TIME_OFFSET
from sinscal.model.chamber import (
    CHAMBERS_OWN,
    ChamberModel,
    chamber_names,
    combined_prior,
    combined_sensors,
)
from sinscal.model.priors import PriorFile, make_prior
from sinscal.model.sensors import SensorModel, sensor_model
from sinscal.recording.run import RigRun
from sinscal.twin.motion import rig_motion
from sinscal.twin.rig_file import RigFile
from sinscal.twin.simulate import simulate_rig


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rehearsal:
    """A simulated run and what is true of it: `values` by name; `units` and model of `sensors`."""

    run: RigRun
    values: Mapping[str, float]
    units: Mapping[str, str]
    sensors: SensorModel


def sensors_with(groups: Sequence[str], file: RigFile, *, angle: bool) -> SensorModel:
    """Return the sensors of some groups, the basic ones always among them, as a run can show them.

    Raises
    ------
    InputError
        If there is no such group, or it needs temperatures and the file states none.
    """
    wanted = [*BASIC, *(g for g in groups if g not in BASIC)]
    if angle and TIME_OFFSET not in wanted:
        wanted.append(TIME_OFFSET)
    known = rig_library().groups
    for group in wanted:
        if group not in known:
            raise InputError("--groups", group, f"expected some of {', '.join(known)}")
        if known[group].needs_temperature and file.temperature is None:
            raise InputError("--groups", group, "needs the programme's [temperature]")
        if known[group].needs_angle and not angle:
            raise InputError("--groups", group, "needs the rig's angle")
    return sensor_model(wanted)


def drawn_errors(
    sensors: SensorModel, rng: np.random.Generator, priors: PriorFile | None = None
) -> dict[str, float]:
    """Draw the errors of sensors from their priors; those of the rig's angle stay zero."""
    prior = make_prior(sensors, priors)
    root = np.sqrt(np.diag(prior.cov))
    drawn = prior.values + root * rng.standard_normal(root.size)
    owners = zip(sensors.names, sensors.owner, drawn.tolist(), strict=True)
    return {name: value for name, owner, value in owners if owner < 6}


def groups_of(values: Mapping[str, float], source: str) -> tuple[str, ...]:
    """Return the groups that named errors belong to.

    Raises
    ------
    InputError
        If a name is no error of a sensor.
    """
    groups: dict[str, None] = {}
    for name in values:
        try:
            groups[rig_library().parameter(name).family] = None
        except KeyError:
            raise InputError(source, name, "is not an error of a sensor or an angle") from None
    return tuple(groups)


def rehearse(
    file: RigFile,
    values: Mapping[str, float],
    *,
    seed: int,
    source: str = "the programme",
    accelerometers: Sequence[ChamberModel] = (),
) -> Rehearsal:
    """Simulate the run that a file describes.

    Parameters
    ----------
    file : RigFile
    values : mapping of str to float
        The sensors' errors, SI.
    seed : int
    source : str
        Where the values came from, for complaints.
    accelerometers : sequence of three ChamberModel, optional
        The true ones on x, y, z, over temperature; by default ideal ones with the errors given.

    Raises
    ------
    InputError
        If the file's motion is not possible, or a value belongs to no sensor.
    """
    angle = file.recording.angle
    sensors = sensors_with(groups_of(values, source), file, angle=angle)
    if accelerometers:
        sensors, values = _mounted(sensors, values, accelerometers, file, source)
    if unknown := [name for name in values if name not in sensors.names]:
        raise InputError(source, unknown[0], "is not an error of a sensor or an angle")
    try:
        true = rig_motion(file, file.recording.rate_hz, file.faults.faults)
    except ValueError as err:
        raise InputError(source, "cycles", str(err)) from None
    if not accelerometers:
        sensors = replace(sensors, gravity_m_s2=true.site.gravity_m_s2)
    run = simulate_rig(
        true,
        sensors,
        values,
        file.noise.simulated,
        np.random.default_rng(seed),
        faults=file.faults.faults,
        warming=file.warming,
        with_angle=angle,
    )
    known = file.azimuth_sigma_rad
    facts = replace(
        run.facts,
        azimuth_rad=None if known is None else run.facts.azimuth_rad,
        azimuth_sigma_rad=known if known is not None else run.facts.azimuth_sigma_rad,
    )
    return Rehearsal(
        run=replace(run, facts=facts), values=dict(values), units=sensors.units, sensors=sensors
    )


def _mounted(
    sensors: SensorModel,
    values: Mapping[str, float],
    accelerometers: Sequence[ChamberModel],
    file: RigFile,
    source: str,
) -> tuple[SensorModel, Mapping[str, float]]:
    """Return the sensors with the accelerometers' own models, and all true values."""
    if file.temperature is None:
        raise InputError(source, "temperature", "missing; accelerometers of a chamber need it")
    groups = tuple(dict.fromkeys(one.family for one in sensors.parameters.values()))
    mounted = combined_sensors(accelerometers, groups)
    true = combined_prior(mounted, accelerometers).values
    own = chamber_names(mounted, accelerometers)
    kept = {n: v for n, v in values.items() if sensors.parameters[n].family not in CHAMBERS_OWN}
    return mounted, kept | {n: float(true[mounted.names.index(n)]) for n in own}
