"""The notes of a recording as HTML: headings, lists, tables, bold. Everything else is text, and escaped."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape


def html_of(text: str) -> str:
    """HTML of a markdown text as `mechviz.outputs.rerun.content.notes` writes it."""
    return "\n".join(_blocks(text.splitlines()))


def _blocks(lines: list[str]) -> Iterator[str]:
    k = 0
    while k < len(lines):
        line = lines[k].strip()
        heading = re.match(r"(#{1,4}) +(.*)", line)
        if heading:
            level = len(heading[1]) + 1  # the page's own title is the first
            yield f"<h{level}>{_inline(heading[2])}</h{level}>"
            k += 1
        elif line.startswith(("- ", "|")):
            mark = line[0]
            end = next((i for i in range(k, len(lines)) if not lines[i].strip().startswith(mark)), len(lines))
            rows = [row.strip() for row in lines[k:end]]
            yield from _table(rows) if mark == "|" else ["<ul>", *(f"<li>{_inline(row[2:])}</li>" for row in rows), "</ul>"]
            k = end
        else:
            if line:
                yield f"<p>{_inline(line)}</p>"
            k += 1


def _table(rows: list[str]) -> Iterator[str]:
    cells = [[_inline(cell.strip()) for cell in row.strip("|").split("|")] for row in rows if not set(row) <= set("|-: ")]
    yield '<div class="wide"><table>'
    for number, row in enumerate(cells):
        tag = "th" if number == 0 else "td"
        yield "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in row) + "</tr>"
    yield "</table></div>"


def _inline(text: str) -> str:
    text = escape(text)
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", text)
    return re.sub(r"`(.+?)`", r"<code>\1</code>", text)
