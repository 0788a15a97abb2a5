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
class Drawn:
    """An effect before its size is known: its column for a size of one."""

    name: str
    unit: Floats
    parameters: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A campaign, the accelerometer in it, and how noisy it is."""

    campaign: Campaign
    accelerometer: Accelerometer
    noise: Noise
    kept: NDArray[np.bool_]  # readings that are good and written; the unseen run is none of them

    def strengths(self, columns: Floats) -> Floats:
        """Return columns whitened, less what the present model takes, shape (n kept, p)."""
        c, acc, kept = self.campaign, self.accelerometer, self.kept
        sigma = white_sigma(self.noise, acc.slope_ug_per_c(c))[kept]
        model = acc.columns(c)[kept]
        both = np.hstack([model, columns[kept]])
        white = whiten(self.noise, sigma, c["elapsed_h"][kept], c.run[kept], both)
        return project_out(white[:, model.shape[1] :], white[:, : model.shape[1]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth(Scene):
    """A set before its noise is drawn."""

    seed: int
    group: str
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
    c = make_campaign(draw_protocol(rng, **_fixed(names, rng)), rng)
    acc, noise = draw_accelerometer(rng, c, names), draw_noise(rng)
    scene = Scene(campaign=c, accelerometer=acc, noise=noise, kept=_kept(c, noise, rng))
    drawn = [_draw(name, c, acc, rng) for name in names]
    least = 20 if group == "outside" else 5
    targets = [float(np.exp(rng.uniform(np.log(least), np.log(200)))) for _ in names]
    hidden = _sized(scene, drawn, targets) if names else ()
    if hidden is None or not all(_decidable(h) for h in hidden):
        return None
    return Truth(
        seed=seed,
        group=group,
        campaign=c,
        accelerometer=acc,
        noise=noise,
        kept=scene.kept,
        hidden=hidden,
    )


def _fixed(names: tuple[str, ...], rng: np.random.Generator) -> dict[str, object]:
    """Return what of the protocol the effects ask for; an outside effect's needs prevail."""
    needs: dict[str, tuple[object, ...]] = {}
    for name in sorted(names, key=outside.KINDS.__contains__):
        kind = outside.KINDS.get(name)
        needs.update(kind.needs if kind else library.NEEDS.get(name, {}))
    return {name: values[int(rng.integers(len(values)))] for name, values in needs.items()}


def _names(seed: int, rng: np.random.Generator) -> tuple[str, ...]:
    first, beside = name_of(seed)
    if not beside:
        return (first,) if first else ()
    others = [name for name in library.NAMES if name != first]
    return first, str(rng.choice(others))


def _draw(name: str, c: Campaign, acc: Accelerometer, rng: np.random.Generator) -> Drawn:
    kind = outside.KINDS.get(name)
    unit, parameters = kind.make(c, rng) if kind else library.draw(name, c, acc, rng)
    return Drawn(name=name, unit=unit, parameters=parameters)


def _kept(c: Campaign, noise: Noise, rng: np.random.Generator) -> NDArray[np.bool_]:
    kept = (c["moving"] == 0) & ~c.unseen
    for _ in range(noise.gaps):
        run = c.run == rng.integers(c.protocol.runs)
        start = rng.uniform(0, c["t_s"][run][-1])
        end = start + rng.uniform(600, 2400)
        kept &= ~(run & (c["t_s"] > start) & (c["t_s"] < end))
    return kept


def _sized(scene: Scene, drawn: list[Drawn], targets: list[float]) -> tuple[Hidden, ...] | None:
    """Give each effect the size of its strength; None where that would be too large."""
    c, acc = scene.campaign, scene.accelerometer
    strange = any(d.name in outside.KINDS for d in drawn)
    rivals = [
        (name, part)
        for name, parts in (library.rivals(c, acc) if strange else {}).items()
        for part in parts
    ]
    trial = [_lag_columns(c, acc) if d.name == "thermal_lag" else d.unit[:, None] for d in drawn]
    white = scene.strengths(np.hstack([*trial, *(part for _, part in rivals)]))
    sizes, at = [], 0
    for one, column, target in zip(drawn, trial, targets, strict=True):
        lengths = np.linalg.norm(white[:, at : at + column.shape[1]], axis=0)
        sizes.append(_size(one, lengths, target))
        at += column.shape[1]
    if 0.0 in sizes:
        return None
    effects = np.column_stack([_column(scene, d, s) for d, s in zip(drawn, sizes, strict=True)])
    if np.sqrt(np.mean(effects[scene.kept] ** 2, axis=0)).max() > MOST_UG:
        return None
    final = scene.strengths(effects)
    shares = _shares(final, white[:, at:], rivals) if strange else {}
    hidden = []
    for k, one in enumerate(drawn):
        others = np.delete(final, k, axis=1)
        rest = project_out(final[:, [k]], others) if others.shape[1] else final[:, [k]]
        hidden.append(
            Hidden(
                name=one.name,
                outside=one.name in outside.KINDS,
                column=effects[:, k],
                size=sizes[k],
                parameters={"tau_s": sizes[k]} if one.name == "thermal_lag" else one.parameters,
                d=float(np.linalg.norm(final[:, k])),
                d_beside=float(np.linalg.norm(rest)),
                shares=shares if one.name in outside.KINDS else {},
            )
        )
    return tuple(hidden)


def _size(one: Drawn, lengths: Floats, target: float) -> float:
    """Return the size of a strength, 0 where there is none; of a lag its time constant."""
    if one.name == "thermal_lag":
        if not lengths[0] < target < lengths[-1]:
            return 0.0
        return float(np.exp(np.interp(np.log(target), np.log(lengths), np.log(LAGS_S))))
    if lengths[0] < 1e-9 * max(float(np.linalg.norm(one.unit)), 1e-300):
        return 0.0
    return float(target / lengths[0])


def _column(scene: Scene, one: Drawn, size: float) -> Floats:
    if one.name == "thermal_lag":
        c = scene.campaign
        return scene.accelerometer.lagged_ug(c, library.inner_x(c, size))
    return size * one.unit


def _lag_columns(c: Campaign, acc: Accelerometer) -> Floats:
    return np.column_stack([acc.lagged_ug(c, library.inner_x(c, s)) for s in LAGS_S])


def _shares(final: Floats, rivals: Floats, widths: list[tuple[str, Floats]]) -> dict[str, float]:
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
