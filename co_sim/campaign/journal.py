"""What a campaign has computed so far: one line of JSON for each case, safe against any kill.

A line is written whole and flushed to the disk before the next case counts. A kill in the middle of a line
leaves a torn one at the end, which is cut off when the journal is opened again; its case is computed anew.
"""

from __future__ import annotations

import fcntl
import json
import os
from dataclasses import asdict, dataclass, field
from typing import IO, TYPE_CHECKING, Any, Literal, Self

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType

__all__ = ["Entry", "Journal"]

_NAME = "journal.jsonl"


@dataclass(frozen=True, slots=True)
class Entry:
    """What became of a case.

    Parameters
    ----------
    case : its number. status : ``"done"`` or ``"failed"``.
    record : numbers and texts by name, as the function of the campaign returned them.
    reason : why it failed. seconds : time that it took on its worker, s.
    """

    case: int
    status: Literal["done", "failed"]
    record: dict[str, Any] = field(default_factory=dict)
    reason: str = ""
    seconds: float = 0.0


class Journal:
    """The journal in a folder; only one process at a time may have it open.

    Parameters
    ----------
    folder : of the campaign, existing. key : what the journal belongs to, see `Plan.key`.
    facts : kept in the first line for people who read the file.

    Raises
    ------
    InputError
        If the journal is of another plan, broken in its middle, or open in another process.
    """

    def __init__(self, folder: Path, key: str, facts: Mapping[str, Any] | None = None) -> None:
        self.path = folder / _NAME
        self._file = self.path.open("a+b")
        try:
            self._lock()
            self.entries = self._read(key)
            if self._file.tell() == 0:
                self._write({"key": key, **(facts or {})})
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, entry: Entry) -> None:
        """Keep an entry, which is on the disk when this returns; it replaces an earlier one of its case."""
        self._write(asdict(entry))
        self.entries[entry.case] = entry

    def forget_failed(self) -> None:
        """Take failed cases for not computed; what is computed for them then replaces the failure."""
        self.entries = {number: e for number, e in self.entries.items() if e.status == "done"}

    def _write(self, line: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{self.path.parent}",
                got="a folder in which another campaign is running",
                expected="a folder of its own for each running campaign",
                remedy="wait for it or choose another folder",
            ) from None

    def _read(self, key: str) -> dict[int, Entry]:
        """Return the entries, leave the file at its end, and cut off a torn last line."""
        self._file.seek(0)
        entries: dict[int, Entry] = {}
        for number, line in enumerate(self._whole_lines(self._file), start=1):
            try:
                content = json.loads(line)
                if number > 1:
                    entries[content["case"]] = Entry(**content)
                elif content["key"] != key:
                    raise self._foreign()
            except (ValueError, KeyError, TypeError):
                raise InputError(
                    f"{self.path}, line {number}",
                    got="a line that this program has not written",
                    expected="a journal of a campaign",
                    remedy="choose another folder, or remove the journal to begin anew",
                ) from None
        return entries

    @staticmethod
    def _whole_lines(file: IO[bytes]) -> list[bytes]:
        text = file.read()
        whole = text.rfind(b"\n") + 1
        file.truncate(whole)
        file.seek(whole)
        return text[:whole].splitlines()

    def _foreign(self) -> InputError:
        return InputError(
            f"{self.path.parent}",
            got="results of another study",
            expected="an empty folder or one of the same study",
            remedy="choose another folder for --out",
        )
