"""What a store's URL may be, what messages show of it, and what is refused as a store."""

import shutil
import sqlite3

import pytest

from errormodel.errors import StoreError
from thermo.store.database import display_url, driver_message, parse_store_url, session_engine
from thermo.store.files import open_existing_store
from thermo.store.records import NewTest
from thermo.store.spool.log import digest
from thermo.store.store import open_store

SECRET = "hush77"


URLS = [
    "postgresql://u:{}@127.0.0.1:1/x",
    "postgres://u:{}@127.0.0.1:1/x",
    "postgresql+psycopg://u:{}@127.0.0.1:1/x",
    "postgresql://u:{}%2540@127.0.0.1:1/x",
    "postgresql://u:{}/y@127.0.0.1:1/x",
    "postgresql://u:a@{}@127.0.0.1:1/x",
    "postgresql://u:a#{}@127.0.0.1:1/x",
    "postgresql://u@127.0.0.1:1/x?password={}",
    "postgresql://u@127.0.0.1:1/x?password=a&password={}",
    "postgresql://u@127.0.0.1:1/x?sslpassword={}",
    "postgresql://u@127.0.0.1:1/x?passfile=/{}",
    "postgresql://u@127.0.0.1:1/x?sslkey=/{}",
    "postgresql://u@127.0.0.1:1/x?options=-c%20a.b={}",
    "postgresql://u@127.0.0.1:1/x?keepalives={}",
    "postgresql://u@127.0.0.1:1/x?passwrd={}",
    "postgresql://u@127.0.0.1:{}/x",
    "postgresql:u:{}@h/x",
    "postgresql:/u:{}@h/x",
    "postgresql:////u:{}@h/x",
    "host=127.0.0.1 password={}",
    "host=127.0.0.1 password = {}",
    "u:{}@127.0.0.1/x",
    "mysql://u:{}@h/x",
    "sqlite://u:{}@h/x",
]


@pytest.mark.parametrize("url", URLS)
def test_no_message_holds_the_password_in_whatever_form_it_was_given(url):
    with pytest.raises(StoreError) as caught:
        open_store(url.format(SECRET))
    assert SECRET not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_a_driver_repeats_of_a_url_is_masked():
    parse_store_url(f"postgresql://u:{SECRET}@h/x?options=-cx.y%3D{SECRET}2")
    told = ValueError(f'invalid "{SECRET}" in "user=u password={SECRET} options=-cx.y={SECRET}2"')
    assert driver_message(told) == 'invalid "***" in "user=u password=*** options=***"'


def test_the_name_of_a_spool_does_not_change_with_the_password():
    urls = [f"postgresql://u{p}@h/x{q}" for p, q in ((":a", ""), ("", ""), ("", "?password=b"))]
    assert len({digest(parse_store_url(url)) for url in urls}) == 1
    assert digest(parse_store_url("postgresql://u@h/y")) != digest(parse_store_url(urls[0]))
    assert display_url("night.sqlite") == "night.sqlite"


def test_a_server_is_given_time_limits(postgres_server):
    url = parse_store_url(postgres_server)
    with session_engine(url).connect() as connection:
        found = {
            name: connection.exec_driver_sql(f"SHOW {name}").scalar_one()
            for name in ("statement_timeout", "lock_timeout", "synchronous_commit",
                         "idle_in_transaction_session_timeout")
        }  # fmt: skip
        raw = connection.connection.driver_connection
        assert raw is not None
        parameters = raw.info.get_parameters()
    assert found == {
        "statement_timeout": "5min",
        "lock_timeout": "10s",
        "synchronous_commit": "on",
        "idle_in_transaction_session_timeout": "1min",
    }
    assert parameters["tcp_user_timeout"] == "20000"
    assert parameters["connect_timeout"] == "10"
    assert parameters["keepalives_idle"] == "10"
    own = parse_store_url(f"{postgres_server}?connect_timeout=3")
    with session_engine(own).connect() as connection:
        raw = connection.connection.driver_connection
        assert raw is not None
        assert raw.info.get_parameters()["connect_timeout"] == "3"


# ---- files that are no store, or only a part of one ----


def test_a_file_that_lost_its_write_ahead_log_is_no_empty_store(tmp_path):
    file = tmp_path / "night.sqlite"
    with sqlite3.connect(file, isolation_level=None) as db:
        db.execute("PRAGMA journal_mode=WAL")  # a header, and everything else in the -wal
    db.close()
    before = file.read_bytes()
    assert len(before) == 4096
    for opens in (open_store, open_existing_store):
        with pytest.raises(
            StoreError, match=r"has a header and no tables: its -wal file is missing"
        ):
            opens(file)
    assert file.read_bytes() == before


def test_an_empty_file_becomes_a_store_and_is_not_read_as_one(tmp_path):
    file = tmp_path / "night.sqlite"
    file.touch()
    with pytest.raises(StoreError, match="an empty file, expected a store"):
        open_existing_store(file)
    assert file.read_bytes() == b""
    open_store(file).close()
    open_existing_store(file).close()


def test_the_tables_of_a_new_store_are_in_the_file_itself(tmp_path):
    file, alone = tmp_path / "night.sqlite", tmp_path / "alone.sqlite"
    with open_store(file):
        shutil.copy(file, alone)  # while it is open: what is not in the file is in its -wal
    with open_existing_store(alone) as store:
        assert store.tests() == ()


def test_a_status_left_running_is_mended_and_told(tmp_path, caplog):
    file = tmp_path / "night.sqlite"
    store = open_store(file)
    test_id = store.begin_test(NewTest("night", "", "{}"))
    store.begin_run(test_id, 1, "2026-11-22T22:15:00+00:00")
    with open_existing_store(file) as other:  # its process lives
        assert other.test(test_id).status == "running"
    store.close()  # as after kill −9: the claim is free
    with open_existing_store(file) as other:
        test = other.test(test_id)
        assert (test.status, test.runs[0].status) == ("interrupted", "interrupted")
        assert "ended without storing the outcome" in test.outcome
    assert "its status is now interrupted" in caplog.text
