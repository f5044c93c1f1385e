"""What programs print for --help, in its parts: manual pages, completions and the site's list of commands are
made of it."""

import functools
import pathlib
import re
import subprocess

DEADLINE_S = 60
HEADINGS = {"Positionals": "ARGUMENTS", "Options": "OPTIONS", "Subcommands": "VERBS",
            "Example": "EXAMPLE", "Exit status": "EXIT STATUS"}


class Help:
    """What a program or verb prints for --help, in its parts."""

    def __init__(self, command):
        text = subprocess.run([*command, "--help"], check=True, capture_output=True, text=True,
                              timeout=DEADLINE_S, env={"PATH": "/usr/bin:/bin", "HOME": "/root"}).stdout
        head, self.usage, rest = re.fullmatch(r"(.*?)^Usage: (.*?)\n(.*)", text, re.S | re.M).groups()
        # Some print the path that they were started by, which is the build's.
        self.usage = self.usage.replace(str(command[0]), pathlib.Path(command[0]).name)
        self.summary = head.strip()
        self.sections, name = {}, None
        for line in rest.splitlines():
            heading = re.fullmatch(r"([A-Z][a-z ]+):(.*)", line)
            if heading and (heading[1] in HEADINGS or not heading[2]):
                # Verbs stand in groups, each with a heading of its own.
                name = heading[1] if heading[1] in HEADINGS else "Subcommands"
                self.sections.setdefault(name, [])
                if heading[2].strip():
                    self.sections[name].append(heading[2].strip())
            elif name == "Exit status" or (name and line.strip()):
                self.sections[name].append(line)

    def entries(self, section):
        """Pairs of what is written and what it means."""
        found = []
        for line in self.sections.get(section, []):
            entry = re.fullmatch(r"  (\S.*?)(?:  +(\S.*))?", line)
            if entry:
                found.append([entry[1], entry[2] or ""])
            elif found:
                found[-1][1] = f"{found[-1][1]} {line.strip()}".strip()
        return found

    def options(self):
        """Triples: the names of an option, whether it takes a value, what it means."""
        for name, meaning in self.entries("Options"):
            words = name.split(" Excludes:")[0].split()
            yield words[0].split(","), len(words) > 1 and words[1] != "REQUIRED", meaning

    def verbs(self):
        return [name for name, _ in self.entries("Subcommands")]


@functools.cache
def help_of(*command):
    """The Help of a program or verb, asked for once."""
    return Help(command)


def helps_below(*command):
    """The words of each verb below a program or verb, and what it prints for --help."""
    for verb in help_of(*command).verbs():
        yield [verb], help_of(*command, verb)
        for words, inner in helps_below(*command, verb):
            yield [verb, *words], inner
