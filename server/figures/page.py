"""One HTML file that needs nothing else: no script, no request, pictures and figures inside it.

Elements are made by h(), which escapes every text it is given, so that markup comes from this
folder alone."""

import base64
import html
import re

PNG = b"\x89PNG\r\n\x1a\n"
# In place of headers, as the file is opened from a disk or a mail: nothing may be loaded, run, sent
# or framed, whatever stands in it. matplotlib's figures style their elements one by one.
POLICY = ("default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; "
          "form-action 'none'")
STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 "DejaVu Sans", Verdana, sans-serif; color: #111; background: #fff;
       max-width: 64rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin: 2rem 0 0.5rem; break-after: avoid; }
table { border-collapse: collapse; font-size: 0.75rem; margin: 0.5rem 0; }
caption { text-align: left; font-weight: bold; padding: 0.3rem 0; }
td bdi { display: inline-block; min-width: min(5rem, 20vw); max-width: 16rem; }
th, td { text-align: left; padding: 0.2rem 0.35rem; border-bottom: 1px solid #ccc;
         vertical-align: top; overflow-wrap: anywhere; }
th { border-bottom: 2px solid #888; overflow-wrap: normal; }
.num { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.wide { overflow-x: auto; } .quiet { color: #555; font-size: 0.85rem; }
td .quiet { font-size: 0.62rem; }
figure { margin: 1rem 0; break-inside: avoid; } figcaption { font-size: 0.85rem; }
figure svg, figure img { max-width: 100%; height: auto; display: block; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: 0.75rem; background: #f4f4f4;
      padding: 0.5rem; }
code { overflow-wrap: anywhere; font-size: 0.85rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 0.15rem 1rem; margin: 0.5rem 0; }
dt { color: #555; } dd { margin: 0; overflow-wrap: anywhere; }
@media print { body { max-width: none; padding: 0; font-size: 10pt; } table { font-size: 7pt; }
               td .quiet { font-size: 5.5pt; }
               tr { break-inside: avoid; } .wide { overflow: visible; } }
"""


class Markup(str):
    """Text that is markup already."""


def flat(children):
    for child in children:
        if isinstance(child, (list, tuple)):
            yield from flat(child)
        elif child is not None and child is not False:
            yield child if isinstance(child, Markup) else html.escape(str(child), quote=False)


def h(tag, *children, **attributes):
    """An element. Children are texts, which are escaped, elements, lists of both, or None. A "_" at
    the end of an attribute's name is dropped, one within becomes a "-"."""
    written = "".join(f' {name.rstrip("_").replace("_", "-")}="{html.escape(str(value))}"'
                      for name, value in attributes.items() if value is not None)
    if tag in ("meta", "img", "br"):
        return Markup(f"<{tag}{written}>")
    return Markup(f"<{tag}{written}>{''.join(flat(children))}</{tag}>")


def name(text):
    """A name that somebody chose: whatever its direction, the text around keeps its own."""
    return h("bdi", text)


def facts(pairs):
    """Names and values; a value of None leaves the pair out."""
    return h("dl", [[h("dt", key), h("dd", value)] for key, value in pairs if value is not None])


def table(caption, head, rows, numeric=()):
    """`head`: titles; `rows`: lists of cells; `numeric`: columns of numbers, by their place."""
    def cells(tag, row, **attributes):
        return h("tr", [h(tag, cell, class_="num" if place in numeric else None, **attributes)
                        for place, cell in enumerate(row)])
    return h("div", h("table", h("caption", caption), h("thead", cells("th", head, scope="col")),
                      h("tbody", [cells("td", row) for row in rows])), class_="wide")


def figure(svg, words):
    """`svg`: of style.as_inline_svg; `words` say what it shows, also to those who don't see it."""
    labelled = re.sub(r"<svg\b", f'<svg role="img" aria-label="{html.escape(words)}"', svg, count=1)
    return h("figure", Markup(labelled), h("figcaption", words))


def picture(data, words):
    """A PNG picture, from Base64; None if it is none."""
    try:
        bytes_ = base64.b64decode(data, validate=True)
    except ValueError:
        return None
    if not bytes_.startswith(PNG):
        return None
    return h("figure", h("img", src="data:image/png;base64," + base64.b64encode(bytes_).decode(),
                         alt=words), h("figcaption", words))


def section(title, *children):
    return h("section", h("h2", title), *children) if any(flat(children)) else None


def notices(sentences):
    return [h("p", sentence, class_="quiet") for sentence in sentences]


def document(title, *children):
    """The bytes of the whole file."""
    return ("<!DOCTYPE html>\n" + h(
        "html", h("head", h("meta", charset="utf-8"),
                  h("meta", http_equiv="Content-Security-Policy", content=POLICY),
                  h("meta", name="viewport", content="width=device-width, initial-scale=1"),
                  h("meta", name="referrer", content="no-referrer"),
                  h("title", title), h("style", Markup(STYLE))),
        h("body", h("main", h("h1", title), *children)), lang="en") + "\n").encode("utf-8")
