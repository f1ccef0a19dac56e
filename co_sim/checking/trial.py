"""A short run of an FMU in a process of its own (`co_sim.trial`), which may die without harm."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from co_sim.checking.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["trial_findings"]

_TOPIC = "short run"
#: Characters of what the FMU printed that are shown after a crash.
_LAST_WORDS = 300
#: Longest time for the start of Python and the import of its modules, s.
_START = 120.0


def trial_findings(path: Path, kind: str, timeout: float) -> Iterator[Finding]:
    """Run an FMU for a hundred steps, inputs at their start values, and tell how it went.

    Parameters
    ----------
    path : the FMU.
    kind : ``"CoSimulation"`` or ``"ModelExchange"``.
    timeout : longest time for all that the FMU does, s.
    """
    with TemporaryDirectory(prefix="trial_") as folder:
        told, printed = Path(folder, "told"), Path(folder, "printed")
        # The working directory goes with the folder: what an FMU writes into it goes too.
        command = [sys.executable, "-m", "co_sim.trial", str(path.resolve()), kind, str(told)]
        modules = os.pathsep.join(str(Path(place).resolve()) for place in sys.path)
        with printed.open("wb") as file:
            child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=os.environ | {"PYTHONPATH": modules},
            )
            try:
                status = _wait(child, told, timeout)
            finally:
                child.kill()
                child.wait()
        lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
        words = _last_words(printed)
    yield from _outcome(kind, lines, status, timeout, words)


def _wait(child: subprocess.Popen[bytes], told: Path, timeout: float) -> int | None:
    """Return the exit status; ``None`` after too long a time, in which Python's own start does not count."""
    started = time.monotonic()
    while not told.exists() and time.monotonic() - started < _START:
        with suppress(subprocess.TimeoutExpired):
            return child.wait(0.05)
    try:
        return child.wait(timeout)
    except subprocess.TimeoutExpired:
        return None


def _outcome(
    kind: str, lines: list[str], status: int | None, timeout: float, words: str
) -> Iterator[Finding]:
    phase = lines[-1] if lines else "start of Python"
    if phase.startswith("{"):
        for severity, message in json.loads(phase)["findings"]:
            yield Finding(severity, _TOPIC, kind, message)
    elif status is None:
        yield Finding(
            "error", _TOPIC, kind, f"did not come back from the {phase} within {timeout:g} s{words}"
        )
    else:
        yield Finding("error", _TOPIC, kind, f"died in the {phase}: {_death(status)}{words}")


def _death(status: int) -> str:
    if status >= 0:
        return f"it ended the process with exit code {status}"
    with suppress(ValueError):
        return f"signal {signal.Signals(-status).name}"
    return f"signal {-status}"


def _last_words(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - _LAST_WORDS))
        text = file.read().decode(errors="replace")
    words = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return f'; its last words: "{words}"' if words else ""
