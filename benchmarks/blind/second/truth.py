"""One seed makes a set: a campaign, accelerometers, their noise, and what is hidden in one.

Strength d: the effect's column at its size, whitened by the noise that is truly there, less what
the columns of the present model take of it. A set whose truth nobody could tell is drawn anew: an
effect that would have to be larger than MOST_UG, a second one that lies within the first, or one
outside the library that a single name of the library explains nearly all of.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.second import library, outside
from benchmarks.blind.second.accelerometer import Accelerometer, draw_accelerometer
from benchmarks.blind.second.campaign import Campaign, draw_protocol, make_campaign
from benchmarks.blind.second.noise import Noise, draw_noise, project_out, white_sigma, whiten
from benchmarks.blind.second.plan import group_of, name_of

Floats = NDArray[np.float64]

MOST_UG = 500.0  # rms of a hidden effect
TRIES = 40
LEAST_BESIDE = 0.4  # of d that must be left when the other effect is fitted too
MOST_SHARE = 0.85  # of the square of an outside effect that one library name may explain
LEAST_BEYOND = 8.0  # strength that no library name takes
LAGS_S = np.exp(np.linspace(np.log(0.3), np.log(1500), 18))


@dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """One hidden effect: its column at its size, µg, and all that the score needs."""

    name: str
    outside: bool
    column: Floats
    size: float
    parameters: dict[str, float]
    d: float
    d_beside: float
    shares: dict[str, float]  # of its square, by each library name alone; outside only


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """A set before its noise is drawn."""

    seed: int
    group: str
    campaign: Campaign
    accelerometer: Accelerometer
    noise: Noise
    kept: NDArray[np.bool_]  # readings that are good and written; the unseen run is none of them
    hidden: tuple[Hidden, ...]


def make_truth(seed: int) -> Truth:
    """Draw sets from a seed until what is hidden can be told by somebody."""
    rng = np.random.default_rng([20261201, seed])
    for _ in range(TRIES):
        if (truth := _try(seed, rng)) is not None:
            return truth
    raise RuntimeError(f"seed {seed}: nothing to be told in {TRIES} tries")


def _try(seed: int, rng: np.random.Generator) -> Truth | None:
    group = group_of(seed)
    names = _names(seed, rng)
    needs: dict[str, tuple[object, ...]] = {}
    for name in sorted(names, key=outside.KINDS.__contains__):  # the outside effect's needs go first
        kind = outside.KINDS.get(name)
        needs.update(kind.needs if kind else library.NEEDS.get(name, {}))
    fixed = {name: values[int(rng.integers(len(values)))] for name, values in needs.items()}
    c = make_campaign(draw_protocol(rng, **fixed), rng)
    acc, noise = draw_accelerometer(rng, c, names), draw_noise(rng)
    kept = _kept(c, noise, rng)
    drawn = [_draw(name, c, acc, rng) for name in names]
    low = [np.log(20 if n in outside.KINDS or group == "outside" else 5) for n in names]
    targets = [float(np.exp(rng.uniform(lo, np.log(200)))) for lo in low]
    hidden = _sized(c, acc, noise, kept, names, drawn, targets) if names else ()
    if hidden is None or not all(_decidable(h) for h in hidden):
        return None
    return Truth(
        seed=seed, group=group, campaign=c, accelerometer=acc, noise=noise, kept=kept, hidden=hidden
    )


def _names(seed: int, rng: np.random.Generator) -> tuple[str, ...]:
    first, beside = name_of(seed)
    if not beside:
        return (first,) if first else ()
    others = [name for name in library.NAMES if name != first]
    return first, str(rng.choice(others))


def _draw(name: str, c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> library.Drawn:
    if name in outside.KINDS:
        return outside.KINDS[name].make(c, rng)
    return library.draw(name, c, acc, rng)


def _kept(c: Campaign, noise: Noise, rng: np.random.Generator) -> NDArray[np.bool_]:
    kept = (c["moving"] == 0) & ~c.unseen
    for _ in range(noise.gaps):
        run = c.run == rng.integers(c.protocol.runs)
        start = rng.uniform(0, c["t_s"][run][-1])
        end = start + rng.uniform(600, 2400)
        kept &= ~(run & (c["t_s"] > start) & (c["t_s"] < end))
    return kept


def strengths(
    c: Campaign, acc: Accelerometer, noise: Noise, kept: NDArray[np.bool_], columns: Floats
) -> Floats:
    """Return columns whitened, less what the present model takes of them, shape (n kept, p)."""
    sigma = white_sigma(noise, acc.slope_ug_per_c(c))[kept]
    model = acc.columns(c)[kept]
    both = np.hstack([model, columns[kept]])
    white = whiten(noise, sigma, c["elapsed_h"][kept], c.run[kept], both)
    return project_out(white[:, model.shape[1] :], white[:, : model.shape[1]])


def _sized(
    c: Campaign,
    acc: Accelerometer,
    noise: Noise,
    kept: NDArray[np.bool_],
    names: tuple[str, ...],
    drawn: list[library.Drawn],
    targets: list[float],
) -> tuple[Hidden, ...] | None:
    """Give each effect the size of its strength; None where that would be too large."""
    rivals = library.rivals(c, acc) if any(n in outside.KINDS for n in names) else {}
    widths = [(name, part) for name, parts in rivals.items() for part in parts]
    columns = [_lag_columns(c, acc) if n == "thermal_lag" else u[:, None]
               for n, (u, _) in zip(names, drawn, strict=True)]  # fmt: skip
    white = strengths(
        c, acc, noise, kept, np.hstack([*columns, *(part for _, part in widths)])
    )
    found, at = [], 0
    for name, (unit, said), column, target in zip(names, drawn, columns, targets, strict=True):
        length = np.linalg.norm(white[:, at : at + column.shape[1]], axis=0)
        at += column.shape[1]
        if name == "thermal_lag":
            if not length[0] < target < length[-1]:
                return None
            tau = float(np.exp(np.interp(np.log(target), np.log(length), np.log(LAGS_S))))
            found.append((tau, acc.lagged_ug(c, library.inner_x(c, tau)), {"tau_s": tau}))
        else:
            if length[0] < 1e-9 * max(np.linalg.norm(unit), 1e-300):
                return None
            size = target / length[0]
            found.append((size, size * unit, said))
        if np.sqrt(np.mean(found[-1][1][kept] ** 2)) > MOST_UG:
            return None
    effects = np.column_stack([column for _, column, _ in found])
    final = strengths(c, acc, noise, kept, effects)
    shares = _shares(final, white[:, at:], widths) if rivals else {}
    out = []
    for k, (name, (size, column, said)) in enumerate(zip(names, found, strict=True)):
        others = np.delete(final, k, axis=1)
        rest = project_out(final[:, [k]], others) if others.shape[1] else final[:, [k]]
        out.append(
            Hidden(
                name=name,
                outside=name in outside.KINDS,
                column=column,
                size=size,
                parameters=said,
                d=float(np.linalg.norm(final[:, k])),
                d_beside=float(np.linalg.norm(rest)),
                shares=shares if name in outside.KINDS else {},
            )
        )
    return tuple(out)


def _lag_columns(c: Campaign, acc: Accelerometer) -> Floats:
    return np.column_stack([acc.lagged_ug(c, library.inner_x(c, s)) for s in LAGS_S])


def _shares(
    final: Floats, rivals: Floats, widths: list[tuple[str, Floats]]
) -> dict[str, float]:
    """Share of the first effect's square that each library name alone can explain."""
    target, shares, at = final[:, [0]], dict.fromkeys(library.NAMES, 0.0), 0
    total = float(np.sum(target**2))
    for name, part in widths:
        left = project_out(target, rivals[:, at : at + part.shape[1]])
        at += part.shape[1]
        shares[name] = max(shares[name], 1 - float(np.sum(left**2)) / total)
    return shares


def _decidable(h: Hidden) -> bool:
    if h.d_beside < LEAST_BESIDE * h.d:
        return False
    if not h.outside:
        return True
    most = max(h.shares.values())
    return most < MOST_SHARE and h.d * np.sqrt(1 - most) > LEAST_BEYOND
