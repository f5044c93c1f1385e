"""What the command line tool asks for, and why it can't be had."""


class Refused(Exception):
    """There is nothing to draw, for the reason that the message says to people."""


class Missing(Exception):
    """A part of this host that drawing needs is not there; the message says what to do."""
