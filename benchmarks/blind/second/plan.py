"""Which set a seed is: of 31 seeds in a row 6 hide nothing, 12 one effect, 3 two, 10 outside."""

from benchmarks.blind.second.library import NAMES
from benchmarks.blind.second.outside import KINDS

CYCLE = 31
GROUPS = ("nulls", "library", "pairs", "outside")
ASKED = {
    "all": GROUPS,
    "nulls": ("nulls",),
    "library": ("library", "pairs"),
    "outside": ("outside",),
}


def group_of(seed: int) -> str:
    """Return the group of a seed."""
    place = seed % CYCLE
    return GROUPS[0 if place < 6 else 1 if place < 18 else 2 if place < 21 else 3]


def name_of(seed: int) -> tuple[str, bool]:
    """Return the effect that a seed hides first, and whether a library effect stands beside it."""
    turn, place = divmod(seed, CYCLE)
    group = group_of(seed)
    if group == "library":
        return NAMES[(12 * turn + place - 6) % len(NAMES)], False
    if group == "pairs":
        return NAMES[(3 * turn + place - 18) % len(NAMES)], True
    if group == "outside":
        number = 10 * turn + place - 21
        kinds = list(KINDS)
        # 21 kinds: the half that has company changes with every round of them
        return kinds[number % len(kinds)], (number + number // len(kinds)) % 2 == 0
    return "", False


def seeds_of(sets: str, first: int, end: int) -> list[int]:
    """Return the seeds of a kind of sets within first:end."""
    return [seed for seed in range(first, end) if group_of(seed) in ASKED[sets]]
