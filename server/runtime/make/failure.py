"""How it ends when a runtime can't be made. One sentence says what, where and what to do."""

import re

# As IsUnsafe of server/base/plain_text.h, and bytes of file names that are not UTF-8.
_UNSAFE = re.compile("[\x00-\x1f\x7f-\x9f\xad\u034f\u061c\u180e\u200b-\u200f\u2028-\u202e"
                      "\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb\U0001d173-\U0001d17a"
                      "\U000e0000-\U000e007f]")


class WrongUse(Exception):
    """The caller's to correct; exit status 2."""


class Trouble(Exception):
    """This host's, or the network's; exit status 4."""


def sanitized(text: object) -> str:
    """Foreign text for a terminal, as one line (server/base/plain_text.h)."""
    return _UNSAFE.sub("?", str(text))
