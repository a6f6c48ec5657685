"""Locks between processes and threads."""

import threading

import pytest

from nlpgrasp.common import files as locks
from nlpgrasp.errors import InputError


def test_one_at_a_time(tmp_path):
    """Four threads count to 200 in a file: without the lock they would overwrite each other's sums."""
    count = tmp_path / "count"
    count.write_text("0")

    def add():
        for _ in range(50):
            with locks.hold_lock(tmp_path / ".lock"):
                number = int(count.read_text())
                count.write_text(str(number + 1))

    threads = [threading.Thread(target=add) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert count.read_text() == "200"


def test_it_is_given_up_and_let_go(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "WAIT", 0.02)
    refused = pytest.raises(InputError, match="in use by another process for 0 s")
    with locks.hold_lock(tmp_path / ".lock"), refused, locks.hold_lock(tmp_path / ".lock"):
        pass
    with locks.hold_lock(tmp_path / ".lock"):
        pass
    with (
        pytest.raises(InputError, match=r"none: got No such file or directory"),
        locks.hold_lock(tmp_path / "none" / "a"),
    ):
        pass
