import re

import numpy as np
import pytest

from accelbench.shell.page import (
    STATE_SYMBOLS,
    STATE_WORDS,
    Banner,
    Page,
    ReportTable,
    Section,
    correlation_tables,
    css_string,
    render_page,
)
from accelbench.shell.plotting import Picture


def test_verdicts_come_first_and_every_section_is_in_the_contents():
    page = Page(
        title="Model of QA-001",
        about="model m1",
        verdicts=(
            Banner(text="passed <x>", state="good", todo="use it"),
            Banner(text="left out", state="open"),
        ),
        sections=(
            Section(title="One", lines=("a line",), pictures=(
                Picture(name="p.png", caption="a picture", png=b"png"),)),
            Section(title="part", level=3, points=("a point",)),
            Section(title="Two", table=ReportTable(columns=("a", "b"), rows=(("x", "1"),))),
            Section(title="Three", after=("the end",)),
        ),
    )  # fmt: skip
    files = render_page(page, "report.html")
    text = files["report.html"].decode()
    assert files["p.png"] == b"png"
    assert text.startswith("<!DOCTYPE html>")
    places = [text.index(part) for part in (
        'In order</span> passed &lt;x&gt;', '<b>What to do:</b> use it',
        'Attention</span> left out',
        '<a href="#s1">One', '<a href="#s3">Two', 'id="s1">One', 'id="s2">part', "<td", "the end",
    )]  # fmt: skip
    assert places == sorted(places)
    assert '<a href="#s2">' not in text  # a part of a section
    assert "<title>Model of QA-001</title>" in text


def test_on_paper_no_table_scrolls():
    page = Page(title="t", sections=(Section(title="One"),))
    text = render_page(page, "report.html")["report.html"].decode()
    _, _, print_rules = text.partition("@media print")
    assert ".scroll { overflow: visible;" in print_rules
    assert "white-space: normal" in print_rules


def text_of(page: Page) -> str:
    return render_page(page, "report.html")["report.html"].decode()


def test_every_state_has_a_symbol_and_a_word_of_its_own():
    assert len(set(STATE_SYMBOLS.values())) == len(set(STATE_WORDS.values())) == 4
    page = Page(title="t", verdicts=(Banner(text="x", state="bad"),), sections=())
    assert "✘</span> Not in order</span> x" in text_of(page)


def test_the_header_says_what_was_not_given_and_when_it_was_measured():
    told = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", text_of(Page(title="t", sections=())))
    assert dict(told)["Laboratory"] == dict(told)["Operator"] == "not given"
    assert "Measured" not in dict(told)  # of an analysis there is no day of measuring
    told = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>",
                      text_of(Page(title="t", sections=(), measured="2026-11-30")))  # fmt: skip
    assert dict(told)["Measured"] == "2026-11-30"


@pytest.mark.parametrize(
    "text", ['a"; } body { display: none', "</style><b>", "back\\slash", "Ω\n"]
)
def test_a_title_cannot_leave_its_string_in_the_style_sheet(text):
    made = str(css_string(text))
    assert not set(made) & set('";{}<>\n')
    # read as a browser reads it: a backslash, hexadecimal digits, one space
    read = re.sub(r"\\([0-9a-f]+) ", lambda m: chr(int(m[1], 16)), made)
    assert read == text


def test_of_many_correlations_the_ten_largest_are_shown_and_the_others_folded():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(40, 12))
    matrix = np.corrcoef(columns, rowvar=False)
    names = [f"p{k}" for k in range(12)]
    first, rest = correlation_tables(names, matrix)
    sizes = [abs(float(r[2].replace("−", "-"))) for r in (*first.rows, *rest.rows)]
    assert len(first.rows) == 10
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) == int((np.abs(matrix[np.triu_indices(12, 1)]) >= 0.05).sum())
    text = text_of(Page(title="t", sections=(Section(tables=(first, rest)),)))
    before, _, folded = text.partition("<details>")
    assert "".join(f'<td class="text">{first.rows[0][0]}') in before
    assert f"The other {len(rest.rows)} correlations" in folded
    assert correlation_tables(["a"], np.eye(1)) == ()
    assert correlation_tables(["a", "b"], np.eye(2)) == ()


def test_a_table_of_many_columns_has_a_sheet_laid_across():
    wide = ReportTable(columns=tuple("abcdefghij"), rows=())
    text = text_of(Page(title="t", sections=(Section(tables=(wide,)),)))
    assert 'class="scroll wide"' in text
    assert 'class="scroll wide"' not in text_of(
        Page(title="t", sections=(Section(table=ReportTable(columns=("a", "b"), rows=())),))
    )
