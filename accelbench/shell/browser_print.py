"""A report as PDF: the browser's own print of the same page."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from errormodel.errors import WorkbenchError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PRINT_S = 180.0  # a report of 50 pictures takes some 10 s; beyond it the browser stands still
OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # the page asks for nothing, and neither may this
    "--no-pdf-header-footer",  # the page has its own, with page numbers
)


def find_browser() -> str | None:
    """Return the path of Chromium or Chrome; None if there is none."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def print_pdf(html: bytes) -> bytes:
    """Print a page that refers to nothing outside itself.

    Parameters
    ----------
    html : bytes

    Returns
    -------
    bytes
        The PDF.

    Raises
    ------
    WorkbenchError
        If there is no browser, or it made no PDF.
    """
    browser = find_browser()
    if browser is None:
        raise WorkbenchError("a report in PDF needs Chromium; none of its names is in the PATH")
    # its profile may still be written to when it has ended
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        page, made = folder / "report.html", folder / "report.pdf"
        page.write_bytes(html)
        # Chromium's own sandbox refuses to start for root, as in containers
        root = ("--no-sandbox",) if os.geteuid() == 0 else ()
        own = (f"--user-data-dir={folder / 'profile'}", f"--print-to-pdf={made}")
        command = [browser, *OPTIONS, *root, *own, page.as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, timeout=PRINT_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as err:
            raise WorkbenchError(f"{browser} did not print the report: {err}") from None
        if not made.is_file():
            last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
            raise WorkbenchError(f"{browser} did not print the report: {last or 'no reason given'}")
        return made.read_bytes()
