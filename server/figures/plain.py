"""Texts that participants chose, as they may stand in figures and pages: on one line, short, and
without what can't be seen or turns the text around it. What makes them text and no markup is done
where they are written (page.py, and matplotlib for figures)."""

import re
import unicodedata

# Control characters, bidirectional controls and invisible characters, as in
# server/base/plain_text.cc, and what XML forbids.
UNSEEN = re.compile("[\x00-\x1f\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
                    "\ufff9-\ufffb\ufffe\uffff\ud800-\udfff\U000e0000-\U000e007f]")
MOST_MARKS = 2  # combining marks on one character; more of them reach into other lines


def shown_code(match):
    return f"⟨U+{ord(match.group()):04X}⟩"


def few_marks(text):
    kept, marks = [], 0
    for character in text:
        marks = marks + 1 if unicodedata.combining(character) else 0
        if marks <= MOST_MARKS:
            kept.append(character)
    return "".join(kept)


def width(character):
    """In columns, of which those of East Asia take two."""
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def cut(text, most):
    """At most `most` columns of it, with an ellipsis where something is missing."""
    if sum(map(width, text)) <= most:
        return text
    kept, used = [], 1
    for character in text:
        used += width(character)
        if used > most:
            break
        kept.append(character)
    return "".join(kept).rstrip() + "…"


def plain(text, most=200):
    """At most `most` columns of `text` on one line; what can't be seen is shown by its number."""
    text = re.sub(r"[\t\r\n]+", " ", str(text)[: 4 * most])
    return cut(UNSEEN.sub(shown_code, few_marks(text)).strip(), most)


def lines(text):
    """A text of several lines, whole."""
    return re.sub(r"[^\n\t]", lambda one: UNSEEN.sub(shown_code, one.group()),
                  str(text).replace("\r\n", "\n"))


def number(value, digits=4):
    """1234.5 -> "1,234.5000"; "–" for what is not known."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return "–"
    return f"{value:,.{max(0, min(int(digits), 12))}f}"


def interval(low, high, digits):
    """"[0.1, 0.3]", or "" if one end is not known."""
    texts = (number(low, digits), number(high, digits))
    return "" if "–" in texts else f"[{texts[0]}, {texts[1]}]"


def percent(part, whole):
    return f"{100 * part / whole:.1f} %" if whole else "–"


def heading(metric):
    """"Time (s)"."""
    title = metric["title"][:1].upper() + metric["title"][1:]
    return f"{title} ({metric['unit']})" if metric.get("unit") else title


def counted(count, one):
    return f"{count:,} {one}" if count == 1 else f"{count:,} {one}s"
