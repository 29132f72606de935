"""A statement of the paper, and what became of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Statement:
    """What the paper states, what is found here, and whether that agrees: None where the paper gives no measure."""

    claim: str
    found: str
    agrees: bool | None
    reason: str = ""

    @property
    def cell(self) -> str:
        """What is found, marked where it does not agree."""
        return f"**does not agree**: {self.found}" if self.agrees is False else self.found


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def statements_table(columns: dict[str, list[Statement]]) -> str:
    """Return what the paper states beside what was found in each column, by its name."""
    rows = []
    for each in zip(*columns.values(), strict=True):
        verdicts = [_verdict(one.agrees) for one in each]
        shared = (
            verdicts[0]
            if len(set(verdicts)) == 1
            else ", ".join(
                f"{name}: {verdict or 'no measure'}" for name, verdict in zip(columns, verdicts, strict=True)
            )
        )
        why = ": ".join(part for part in (shared, each[0].reason) if part)
        rows.append((each[0].claim, *(one.cell for one in each), why))
    return table(("the paper states", *columns, "verdict"), rows)


def _verdict(agrees: bool | None) -> str:
    return {True: "agrees", False: "does not agree", None: ""}[agrees]
