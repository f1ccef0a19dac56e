"""The journal: what is written is there again, whatever moment a kill chose."""

import pytest

from co_sim.campaign import Journal
from co_sim.campaign.journal import Entry
from co_sim.errors import InputError


def entries(n):
    return [Entry(i, "done" if i % 3 else "failed", {"y": i / 7, "name": "ü"}, "", 0.1) for i in range(n)]


@pytest.fixture
def written(tmp_path):
    with Journal(tmp_path, "key", {"title": "t"}) as journal:
        for entry in entries(5):
            journal.add(entry)
    return journal.path


def test_what_was_written_is_there_again(tmp_path, written):
    with Journal(tmp_path, "key") as again:
        assert list(again.entries.values()) == entries(5)


def test_cut_at_any_byte_only_the_last_line_is_lost(tmp_path, written):
    text = written.read_bytes()
    ends = [i + 1 for i, byte in enumerate(text) if byte == ord("\n")]
    for cut in range(ends[0], len(text) + 1, 7):
        written.write_bytes(text[:cut])
        with Journal(tmp_path, "key") as journal:
            whole = sum(end <= cut for end in ends) - 1
            assert list(journal.entries.values()) == entries(whole)
            journal.add(Entry(99, "done"))
        with Journal(tmp_path, "key") as journal:
            assert list(journal.entries) == [*range(whole), 99]


def test_a_later_entry_replaces_an_earlier_one(tmp_path, written):
    with Journal(tmp_path, "key") as journal:
        journal.add(Entry(0, "done", {"y": 1.0}))
    with Journal(tmp_path, "key") as journal:
        assert (journal.entries[0].record, len(journal.entries)) == ({"y": 1.0}, 5)


def test_another_study_is_refused_and_nothing_changed(tmp_path, written):
    before = written.read_bytes()
    with pytest.raises(InputError, match="another study"):
        Journal(tmp_path, "other key")
    assert written.read_bytes() == before


def test_two_campaigns_in_one_folder_are_refused(tmp_path, written):
    with Journal(tmp_path, "key"), pytest.raises(InputError, match="another campaign is running"):
        Journal(tmp_path, "key")


@pytest.mark.parametrize("line", [b"nonsense\n", b'{"case": 1}\n', b"[]\n"])
def test_foreign_lines_are_told(tmp_path, written, line):
    with written.open("ab") as file:
        file.write(line)
    with pytest.raises(InputError, match="line 7"):
        Journal(tmp_path, "key")


def test_values_that_json_has_no_place_for_are_refused(tmp_path):
    with Journal(tmp_path, "key") as journal:
        size = journal.path.stat().st_size
        with pytest.raises(ValueError, match="Out of range"):
            journal.add(Entry(0, "done", {"y": float("nan")}))
        assert journal.path.stat().st_size == size
