import re
import struct
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from accelbench.commands.fit.figures import pictures
from accelbench.commands.fit.page import ReportExtras, ReportTable, render_report, write_report
from accelbench.shell.plotting import Picture, cell_means, file_part, thinned
from tests.accelbench.conftest import table
from thermo.fitting.fit import TermsFile, fit_runs
from thermo.recording.files import make_runs

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Checks that tags nest, and keeps what is referred to and what is said."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        names = ("src", "href", "data", "srcset")
        found = [v or "" for name, v in attrs if name in names]
        self.links += [link for link in found if not link.startswith("#")]  # within the page

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def png_size(data: bytes) -> tuple[int, int]:
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", data[16:24])


def small(frame: pd.DataFrame):
    return make_runs(frame, output_unit="mA", gravity_m_s2=9.80665, nominal_scale=1.3)


def test_the_page_holds_everything_and_refers_to_nothing(fitted):
    page = Page((fitted.report / "report.html").read_text(encoding="utf-8"))
    assert len(page.links) == 7
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not re.search(r"https?://|@import|url\(", page.text)
    for text in (
        "Result",
        "Coefficients",
        "Sources",
        "Conventions",
        "K1(x)",
        "k0_t1",
        "±",
        "Python",
    ):
        assert text in page.text
    assert fitted.document["model_id"] in page.text
    for digest in fitted.document["accelerometers"][0]["source_runs"].values():
        assert digest in page.text
    assert "thermal-history effect is left" in page.text


def test_the_figures_stand_beside_it(fitted):
    names = {p.name for p in fitted.report.iterdir()}
    assert names == {
        "report.html", "temperature_and_positions.png", "coefficients.png", "orders.png",
        "error_A.png", "residual_A.png", "error_B.png", "residual_B.png",
    }  # fmt: skip
    for name in names - {"report.html"}:
        width, height = png_size((fitted.report / name).read_bytes())
        assert 300 < width < 2000
        assert 200 < height < 3000


def test_odd_names_units_and_shapes_are_drawn(tmp_path):
    """A formula, markup, a foreign script, one direction only, no positions, given terms."""
    name = "<b>$x_1$ 加速度 & \\frac"
    frame = table("run $1$ <i>", name, n=120).iloc[:50].drop(columns="position_deg")
    frame["output"] = 1.3 + 1e-4 * np.sin(frame["temp_c"])
    runs = small(frame)
    fits = fit_runs(runs, terms=TermsFile(terms=("k0", "k0_t1")))
    extras = ReportExtras(
        tables=(ReportTable(title="More <x>", columns=("a",), rows=(("<script>",),)),),
        notes=("note & more",),
    )
    path = write_report(fits, runs, tmp_path / "new/folder", title="<title>", extras=extras)
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert "<script>" not in text
    assert name in page.text
    assert "More <x>" in page.text
    assert len(page.links) == 4  # no orders: the terms were given


def test_many_accelerometers_are_told_and_not_all_drawn(monkeypatch):
    monkeypatch.setattr("accelbench.commands.fit.figures.MAX_ACCELEROMETERS", 1)
    monkeypatch.setattr("accelbench.commands.fit.page.MAX_ACCELEROMETERS", 1)
    frame = pd.concat([table(r, f"S{k}", n=60, seed=k) for r in ("r1", "r2") for k in range(3)])
    runs = small(frame)
    terms = TermsFile(terms=("k1", "k0", "k0_t1", "k1_t1"))
    files = render_report(fit_runs(runs, terms=terms, holdout=("r2",)), runs, title="many")
    assert set(files) == {
        "report.html", "temperature_and_positions.png", "error_S0.png", "residual_S0.png",
        "coefficients.png",
    }  # fmt: skip
    page = Page(files["report.html"].decode())
    assert "2 further accelerometers" in page.text
    assert "S2" in page.text
    assert "held out" in page.text


def test_two_serials_of_one_file_name_do_not_collide(monkeypatch):
    runs = small(pd.concat([table("r", s, n=60, seed=k) for k, s in enumerate(("A/1", "A:1"))]))
    fits = fit_runs(runs, terms=TermsFile(terms=("k1", "k0")))
    for name in ("draw_runs", "draw_coefficients"):
        monkeypatch.setattr(
            f"accelbench.commands.fit.figures.{name}",
            lambda _: Picture(name="x", caption="", png=b""),
        )
    for name in ("draw_errors", "draw_residuals"):
        monkeypatch.setattr(
            f"accelbench.commands.fit.figures.{name}",
            lambda _, n: Picture(name=n, caption="", png=b""),
        )
    names = [p.name for p in pictures(fits, runs)][1:-1]
    assert len(set(names)) == len(names)
    assert all("/" not in n and ":" not in n for n in names)


@pytest.mark.parametrize("n", [0, 1, 5999, 6001, 1_000_000])
def test_thinning_keeps_order_and_spread(n):
    chosen = thinned(n)
    assert len(chosen) == min(n, 6000)
    assert np.all(np.diff(chosen) > 0)
    if n:
        assert chosen.min() < max(1, n / 1000)
        assert chosen.max() > n - 1 - n / 1000


def test_cells_without_readings_are_gaps():
    centre, mean = cell_means(np.array([0.1, 0.2, 5.1]), np.array([1.0, 3.0, 7.0]), 1.0)
    np.testing.assert_allclose(centre, [0.5, 1.5, 2.5, 3.5, 4.5, 5.5])
    np.testing.assert_array_equal(mean, [2.0, np.nan, np.nan, np.nan, np.nan, 7.0])


def test_file_names_are_plain():
    assert file_part("QA-003") == "QA-003"
    assert file_part("../a b/é") == ".._a_b__"
