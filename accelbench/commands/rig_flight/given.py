"""Calibrations as `rig flight` takes them: from files, or the article's."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from errormodel.errors import InputError
from sinscal.article.published import published_calibrations
from sinscal.model.residual_errors import Calibration

COARSE, PRECISE = "coarse", "precise"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GivenCalibration:
    """A calibration as it was read.

    Attributes
    ----------
    name : str
    calibration : Calibration
    before : Calibration, optional
        What was known without it: the sigmas beforehand, where the file has them.
    is_article : bool
        Whether it is of the article's programme, and its published figures belong beside it.
    """

    name: str
    calibration: Calibration
    before: Calibration | None = None
    is_article: bool = False


def read_calibrations(files: Sequence[Path]) -> list[GivenCalibration]:
    """Read calibrations with their names; without files take the article's sigmas.

    A file holds `names` and `covariance`, or these under `coarse` and `precise`. A calibration is
    called by the file's `mode`, or else by the file's name.

    Raises
    ------
    InputError
        If a file is no such document, or two calibrations have one name.
    """
    if not files:
        published = zip((COARSE, PRECISE), published_calibrations(), strict=True)
        return [GivenCalibration(name=n, calibration=c, is_article=True) for n, c in published]
    found: list[GivenCalibration] = []
    for path in files:
        document = _document(path)
        parts = [name for name in (COARSE, PRECISE) if "names" in _mapping(document.get(name))]
        if parts:
            article = document.get("programme") == "article"
            found += [_given(path, n, n, _mapping(document[n]), article) for n in parts]
        else:
            name = document.get("mode")
            name = name if isinstance(name, str) else path.stem
            found.append(_given(path, name, "", document, article=False))
    names = [one.name for one in found]
    double = next((n for n in names if names.count(n) > 1), None)
    if double is not None:
        raise InputError(files[-1], "mode", f"there are two calibrations named {double!r}")
    return found


def _given(
    path: Path, name: str, place: str, part: Mapping[str, Any], article: bool
) -> GivenCalibration:
    """Read one calibration, and what the file says was known before it."""
    calibration, before = _calibration(path, place, part), None
    prior, told = _mapping(part.get("prior")), _mapping(part.get("parameters"))
    try:
        sigmas = [
            float(_mapping(prior[n])["sigma"] if n in prior else _mapping(told[n])["prior_sigma"])
            for n in cast(list[str], part["names"])
        ]
        before = Calibration.of_sensors(part["names"], np.diag(np.square(sigmas)))
    except (KeyError, TypeError, ValueError):
        pass  # another program's file may hold a covariance alone
    return GivenCalibration(name=name, calibration=calibration, before=before, is_article=article)


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as err:
        raise InputError(path, "", f"cannot be read: {err.strerror or err}") from err
    except ValueError as err:
        raise InputError(path, "", f"is not JSON: {err}") from err
    if not isinstance(document, dict):
        raise InputError(path, "", "expected an object with names and covariance")
    return cast(Mapping[str, Any], document)


def _mapping(value: object) -> Mapping[str, Any]:
    return cast(Mapping[str, Any], value) if isinstance(value, dict) else {}


def _calibration(path: Path, place: str, part: Mapping[str, Any]) -> Calibration:
    for key in ("names", "covariance"):
        if key not in part:
            where = ".".join(p for p in (place, key) if p)
            raise InputError(path, where, "is missing; expected the output of rig calibrate")
    names: Any = part["names"]
    if not isinstance(names, list) or not all(isinstance(n, str) for n in cast(list[Any], names)):
        raise InputError(path, "names", "expected a list of parameters' names")
    try:
        cov = np.array(part["covariance"], dtype=float)
        return Calibration.of_sensors(cast(list[str], names), cov)
    except (ValueError, TypeError) as err:
        raise InputError(path, place or "covariance", str(err)) from err
