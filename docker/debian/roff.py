"""Text in the language of manual pages, man(7)."""

import re


def roff(text):
    """Plain text, as it is."""
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq")
    return "\n".join("\\&" + line if line[:1] in (".", "\\") and line[:2] != "\\-" else line
                     for line in text.splitlines())


def page(name, section, summary, parts, day):
    """A manual page; `parts` are pairs of a heading and roff."""
    lines = [f'.TH {name.upper()} {section} "{day}" "MyoGrade" "MyoGrade"', ".SH NAME",
             f"{name} \\- {roff(summary)}"]
    for heading, text in parts:
        lines += [f".SH {heading}", text.strip()]
    return "\n".join(lines) + "\n"


def items(entries):
    """Pairs of what is written and what it means."""
    return "\n".join(f".TP\n.B {roff(name)}\n{roff(meaning) or 'No further words.'}"
                     for name, meaning in entries)


def inline(text):
    """A paragraph of Markdown without its marks; code in bold."""
    parts = re.split(r"`([^`]*)`", text)
    for i, part in enumerate(parts):
        if i % 2 == 0:
            part = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", part).replace("**", "")
            parts[i] = part.replace("\\", "\\e").replace("'", "\\(aq")
        else:
            parts[i] = "\\fB" + part.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq") + "\\fR"
    text = "".join(parts)
    return "\\&" + text if text[:1] in (".", "'") else text


def cells(line):
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def table(lines):
    """The first column is what a row is about; the others follow with their headings."""
    head, rows = cells(lines[0]), [cells(line) for line in lines[2:]]
    out = [f".PP\n{inline(head[0].capitalize())}:"] if " " in head[0] else []
    for first, *rest in rows:
        more = "; ".join(f"{title}: {cell}" for title, cell in zip(head[2:], rest[1:]) if cell)
        out.append(f".TP\n{inline(first)}\n{inline(rest[0] + (f' ({more})' if more else ''))}")
    return "\n".join(out)


def blocks(text):
    """Markdown's blocks: pairs of a kind (heading, code, table, item, text) and its lines."""
    kind, lines = None, []
    for line in [*text.splitlines(), ""]:
        if kind == "code":
            if line.startswith("```"):
                yield kind, lines
                kind, lines = None, []
            else:
                lines.append(line)
            continue
        new = ("code" if line.startswith("```") else "heading" if line.startswith("#") else
               "table" if line.startswith("|") else "item" if re.match(r"(- |\d+\. )", line) else
               None if not line.strip() else kind if kind in ("item", "text") else "text")
        if kind and (new != kind or new in ("heading", "item") and not line.startswith(" ")
                     and (new == "heading" or re.match(r"(- |\d+\. )", line))):
            yield kind, lines
            lines = []
        kind = new
        if kind and kind != "code":
            lines.append(line)


def from_markdown(text, heading):
    """Pairs of a heading and roff, for page(). What stands before the first heading of Markdown gets
    `heading`."""
    parts = [(heading, [])]
    for kind, lines in blocks(text):
        if kind == "heading":
            level = len(lines[0]) - len(lines[0].lstrip("#"))
            title = lines[0].lstrip("#").strip().replace("`", "")
            if level <= 2:
                parts.append((roff(title.upper()), []))
            else:
                parts[-1][1].append(f".SS {roff(title)}")
        elif kind == "code":
            parts[-1][1].append(".PP\n.nf\n" + roff("\n".join(lines)) + "\n.fi")
        elif kind == "table":
            parts[-1][1].append(table(lines))
        elif kind == "item":
            whole = " ".join(line.strip() for line in lines)
            parts[-1][1].append(".IP \\(bu 2\n" + inline(re.sub(r"^(- |\d+\. )", "", whole)))
        else:
            parts[-1][1].append(".PP\n" + inline(" ".join(line.strip() for line in lines)))
    return [(title, re.sub(r"\A\.PP\n", "", "\n".join(body))) for title, body in parts if body]
