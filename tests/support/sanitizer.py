"""Options of AddressSanitizer for a program that a test starts."""

import os


def asan_options(*more):
    """The value of ASAN_OPTIONS: those of this process, and `more`, which take precedence."""
    return ":".join([*filter(None, [os.environ.get("ASAN_OPTIONS")]), *more])
