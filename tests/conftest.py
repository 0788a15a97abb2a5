"""What holds for every test: nothing is written into the user's own folders."""

import signal
import threading
from collections.abc import Iterator

import pytest

# A shell that starts the tests in the background has them, and all that they start, ignore SIGINT.
if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def own_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep spools and notes on chambers out of the user's folders; subprocesses inherit it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield
