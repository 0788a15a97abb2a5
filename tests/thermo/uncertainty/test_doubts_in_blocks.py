"""A long recording's fit, gone through in blocks, says what it says of the readings as a whole."""

import pytest
from numpy.testing import assert_allclose

from errormodel import blocks, columns
from tests.thermo.uncertainty.test_by_position import SMALL, changed
from thermo.fitting.fit import TermsFile, fit_runs


def test_sigmas_and_doubts_do_not_hang_on_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = changed(SMALL, 3, "asymmetry")
    head = TermsFile(head_arcsec=4.0)
    (whole,), (headed,) = fit_runs(runs), fit_runs(runs, terms=head)
    monkeypatch.setattr(blocks, "BLOCK", 500)
    monkeypatch.setattr(columns, "KEPT", 0)
    (parted,), (parted_headed,) = fit_runs(runs), fit_runs(runs, terms=head)
    # sums of some thousand readings in another order, and columns nearly alike: far below a sigma
    close = {"rtol": 1e-6}
    assert parted.fit.names == whole.fit.names
    assert_allclose(parted.fit.sigmas, whole.fit.sigmas, **close)
    assert_allclose(parted_headed.fit.sigmas, headed.fit.sigmas, **close)
    assert len(whole.doubts.unseen) > 0
    for one, other in zip(parted.doubts.unseen, whole.doubts.unseen, strict=True):
        assert one.moves.keys() == other.moves.keys()
        assert_allclose(list(one.moves.values()), list(other.moves.values()), rtol=1e-5)
    told, expected = parted.doubts.by_position, whole.doubts.by_position
    assert told is not None
    assert expected is not None
    assert told.alone == expected.alone
    assert_allclose(told.sigmas, expected.sigmas, **close)
    assert_allclose([ug for _, ug in told.positions], [ug for _, ug in expected.positions], **close)
    assert [one.name for one in parted.doubts.left_out] == [
        one.name for one in whole.doubts.left_out
    ]
