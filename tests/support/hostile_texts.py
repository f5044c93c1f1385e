"""Texts that participants may write where a name, an output, an error or a file name is shown.

NAMES are those that the API takes as the name of a team or a policy, OTHERS those that it refuses as
one, but that a policy can print. Each is there for a reader that would not take it for a text."""

NAMES = {
    "an element": "\"><svg onload=alert(1)>",
    "the end of a script": "</script><script>alert(2)</script>",
    "the end of CDATA": "]]><x>&amp;&#x3c;<!--",
    "an attribute": "x' onmouseover='alert(3)' \"",
    "an address": "javascript:alert(4)//https://example.org",
    "a formula of a spreadsheet": "=cmd|' /C calc'!A0",
    "a sum": "+1+cmd|'!A1",
    "a negative number": "-2+3",
    "a function": "@SUM(A1:A9)",
    "mathematics": "$\\frac{1}{0}$ $x_1^2$ \\input{/etc/passwd}",
    "templates": "{{7*7}} ${7*7} <%= 7*7 %> %s%n",
    "SQL": "Robert'); DROP TABLE team;--",
    "emoji": "🦿🏅 winners",
    "right to left": "שלום (1) عالم",
    "quotes and commas": "a,\"b\";'c'`d`",
    "a path": "..\\..\\web\\main.js",
}
OTHERS = {
    "turned around": "gpj.\u202eexe\u2066\u2069",
    "nothing to see": "win\u200bner\u2060\ufeff",
    "tags": "flag\U000e0067\U000e0062",
    "controls": "a\x00b\x1b[31m\x07\r\x9bc",
    "several lines": "one\ntwo\n\n=1+1",
    "a tower of marks": "z" + "\u0300" * 60,
    "long": "<b>long</b>" * 500,
    "no characters": "a\ufffeb\uffffc",
    "a family": "👩\u200d👧\u200d👦",
}
