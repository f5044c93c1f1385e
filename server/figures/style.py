"""How figures look, and their bytes: the same numbers give the same file. matplotlib is imported
here alone, and late, as numbers can be had without it."""

import io
import logging
import os
import re
import warnings

from order import Missing

# Okabe and Ito's palette, which readers with any kind of colour blindness can tell apart. Lines
# also differ by their dashes.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 3)), (0, (3, 3)), (0, (1, 2)))
OF_OUTCOME = {"success": "#009e73", "failure": "#e69f00", "fault": "#555555",
              "withheld": "#999999"}
HATCH_OF_OUTCOME = {"success": "", "failure": "////", "fault": "xxxx", "withheld": "...."}
QUIET = "#666666"
GRID = "#dddddd"
BOX = "\u25af"
WIDTH = 7.0  # inches: the text width of A4

SETTINGS = {
    "axes.axisbelow": True,
    "axes.edgecolor": QUIET,
    "axes.formatter.offset_threshold": 2,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.labelsize": 9,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "figure.constrained_layout.use": True,
    "font.family": ["DejaVu Sans", "Noto Sans CJK JP", "Noto Sans Arabic", "Noto Emoji", "Symbola"],
    "font.size": 8.5,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "hatch.color": "#ffffff",
    "hatch.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "path.simplify": True,
    "pdf.fonttype": 42,  # TrueType, so that text in the file stays text
    "svg.fonttype": "none",  # text stays text, and the reader's fonts draw what DejaVu lacks
    "svg.hashsalt": "myograde",
    "text.parse_math": False,  # a $ in a name is a $
    "text.usetex": False,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}


def matplotlib_module():
    """matplotlib, set up; Missing if this host has none. Settings of the user and of the current
    folder do not count."""
    os.environ.pop("MATPLOTLIBRC", None)
    os.chdir("/")
    logging.getLogger("matplotlib").setLevel(logging.CRITICAL)
    warnings.simplefilter("ignore")
    try:
        import matplotlib  # pylint: disable=import-outside-toplevel
        import matplotlib.figure  # pylint: disable=import-outside-toplevel
    except ImportError as error:
        raise Missing("figures need matplotlib, which this host does not have: install Debian's "
                      "package python3-matplotlib") from error
    matplotlib.rcdefaults()
    matplotlib.rcParams.update(SETTINGS)
    return matplotlib


def figure(height, rows=1, columns=1, **options):
    """A figure of `height` inches and its axes, an array of two dimensions."""
    module = matplotlib_module()
    drawn = module.figure.Figure(figsize=(WIDTH, height))
    return drawn, drawn.subplots(rows, columns, squeeze=False, **options)


def handles(count, dashes):
    """What a legend shows of each of `count` lines, or without `dashes` points."""
    from matplotlib.lines import Line2D  # pylint: disable=import-outside-toplevel
    return [Line2D([], [], color=COLOURS[place % len(COLOURS)], markersize=4,
                   linestyle=DASHES[place % len(DASHES)] if dashes else "",
                   marker="" if dashes else "o") for place in range(count)]


def as_svg(drawn):
    """Bytes of an SVG file."""
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "MyoGrade"})
    return buffer.getvalue()


def drawable():
    """The characters that the fonts of figures on this host can draw."""
    from matplotlib import font_manager  # pylint: disable=import-outside-toplevel
    families = SETTINGS["font.family"]
    known = set()
    for font in font_manager.fontManager.ttflist:
        if font.name in families:
            known.update(font_manager.get_font(font.fname).get_charmap())
    return known


def as_pdf(drawn):
    """Bytes of a PDF file with its fonts. What they lack is a box: nothing would be seen of it."""
    from matplotlib.text import Text  # pylint: disable=import-outside-toplevel
    known = drawable()
    for text in drawn.findobj(Text):
        text.set_text("".join(one if ord(one) in known or one == "\n" else BOX
                              for one in text.get_text()))
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="pdf", metadata={"CreationDate": None, "Creator": "MyoGrade"})
    return buffer.getvalue()


def as_inline_svg(drawn, prefix):
    """Text of an <svg> element for an HTML page: its ids begin with `prefix`, so that those of two
    figures differ, and it has no prolog, metadata or rules for the page's other elements."""
    text = as_svg(drawn).decode("utf-8")
    text = text[text.index("<svg"):].strip()
    text = re.sub(r"<metadata>.*?</metadata>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r"<style type=\"text/css\">.*?</style>", "", text, count=1, flags=re.DOTALL)
    # In what matplotlib writes; a ">" of a text is escaped, so a tag ends at the first one.
    return re.sub(r"<[^>]*>", lambda tag: re.sub(
        r"(\bid=\"|url\(#|xlink:href=\"#)", rf"\g<1>{prefix}-", tag.group()), text)
