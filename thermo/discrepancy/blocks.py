"""Readings averaged in blocks: means over a minute at one position keep all slow changes."""

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import FloatArray, IntArray
from errormodel.noise.whitening import TimeBase
from thermo.library.moves import TURNED_DEG
from thermo.recording.channel import Channel

BLOCK_S = 60.0
# A short log is still divided into some 600 blocks.
LEAST_BLOCKS = 600
# A long record is cut into longer blocks: what is slow needs no more, and the search's time grows
# with their number.
MOST_BLOCKS = 2400
SOON = 1.0 / 3.0  # of a block after a turn, which is a block of its own


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Blocks:
    """Readings averaged together: consecutive ones of one run at one position.

    Attributes
    ----------
    starts : ndarray of int, shape (b,)
        First reading of each block.
    counts : ndarray, shape (b,)
        Readings in each.
    times : TimeBase
        Times of the block means; the white variance is that of the usual block.
    """

    starts: IntArray
    counts: FloatArray
    times: TimeBase

    def mean(self, columns: FloatArray) -> FloatArray:
        """Return block means of columns (n,) or (n, m)."""
        total = np.add.reduceat(np.asarray(columns, dtype=float), self.starts, axis=0)
        return total / (self.counts if columns.ndim == 1 else self.counts[:, None])

    def spread(self, values: FloatArray) -> tuple[float, int]:
        """Return the pooled sigma of readings within blocks, and its degrees of freedom."""
        index = np.repeat(np.arange(self.starts.size), self.counts.astype(int))
        apart = values - self.mean(values)[index]
        dof = int(np.sum(self.counts - 1))
        return (float(np.sqrt(np.sum(apart**2) / dof)) if dof else 0.0), dof

    @property
    def usual(self) -> float:
        """Median number of readings in a block."""
        return float(np.median(self.counts))


def blocks_of(channel: Channel) -> Blocks:
    """Cut a channel's readings into blocks.

    A new block begins with a new run, at a new position, after a gap, and after a minute; the
    first minute after a turn is cut once more, as what dies away soon after it shows there.
    """
    record = channel.record
    time_s, run = record.time_s, record.run
    spans = sum(float(np.ptp(time_s[r])) for r in record.run_slices)
    length_s = max(min(BLOCK_S, spans / LEAST_BLOCKS), spans / MOST_BLOCKS)
    new_run = np.diff(run) != 0
    force = np.column_stack([record["a_i_g"], record["a_p_g"]])
    turned = np.abs(np.diff(force, axis=0)).max(axis=1) > 1e-4
    turned |= np.abs(np.diff(record["head_deg"])) > TURNED_DEG
    steps = np.where(new_run, 0.0, np.diff(time_s))
    gap = steps > 4.0 * float(np.median(steps[~new_run])) if steps.size else steps > 0
    edges = np.concatenate([[True], new_run | turned | gap])
    dwell = np.cumsum(edges) - 1
    begun = time_s[np.flatnonzero(edges)][dwell]
    since = (time_s - begun) / max(length_s, 1e-9)
    moved = np.concatenate([[False], turned & ~new_run])[np.flatnonzero(edges)][dwell]
    piece = np.floor(since + 1e-9) + (moved & (since >= SOON))
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(dwell) != 0) | (np.diff(piece) != 0)]))
    counts = np.diff(np.append(starts, time_s.size)).astype(float)
    mean_s = np.add.reduceat(time_s, starts) / counts
    elapsed_s = 3600.0 * np.add.reduceat(record["elapsed_h"], starts) / counts
    times = TimeBase(mean_s, run[starts], float(np.median(counts)) / counts, elapsed_s)
    return Blocks(starts=starts, counts=counts, times=times)
