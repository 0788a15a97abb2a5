"""One file opened twice in a process: neither opening may cost the other its locks."""

import subprocess
import sys

from tests.thermo.store.short_test import begun, scan
from thermo.store.sqlite import companion_path, inode
from thermo.store.store import open_store

# another process that opens the store and closes it again, as `accelbench runs` does
OPEN_AND_CLOSE = (
    "import sys; from thermo.store.store import open_store; s = open_store(sys.argv[1]); "
    "s.tests(); s.close()"
)


def test_a_second_opening_in_the_process_leaves_the_first_its_locks(tmp_path):
    path = tmp_path / "store.sqlite"
    with open_store(path) as store:
        test_id = begun(store)
        log = inode(companion_path(path, "-wal"))
        assert log is not None
        open_store(path, existing=True).close()
        subprocess.run([sys.executable, "-c", OPEN_AND_CLOSE, str(path)], check=True, timeout=120)
        # without its locks the first is not seen, and the other takes its log away as the last one
        assert inode(companion_path(path, "-wal")) == log
        store.append(test_id, 1, scan(0))
    with open_store(path) as store:
        assert len(store.readings(test_id)) == 3
