"""Draws what the command line tool asks for. Standard input is one JSON object:

  {"make": "plot", "kind": "survival", "format": "svg", "results": [...]}

`make` is "plot" (README.md lists the kinds and what each needs), "report", "board-report", or "nothing",
which only finds out whether this host can draw.
`format` is "svg", "pdf", "html", or null for the numbers alone, which need no matplotlib. Standard
output is one line of JSON, {"numbers": ..., "bytes": N} and then N bytes of the file, or {"error":
"a sentence", "whose": "caller" or "host"} and nothing else."""

import json
import sys

import phase_report
import plots
import style
import submission_report
from order import Missing, Refused


def made(order):
    """(numbers, bytes of the file or b"")."""
    if order["format"]:
        style.matplotlib_module()
    if order["make"] == "nothing":
        return None, b""
    if order["make"] == "plot":
        return plots.made(order)
    if order["make"] == "report":
        numbers = submission_report.numbers_of(order["result"])
        page = submission_report.page
    else:
        numbers = phase_report.numbers_of(order)
        page = phase_report.page
    return numbers, page(order, numbers) if order["format"] else b""


def main():
    order = json.load(sys.stdin.buffer)
    file = b""
    try:
        numbers, file = made(order)
        answer = {"numbers": numbers, "bytes": len(file)}
    except Refused as refusal:
        answer = {"error": str(refusal), "whose": "caller"}
    except Missing as lack:
        answer = {"error": str(lack), "whose": "host"}
    out = sys.stdout.buffer
    out.write(json.dumps(answer, ensure_ascii=True, allow_nan=False).encode() + b"\n" + file)
    out.flush()


if __name__ == "__main__":
    main()
