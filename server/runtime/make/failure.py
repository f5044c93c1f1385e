"""How it ends when a runtime can't be made. One sentence says what, where and what to do."""


class WrongUse(Exception):
    """The caller's to correct; exit status 2."""


class Trouble(Exception):
    """This host's, or the network's; exit status 4."""
