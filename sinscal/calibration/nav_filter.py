"""The filter of navigation outputs: from the readings behind them to the errors of the sensors.

Its nominal (sensor errors, attitudes at the start of each cycle) predicts what a SINS at rest would
measure without any approximation; only what noise and the nominal's own errors add is linear, and
it shrinks as the nominal is improved. States: attitude error of the nominal, what is left of the
integrals of the measured force, the attitudes at the starts, the unknowns of the sensors.

With D = exp(φ ×), φ the attitude error of the SINS, true attitude is D·C. The indicated local axes
turn at their spin less C·δω against the true ones, so that D follows by the same integration as the
attitude of a body. The measured force is Dᵀγ + C·δf in the indicated axes, γ = (0, 0, g).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import FloatArray
from errormodel.filter.kalman import State, initial_state
from errormodel.filter.steps import Steps, join_steps
from sinscal.calibration.nav_outputs import NavCycle
from sinscal.filter.data import Nominal, RigNoise
from sinscal.filter.force_rows import force_steps, sensor_columns
from sinscal.filter.integrate import attitudes, sum_columns
from sinscal.filter.layout import RigLayout
from sinscal.frames.attitude import rotvec_of
from sinscal.frames.earth import Site
from sinscal.model.motion import Motion
from sinscal.model.noise import InertialNoise
from sinscal.model.priors import RigPrior
from sinscal.model.sensors import SensorModel
from sinscal.recording.run import rate_derivative

# The errors depend on the true motion, and that on the errors, in a thousandth of their size: after
# three rounds 1e-6 of them is left out.
ROUNDS = 3
# Outputs of unlimited resolution are taken to be as good as this. From second to second the true
# errors predict the velocity to 1e-6 m/s while the rate stays; that positions are the integrals of
# velocities holds to 1 mm over 40 minutes, by a navigator's steps of 50 ms, and coarser ones exist.
VELOCITY_FLOOR_M_S = 1e-6
POSITION_FLOOR_M = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class NavNoise(InertialNoise):
    """Noise of the sensors behind the outputs, and of the outputs themselves.

    Attributes
    ----------
    velocity_m_s, position_m : float
        Sigma of an output about the navigator's own value: rounding, and what the course between
        two outputs leaves open.
    tilt_sigma_rad, azimuth_sigma_rad : float
        Of the attitude a cycle starts with.
    """

    velocity_m_s: float = VELOCITY_FLOOR_M_S
    position_m: float = POSITION_FLOOR_M
    tilt_sigma_rad: float = 0.01
    azimuth_sigma_rad: float = 0.1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Predicted:
    """Prediction of one cycle at the linearisation point.

    Attributes
    ----------
    true : Motion
        Rates and forces that act on the sensors over the N steps.
    apart : ndarray, shape (N, 3, 3)
        D at the middles of the steps: takes the indicated local axes to the true ones.
    velocity, position : ndarray, shape (n, 3)
        As `NavCycle` has them measured.
    pushed : ndarray, shape (n − 1, 3)
        What the errors of the accelerometers add to the velocity over each interval, m/s.
    """

    true: Motion
    apart: FloatArray
    velocity: FloatArray
    position: FloatArray
    pushed: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavFilter:
    """The filter of one run: its cycles, its sensors, and what is known beforehand.

    Attributes
    ----------
    cycles : sequence of NavCycle
    sensors : SensorModel
    prior : RigPrior
    noise : NavNoise
    site : Site
    free : bool
        Whether the vertical channel runs free; a held one tells nothing.
    """

    cycles: Sequence[NavCycle]
    sensors: SensorModel
    prior: RigPrior
    noise: NavNoise
    site: Site
    free: bool

    @property
    def axes(self) -> str:
        """The local axes in which velocity and position tell something."""
        return "enu" if self.free else "en"

    @property
    def layout(self) -> RigLayout:
        """The states."""
        return RigLayout(
            cycles=len(self.cycles),
            parameters=self.sensors.names,
            integrals=tuple(f"{what}_{a}" for what in ("velocity", "position") for a in self.axes),
        )

    def first_nominal(self) -> Nominal:
        """Return what is known beforehand: the prior's errors and the attitudes indicated."""
        return Nominal(
            values=self.prior.values,
            c_start=tuple(c.c_start for c in self.cycles),
            earth=tuple(self.site.earth_rate for _ in self.cycles),
            mount=np.zeros(3),
        )

    def start(self, nominal: Nominal) -> State:
        """Return the state before all data, about a nominal."""
        layout, noise = self.layout, self.noise
        x, cov = np.zeros(layout.size), np.zeros((layout.size, layout.size))
        unknown = layout.unknowns
        x[unknown] = self.prior.values - nominal.values
        cov[unknown, unknown] = self.prior.cov
        sigmas = [noise.tilt_sigma_rad, noise.tilt_sigma_rad, noise.azimuth_sigma_rad]
        for k, cycle in enumerate(self.cycles):
            place = layout.start(k)
            x[place] = rotvec_of(cycle.c_start @ nominal.c_start[k].T)
            cov[place, place] = np.diag(np.square(sigmas))
        return initial_state(x, cov)

    def steps(self, nominal: Nominal, chord: Steps | None = None) -> Steps:
        """Return all cycles' steps about a nominal, with the derivatives of `chord` if given.

        Returns
        -------
        Steps
            Of each cycle one without measurement, in which the moving attitude becomes the copy of
            that at its start, then one for each output.
        """
        cycles = range(len(self.cycles))
        seen = [self.predict(nominal, k) for k in cycles]
        if chord is None:
            made = [(self._restart(k), self._cycle_steps(nominal, k, seen[k])) for k in cycles]
            chord = join_steps([step for pair in made for step in pair])
        none = np.full((1, chord.z.shape[1]), np.nan)
        left = [part for k in cycles for part in (none, self._left(seen[k], k))]
        return replace(chord, z=np.concatenate(left))

    def _left(self, seen: Predicted, k: int) -> FloatArray:
        """Return by how much the integrals of the force exceed those predicted, shape (n, m)."""
        cycle, used = self.cycles[k], len(self.axes)
        left = [cycle.velocity - seen.velocity, cycle.position - seen.position]
        z = np.hstack([a[:, :used] for a in left])
        z[0] = np.nan  # they begin with the first output
        return z

    def predict(self, nominal: Nominal, k: int) -> Predicted:
        """Compute what a nominal makes of cycle k."""
        cycle, gravity = self.cycles[k], np.array([0.0, 0.0, self.site.gravity_m_s2])
        apart_start = nominal.c_start[k] @ cycle.c_start.T
        step_s, c_nb = cycle.step_s, cycle.c_nb
        errors = np.zeros((step_s.size, 6))
        true, apart = None, c_nb
        for _ in range(ROUNDS):
            drift = (c_nb @ errors[:, :3, None])[:, :, 0]
            apart, _ = attitudes(cycle.spin - drift, step_s, apart_start, nominal.earth[k])
            true = self._motion(cycle, errors, (apart @ c_nb)[:, 2] * gravity[2])
            errors = self.sensors.errors(true, nominal.values)
        assert true is not None
        pushed = (c_nb @ errors[:, 3:, None])[:, :, 0] * step_s[:, None]
        velocity = _summed((apart[:, 2] * gravity[2] - gravity) * step_s[:, None] + pushed)
        position = _summed(0.5 * (velocity[1:] + velocity[:-1]) * step_s[:, None])
        return Predicted(
            true=true,
            apart=apart,
            velocity=velocity[cycle.first],
            position=position[cycle.first],
            pushed=np.add.reduceat(pushed, cycle.first[:-1]),
        )

    def _motion(self, cycle: NavCycle, errors: FloatArray, force: FloatArray) -> Motion:
        w = cycle.w - errors[:, :3]
        return Motion(
            time_s=np.cumsum(cycle.step_s),
            step_s=cycle.step_s,
            w=w,
            f=force,
            dw=rate_derivative(w, cycle.step_s),
            temp_c=cycle.temp_c,
        )

    def _cycle_steps(self, nominal: Nominal, k: int, seen: Predicted) -> Steps:
        """Return a cycle's derivatives: at each output a measurement, then the motion on."""
        cycle, true = self.cycles[k], seen.true
        columns = sensor_columns(self.sensors, true, nominal.values)
        columns = replace(columns, accel_frame=np.eye(3))  # the true force is known: it is gravity
        good = np.ones(len(true))
        found = sum_columns(seen.apart @ cycle.c_nb, true.step_s, good, columns, cycle.first)
        sensed = RigNoise(gyro=self.noise.gyro, accel=self.noise.accel)
        force = force_steps(found, self.layout, sensed, nominal.earth[k], self.site.gravity_m_s2, k)
        to_shown = np.swapaxes(seen.apart[cycle.first[:-1]], 1, 2)
        grown = found.length_s[:, None, None] * (to_shown @ force.h)[:, : len(self.axes)]
        left_open = cycle.bend * np.linalg.norm(seen.pushed, axis=1)
        return self._integrals(force, grown, found.length_s, left_open)

    def _integrals(
        self, attitude: Steps, grown: FloatArray, length_s: FloatArray, left_open: FloatArray
    ) -> Steps:
        """Return the steps of a cycle that measure the integrals of the force.

        What is left open of an interval's course turns what the errors of the accelerometers add
        to the velocity, by an unknown angle of that sigma.

        The state of position is p − t·v/2, t the length of the interval before: over an interval
        p grows by t·(v₀ + v₁)/2 and by noise that is independent of the velocity's, of variance
        t³/12 of its density's square.
        """
        lead, n = attitude.phi.shape[1:]
        count, used = length_s.size + 1, len(self.axes)
        m = 2 * used
        v, p = slice(3, 3 + used), slice(3 + used, lead)
        one, half = np.eye(used), 0.5 * length_s[:, None, None]
        phi, q = np.zeros((count, lead, n)), np.zeros((count, lead))
        phi[:, :lead, :lead] = np.eye(lead)  # after the last output nothing moves
        phi[:-1] = attitude.phi
        phi[:-1, v] = grown
        phi[:-1, v, v] += one
        phi[:-1, p, p] = one
        phi[:-1, p, v] = half * one
        phi[1:-1, p, v] += half[:-1] * one
        q[:-1] = attitude.q
        q[:-1, v] = (self.noise.accel**2 * length_s + left_open**2)[:, None]
        q[:-1, p] = self.noise.accel**2 * length_s[:, None] ** 3 / 12.0
        h = np.zeros((count, m, n))
        h[:, :, 3:lead] = np.eye(m)
        h[1:, used:, v] = half * one
        return Steps(
            h=h,
            z=np.full((count, m), np.nan),
            r=np.tile(self._output_variances, (count, 1)),
            phi=phi,
            q=q,
        )

    @property
    def _output_variances(self) -> FloatArray:
        sigmas = [self.noise.velocity_m_s, self.noise.position_m]
        return np.repeat(np.square(sigmas), len(self.axes))

    def _restart(self, k: int) -> Steps:
        """Return the step before cycle k; the first outputs are as uncertain as all others."""
        layout = self.layout
        m, n, lead = 2 * len(self.axes), layout.size, layout.moving
        phi = np.zeros((1, lead, n))
        phi[0, :3, layout.start(k)] = np.eye(3)
        return Steps(
            h=np.zeros((1, m, n)),
            z=np.full((1, m), np.nan),
            r=np.ones((1, m)),
            phi=phi,
            q=np.concatenate([np.zeros(3), self._output_variances])[None],
        )


def _summed(parts: FloatArray) -> FloatArray:
    """Return sums of all parts before, shape (N + 1, 3)."""
    return np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])
