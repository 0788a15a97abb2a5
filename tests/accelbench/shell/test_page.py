from accelbench.shell.page import Banner, Page, ReportTable, Section, render_page
from accelbench.shell.plotting import Picture


def test_verdicts_come_first_and_every_section_is_in_the_contents():
    page = Page(
        title="Model of QA-001",
        about="model m1",
        verdicts=(Banner(text="passed <x>", state="good"), Banner(text="left out", state="open")),
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
        '<p class="verdict good">passed &lt;x&gt;', '<p class="verdict open">left out',
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
