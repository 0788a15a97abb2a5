"""The PDF of a report, checked by its text as pdftotext reads it."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from accelbench.shell import outputs
from accelbench.shell.browser_print import find_browser, print_pdf
from accelbench.shell.page import Banner, Page, ReportTable, Section, render_page
from errormodel.errors import WorkbenchError

COLUMNS = tuple(f"column{k}" for k in range(14))
REQUIRED = os.environ.get("ACCELBENCH_REQUIRE_CHROMIUM") == "1"
needs_chromium = pytest.mark.skipif(
    not REQUIRED and (find_browser() is None or shutil.which("pdftotext") is None),
    reason="no Chromium or no pdftotext here: install chromium and poppler-utils",
)


def text_of(pdf: Path) -> list[str]:
    """Return the text of each page."""
    done = subprocess.run(["pdftotext", "-layout", pdf, "-"], capture_output=True, check=True)
    return done.stdout.decode().rstrip("\f").split("\f")


@needs_chromium
def test_a_printed_report_has_page_numbers_and_every_column(tmp_path):
    wide = ReportTable(
        columns=COLUMNS,
        rows=tuple(tuple(f"{r:02d}{k:02d}.{k}5 ± 0.25" for k in range(14)) for r in range(60)),
    )
    page = Page(
        title='Model of QA "001"',
        verdicts=(Banner(text="no structure", state="good", todo="Use it."),),
        sections=(Section(title="One", lines=("a line",)), Section(title="Wide", table=wide)),
    )
    pdf = tmp_path / "report.pdf"
    pdf.write_bytes(print_pdf(render_page(page, "report.html")["report.html"]))
    sheets = text_of(pdf)
    assert len(sheets) >= 3
    for number, sheet in enumerate(sheets, 1):
        assert f"page {number} of {len(sheets)}" in sheet
        assert 'Model of QA "001"' in sheet
    whole = " ".join(sheets)
    for told in ("In order", "no structure", "What to do: Use it.", "not given", *COLUMNS):
        assert told in whole
    for row in range(60):
        assert all(f"{row:02d}{k:02d}.{k}5" in whole for k in range(14)), row


def test_without_a_browser_one_line_says_what_is_missing(monkeypatch, refused, tmp_path):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(WorkbenchError, match="needs Chromium"):
        print_pdf(b"")
    assert "printed by Chromium, which is not installed" in refused(
        "rig", "covariance", "--report", tmp_path / "r.pdf"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_browser_that_prints_nothing_is_told(monkeypatch, tmp_path):
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\necho no display >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(WorkbenchError, match="did not print the report"):
        print_pdf(b"")


def test_a_report_in_pdf_is_the_print_of_the_page_alone(monkeypatch, tmp_path):
    monkeypatch.setattr(outputs, "print_pdf", lambda html: b"%PDF of " + html)
    results = outputs.Results({}, [])
    place = tmp_path / "r.PDF"
    results.add_report(place, lambda: {"report.html": b"page", "a.png": b"picture"})
    assert results.files == [(place, b"%PDF of page")]
    assert results.document["report"] == str(place)
