"""The examples in the README and the docs run as they stand, and print what stands below them.

A block headed ``python`` is a program of its own; one headed ``python continued`` goes on in the process of
the block before it. A block headed ``text`` right below an example is what that example prints.
"""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```python( continued)?\n(.*?)^```\n(?:\n?```text\n(.*?)^```\n)?", re.S | re.M)
#: Printed between blocks that share a process.
CUT = "---- end of a block ----\n"


class Block(NamedTuple):
    code: str
    printed: str | None


def examples(page: Path) -> list[list[Block]]:
    """Return the programs of a page, each as its blocks."""
    programs: list[list[Block]] = []
    for continued, code, printed in BLOCK.findall(page.read_text(encoding="utf-8")):
        if not continued:
            programs.append([])
        programs[-1].append(Block(code, printed or None))
    return programs


EXAMPLES = [
    pytest.param(blocks, id=f"{page.stem}-{i}") for page in PAGES for i, blocks in enumerate(examples(page))
]


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 20
    assert sum(block.printed is not None for example in EXAMPLES for block in example.values[0]) >= 10


@pytest.mark.parametrize("blocks", EXAMPLES)
def test_example_runs(blocks: list[Block], tmp_path: Path) -> None:
    cut = f"\nprint({CUT!r}, end='')\n"
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{cut.join(block.code for block in blocks)}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    for block, printed in zip_longest(blocks, done.stdout.split(CUT)):
        if block.printed is not None:
            assert printed == block.printed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target
