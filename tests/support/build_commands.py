"""How a build folder compiles and links, for tests that compile a source in another way or link a program with other
objects. The build folder itself stays as it is."""

import json
import os
import pathlib
import re
import shlex
import subprocess


class BuildCommands:
    """Needs ninja, and the programs built that are asked for."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.compiles = {}  # source -> (the file that is compiled with it in it, the command's words)
        self._units = []    # (object, file, sources in it, the command's words)
        for entry in json.loads(self._ninja("compdb")):
            if " -c " not in entry["command"]:
                continue
            unit, words = self.folder / entry["file"], shlex.split(entry["command"])
            sources = [str(unit)]
            # A build may compile many sources together, in a file that includes them.
            if "/Unity/" in str(unit):
                sources += re.findall(r'#include "([^"]+)"', unit.read_text(encoding="utf-8"))
            self._units.append((entry["output"], unit, sources, words))
            for source in sources:
                self.compiles[source] = (unit, words)

    def _ninja(self, *arguments):
        return subprocess.check_output(["ninja", "-C", self.folder, "-t", *arguments], text=True)

    def link(self, program):
        """The words that link tests/PROGRAM."""
        command = self._ninja("commands", "-s", f"tests/{program}").strip().splitlines()[-1]
        return shlex.split(command.removeprefix(": && ").removesuffix(" && :"))

    def units(self, program, folder):
        """(file, command's words) of each that has a source under `folder` and is in a library that the test program
        links."""
        libraries = {(os.path.dirname(word), os.path.basename(word)[len("lib"):-len(".a")])
                     for word in self.link(program) if word.endswith(".a")}
        return [(unit, words) for made, unit, sources, words in self._units
                if any(source.startswith(f"{folder}/") for source in sources)
                and any(made.startswith(f"{place}/CMakeFiles/{name}.dir/") for place, name in libraries)]


def instead(words, option, value):
    """The words with another value of the option."""
    at = words.index(option) + 1
    return [*words[:at], str(value), *words[at + 1:]]
