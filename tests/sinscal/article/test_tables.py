"""The article's tables: the stored reading is the best of the scan and meets the acceptance."""

from dataclasses import replace

import numpy as np
import pytest

from sinscal.article.tables import BEST, LITERAL, ArticleAnalysis, article_readings, best_reading


@pytest.fixture(scope="module")
def analysis() -> ArticleAnalysis:
    return ArticleAnalysis()


def test_the_best_reading_gives_the_published_tables(analysis: ArticleAnalysis) -> None:
    """The issue's acceptance: all within 0.6–1.7 and at least nine within 0.8–1.25."""
    ratios = analysis.tables(BEST).ratios
    assert ratios.size == 12
    assert np.all((ratios > 0.6) & (ratios < 1.7)), ratios
    assert np.sum((ratios > 0.8) & (ratios < 1.25)) >= 9, ratios


def test_the_letter_does_not(analysis: ArticleAnalysis) -> None:
    """With the stated noise what the accelerometers drive comes out about four times too small."""
    tables = analysis.tables(LITERAL)
    assert tables.table1["accel_scale"].ratio == pytest.approx(0.25, abs=0.01)
    assert tables.rms_log > 1.0


def test_any_one_choice_changed_is_worse(analysis: ArticleAnalysis) -> None:
    best = analysis.tables(BEST).rms_log
    others = [
        replace(BEST, accel_factor=1.0),
        replace(BEST, gyro_factor=1.0),
        replace(BEST, carried=True),
        replace(BEST, base="same"),
        replace(BEST, base="free"),
        replace(BEST, remounted=True),
    ]
    assert set(others) <= set(article_readings())
    assert min(analysis.tables(reading).rms_log for reading in others) > best


@pytest.mark.slow
def test_the_stored_reading_is_the_best_of_the_scan(analysis: ArticleAnalysis) -> None:
    # the published figures have two digits: readings alike to a thousandth are one (how well the
    # azimuth is known changes the rms by 2e-4)
    assert best_reading(analysis)[1] > 0.999 * analysis.tables(BEST).rms_log
