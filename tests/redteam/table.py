"""The vocabulary of the tables: what a case is, and which verdicts a program may get."""

import dataclasses

SCORED = ("success", "failure")
# Errors that mean denial, besides those of a missing file.
REFUSED = ("EPERM", "EACCES", "ENOSYS", "EROFS", "EXDEV")
ABSENT = REFUSED + ("ENOENT", "ENOTDIR", "ELOOP")
UNREACHABLE = REFUSED + ("ENETUNREACH", "EHOSTUNREACH", "ECONNREFUSED", "EADDRNOTAVAIL",
                         "EAFNOSUPPORT", "ENOENT", "EINVAL", "ESOCKTNOSUPPORT")
LACKING_MEMORY_GROUP = {"cgroup_memory": ("memory_limit", "crash", "disk_limit")}
LACKING_TASK_GROUP = {"cgroup_pids": ("process_limit", "init_timeout", "crash")}


@dataclasses.dataclass(frozen=True)
class Variant:
    """One run of a program."""

    args: tuple = ()              # of the program
    expect: tuple = SCORED        # outcomes of every episode, any of these
    track: str = "rt"             # of host.TRACKS
    profile: str = None
    episodes: int = 1
    lacking: dict = dataclasses.field(default_factory=dict)  # a check of the doctor that is not
    #                               ok -> outcomes that are expected then
    steps: int = None             # played before the fault
    limit: str = None             # the limit that the fault names
    detail: str = ""              # part of the fault's sentence
    denied: tuple = ()            # findings that must be there and be denied ...
    denied_with: tuple = REFUSED  # ... with one of these errors
    reports: dict = dataclasses.field(default_factory=dict)  # findings and what they must say
    at_most: dict = dataclasses.field(default_factory=dict)  # findings that are numbers
    truncated: tuple = ()         # streams that are marked as truncated
    absent: tuple = ()            # what its output must not contain
    cpu_s: float = 0              # minimum CPU time that must have been counted
    wall_s: float = None          # longest wall time of an episode that is the participant's fault
    clean_s: float = 2.0          # until everything is gone after the end
    beside: tuple = ()            # arguments of a second copy that runs concurrently
    repeat: int = 1               # consecutive runs
    check: str = None             # an additional check of judge.py, by name

    @property
    def name(self):
        words = " ".join(str(arg) for arg in self.args if not str(arg).startswith("{"))
        return " ".join(filter(None, (words, self.profile)))


@dataclasses.dataclass(frozen=True)
class Case:
    """A number of the table, its subject, its program and that program's runs."""

    number: int
    title: str
    program: str                  # a file of programs/, .py or .c; empty: made at submission
    variants: tuple = (Variant(),)
    quick: bool = False           # belongs to the quick form of the suite


def each(words, **common):
    """A variant for each of these arguments, otherwise identical."""
    return tuple(Variant(args=tuple(word.split()), **common) for word in words)
