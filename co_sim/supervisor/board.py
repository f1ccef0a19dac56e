"""The memory that a supervised run shares with its supervisor: progress, and rows in segments.

The rows of a run lie in segments that are used in turn. A segment begins with the history that links may
read, a copy of the end of the segment before, and then has room for `length` steps. Where row `r` of a run
lies follows from where its row 0 lies, so that a reader needs nobody to tell it, not even the living. Behind
them is room for the texts that numbers in the rows stand for.
"""

from __future__ import annotations

import mmap
import os
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.table import BLOCK_VALUES, LONGEST_BLOCK, PART, PHASE, STEP, Phase, Table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from co_sim.kernel import Integers, Matrix

__all__ = ["Board", "Format", "Progress", "SharedTable", "new_memory"]

_SEGMENTS = 4
#: The header: integers, then the name of a function.
_INTEGERS, _NAME, _HEADER = 32, 128, 512
#: Places of the integers behind those of the progress.
_PUBLISHED, _CONSUMED, _SEGMENT, _ROW, _BEGIN, _STOP, _DATA, _RESIDENT, _TEXTS = range(4, 13)
#: Room for all different texts that the signals of a run ever have, bytes.
_TEXT_ROOM = 1 << 22
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class Format:
    """Sizes of a board.

    Parameters
    ----------
    history : rows that a segment has before those of its steps. width : signals. length : steps that a
        segment has room for. prompt : whether observers wait for each block. texts : bytes for texts.
    """

    history: int
    width: int
    length: int
    prompt: bool
    texts: int = 0

    @classmethod
    def of(cls, history: int, width: int, longest: int, *, texts: bool) -> Format:
        """Return the sizes for blocks of at most `longest` steps, with or without texts among the signals."""
        prompt = longest < LONGEST_BLOCK
        room = max(BLOCK_VALUES // max(width, 1), 1)
        return cls(history, width, min(room, longest) if prompt else room, prompt, _TEXT_ROOM if texts else 0)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of all rows."""
        return _SEGMENTS, self.history + 1 + self.length, self.width

    @property
    def size(self) -> int:
        """Of the memory, bytes."""
        return self.rows_end + self.texts

    @property
    def rows_end(self) -> int:
        """Where the rows end, bytes."""
        return _HEADER + 8 * int(np.prod(self.shape))


@dataclass(frozen=True, slots=True)
class Progress:
    """What a run was doing: see `co_sim.table`; `function` of an FMU, if it was in one outside of a step."""

    phase: Phase
    step: int
    part: int
    function: str


def new_memory(size: int) -> int:
    """Return the descriptor of memory that vanishes with the last process that has it."""
    descriptor = os.memfd_create("co_sim")
    os.ftruncate(descriptor, size)
    return descriptor


class Board:
    """The shared memory, as both sides see it.

    Parameters
    ----------
    descriptor : of the memory; may be closed afterwards. sizes : of what is in it.
    """

    def __init__(self, descriptor: int, sizes: Format) -> None:
        self.sizes = sizes
        self._memory = mmap.mmap(descriptor, sizes.size)
        self.integers: Integers = np.frombuffer(self._memory, dtype=np.int64, count=_INTEGERS)
        self.segments: np.ndarray[tuple[int, int, int], np.dtype[np.float64]] = np.frombuffer(
            self._memory, dtype=np.float64, offset=_HEADER, count=int(np.prod(sizes.shape))
        ).reshape(sizes.shape)
        self._read_texts = 0

    def begin_run(self, segment: int, row: int, step: int) -> None:
        """Tell where row 0 of a run lies, and which step of the master it is."""
        self.integers[[_PUBLISHED, _CONSUMED, _SEGMENT, _ROW, _BEGIN]] = 0, 0, segment, row, step

    @property
    def first_step(self) -> int:
        """Step of the master at row 0 of the run."""
        return int(self.integers[_BEGIN])

    @property
    def published(self) -> int:
        """Rows of the run that its process has declared complete."""
        return int(self.integers[_PUBLISHED])

    @published.setter
    def published(self, n: int) -> None:
        self.integers[_PUBLISHED] = n

    @property
    def consumed(self) -> int:
        """Rows of the run that the supervisor needs no longer."""
        return int(self.integers[_CONSUMED])

    @consumed.setter
    def consumed(self, n: int) -> None:
        self.integers[_CONSUMED] = n

    @property
    def stop(self) -> bool:
        """Whether the run shall end at its next block."""
        return bool(self.integers[_STOP])

    @stop.setter
    def stop(self, value: bool) -> None:
        self.integers[_STOP] = value

    @property
    def memory(self) -> tuple[int, int]:
        """Private and resident memory of the process when its run began, bytes."""
        return int(self.integers[_DATA]), int(self.integers[_RESIDENT])

    @memory.setter
    def memory(self, sizes: tuple[int, int]) -> None:
        self.integers[[_DATA, _RESIDENT]] = sizes

    @property
    def pulse(self) -> bytes:
        """Something that changes as long as the run gets on."""
        return self.integers[:_CONSUMED].tobytes()

    @property
    def progress(self) -> Progress:
        """What the run is doing."""
        phase = Phase(int(self.integers[PHASE]))
        function = self._memory[_HEADER - _NAME : _HEADER].rstrip(b"\0").decode(errors="replace")
        return Progress(phase, int(self.integers[STEP]), int(self.integers[PART]), function)

    @property
    def complete(self) -> int:
        """Rows of the run that are complete, whether declared so or not; for a process that is dead."""
        now = self.progress
        if now.phase != Phase.STEPPING:
            return self.published
        return max(self.published, now.step - self.first_step + 1)

    def tell_function(self, name: str) -> None:
        """Tell which function of an FMU is called."""
        self._memory[_HEADER - _NAME : _HEADER] = name.encode()[:_NAME].ljust(_NAME, b"\0")

    def tell_text(self, text: str) -> None:
        """Tell the next text, so that the supervisor knows what its number stands for.

        Raises
        ------
        RuntimeError
            If there have been too many.
        """
        data = text.encode()
        begin = int(self.integers[_TEXTS])
        end = begin + _LENGTH.size + len(data)
        if end > self.sizes.texts:
            raise RuntimeError(
                f"more than {self.sizes.texts} bytes of different texts in one supervised run; "
                "use Master for signals with ever new texts"
            )
        place = self.sizes.rows_end
        self._memory[place + begin : place + end] = _LENGTH.pack(len(data)) + data
        self.integers[_TEXTS] = end

    def new_texts(self) -> Iterator[str]:
        """Return the texts that were told since the last time, in the order of their numbers."""
        end = int(self.integers[_TEXTS])
        while self._read_texts < end:
            place = self.sizes.rows_end + self._read_texts
            (length,) = _LENGTH.unpack_from(self._memory, place)
            place += _LENGTH.size
            yield self._memory[place : place + length].decode()
            self._read_texts += _LENGTH.size + length

    def rows(self, begin: int, end: int) -> Iterator[Matrix]:
        """Return the rows of the run from `begin` to `end` (excluded) in pieces."""
        while begin < end:
            segment, row = self._place(begin)
            n = min(end - begin, self.segments.shape[1] - row)
            yield self.segments[segment % _SEGMENTS, row : row + n]
            begin += n

    def needed(self, segment: int) -> int:
        """Return how many rows of the run must be consumed before `segment` may be used."""
        first = int(self.integers[_SEGMENT])
        if segment - _SEGMENTS < first:
            return 0
        length, used = self.sizes.length, int(self.integers[_ROW]) - self.sizes.history
        return length * (segment - _SEGMENTS - first + 1) - used + 1

    def _place(self, r: int) -> tuple[int, int]:
        """Return the segment, counted without end, and the row in it, of row `r` of the run."""
        history, length = self.sizes.history, self.sizes.length
        steps = int(self.integers[_ROW]) - history + r
        segment = int(self.integers[_SEGMENT])
        if steps <= length:
            return segment, history + steps
        return segment + (steps - 1) // length, history + 1 + (steps - 1) % length


class SharedTable(Table):
    """A table whose rows and progress lie on a board.

    Parameters
    ----------
    board : to write on. wait : is called with a number of rows, and returns when so many are consumed.
    history, width : as of `Table`.
    """

    def __init__(self, board: Board, wait: Callable[[int], None], history: int, width: int) -> None:
        super().__init__(history, width)
        self._board, self._wait = board, wait
        self.progress = board.integers[:4]
        self.rows = board.segments[0]
        self.segment = 0

    def room(self) -> int:
        """Return how many steps may be made at once: what is left of a segment."""
        return len(self.rows) - 1 - self.row or self._board.sizes.length

    def make_room(self, n: int) -> None:
        """Go to the next segment if there is no room in this one, as soon as its rows are consumed."""
        if self.row + n < len(self.rows):
            return
        self._wait(self._board.needed(self.segment + 1))
        kept = self.rows[self.row - self.history : self.row + 1]
        self.segment += 1
        self.rows = self._board.segments[self.segment % _SEGMENTS]
        self.rows[: self.history + 1] = kept
        self.row = self.history
