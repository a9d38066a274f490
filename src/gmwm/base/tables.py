"""Format tables of text in columns, for summaries and commands."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def align(rows: Sequence[Sequence[str]], right: Collection[int] = (), indent: str = "  ") -> list[str]:
    """Format the rows of a table, two blanks between columns; those in `right` are aligned to the right.

    >>> for line in align([["parameter", "value"], ["N", "0.21"]], right={1}):
    ...     print(repr(line))
    '  parameter  value'
    '  N           0.21'
    """
    if not rows:
        return []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = zip(row, widths, strict=True)
        texts = [text.rjust(width) if k in right else text.ljust(width) for k, (text, width) in enumerate(cells)]
        lines.append(indent + "  ".join(texts).rstrip())
    return lines


def table_with_rule(rows: Sequence[Sequence[str]]) -> list[str]:
    """Format a table of numbers with a rule below its first row. The first column is aligned to the left.

    >>> print("\\n".join(table_with_rule([["axis", "N"], ["gyro_x", "0.21"]])))
      axis       N
      ────────────
      gyro_x  0.21
    """
    head, *lines = align(rows, right=range(1, len(rows[0])))
    return [head, "  " + "─" * (max(map(len, (head, *lines))) - 2), *lines]
