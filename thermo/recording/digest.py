"""The digest of a run's content, made piece by piece."""

import hashlib
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from thermo.recording.labels import FloatArray
from thermo.recording.output_scale import OutputScale


class RunDigest:
    """The SHA-256 of a run's content, whatever the order of its accelerometers in a file.

    `begin` each accelerometer, in the order of the serial numbers, and `add` its readings in
    order of time, in as many pieces as is convenient.
    """

    def __init__(self) -> None:
        self._total = hashlib.sha256(b"accelbench recorded run 1\n")
        self._flags: list[tuple[str, int]] = []  # with how often they stand one after another

    def begin(self, serial: str, scale: OutputScale, mount_deg: float, n: int) -> None:
        """Begin an accelerometer of n readings, mounted turned by an angle, 0 when it is not."""
        self._end()
        head = (serial, scale.output_unit, scale.gravity_m_s2.hex(), scale.nominal_scale.hex())
        head += (mount_deg.hex(),) if mount_deg else ()
        if scale.temp_sigma_c or scale.temp_gain_ppm:  # they widen the sigmas of a fit
            head += ("thermistor", scale.temp_sigma_c.hex(), scale.temp_gain_ppm.hex())
        self._total.update("\t".join((*head, str(n))).encode() + b"\n")

    def add(self, columns: Sequence[FloatArray], flags: Sequence[str]) -> None:
        """Add readings: the numbers in the order of `NUMBERS`, and their flags."""
        numbers = np.column_stack(columns)
        numbers = np.where(np.isnan(numbers), np.nan, numbers) + 0.0  # one NaN, no minus zero
        self._total.update(numbers.astype("<f8").tobytes())
        self._flags += [(flag, sum(1 for _ in same)) for flag, same in groupby(flags)]

    def hexdigest(self) -> str:
        """Return the digest of what was added, hexadecimal."""
        self._end()
        return self._total.hexdigest()

    def _end(self) -> None:
        for flag, count in self._flags:
            self._total.update((flag + "\n").encode() * count)
        self._flags.clear()
