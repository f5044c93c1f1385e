"""Compiles one changed source, links it into a test program in place of the original, and runs that. Neither sources
nor build folder change, so that a run that is broken off leaves nothing behind."""

import os
import pathlib
import re
import resource
import signal
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from support.build_commands import BuildCommands, instead  # noqa: E402

# A mutant that allocates without end must not take the host's memory. (AddressSanitizer reserves terabytes.)
MOST_BYTES = 4 << 30


class Build:
    """A build folder with the test programs in it."""

    def __init__(self, folder, programs, extra=()):
        """`extra` are options for the compilation of mutants, after those of the build."""
        self.folder, self.extra = pathlib.Path(folder), list(extra)
        commands = BuildCommands(folder)
        self.compiles = commands.compiles
        self.preambles = {}
        self.links = {program: commands.link(program) for program in programs}

    def prepare(self, source, folder):
        """Compiles what the source includes, once for all of its mutants: that is most of a compilation."""
        includes = re.findall(r"^#include .*", source.read_text(), re.MULTILINE)
        header = pathlib.Path(folder, source.relative_to(ROOT).as_posix().replace("/", "_") + ".h")
        header.write_text("\n".join(includes) + "\n")
        words = self.compiles[str(source)][1]
        begin, at = words.index("-MD"), words.index("-c")
        subprocess.run([*words[:begin], *words[at + 2:], "-w", *self.extra, "-x", "c++-header", header,
                        "-o", f"{header}.gch"], cwd=self.folder, check=True,
                       env={**os.environ, "CCACHE_DISABLE": "1"})
        self.preambles[source] = header

    def compile(self, source, changed, folder, options=()):
        """Makes folder/mutant.o with the changed text in place of the source; "" or what is wrong."""
        unit, words = self.compiles[str(source)]
        mutant = folder / "mutant.cc"
        mutant.write_text(changed)
        if unit != source:
            together = folder / "together.cc"
            together.write_text(unit.read_text().replace(f'"{source}"', f'"{mutant}"'))
            mutant = together
        words = instead(instead(words, "-c", mutant), "-o", f"{folder}/mutant.o")
        for option in {"-MF", "-MT"} & set(words):
            words = instead(words, option, f"{folder}/mutant.d")
        # Unused names are no mistake of a mutant's. Nobody compiles it twice, so it is not worth keeping.
        words += ["-w", *self.extra, *options]
        if source in self.preambles and not options:
            words += ["-include", str(self.preambles[source])]
        done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, check=False,
                              env={**os.environ, "CCACHE_DISABLE": "1"})
        return "" if done.returncode == 0 else done.stderr[:2000]

    def link(self, program, folder):
        """Makes folder/test of the program with folder/mutant.o; "" or what is wrong."""
        words = instead(self.links[program], "-o", f"{folder}/test")
        # An object before the archives: the archive's own is not asked for any more.
        words.insert(words.index("-o"), f"{folder}/mutant.o")
        done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, check=False)
        return done.stderr[:2000] if done.returncode else ""

    def same_code(self, source, changed):
        """Whether the optimizing compiler makes the same of both texts."""
        objects = []
        for text in (source.read_text(), changed):
            with tempfile.TemporaryDirectory() as folder:
                options = ("-O2", f"-ffile-prefix-map={folder}=.", "-frandom-seed=1")
                if self.compile(source, text, pathlib.Path(folder), options):
                    return False
                objects.append(pathlib.Path(folder, "mutant.o").read_bytes())
        return objects[0] == objects[1]


def run(folder, arguments, environment, seconds, limited):
    """"killed", "timeout" or "SURVIVES": what folder/test says. The seconds are of the processor if the test is
    limited, so that a busy host kills no mutant."""
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    try:
        done = subprocess.run([f"{folder}/test", *arguments], cwd=folder, capture_output=True, text=True,
                              timeout=seconds * (20 if limited else 1), check=False,
                              env={**os.environ, **environment}, preexec_fn=limit if limited else None)
    except subprocess.TimeoutExpired:
        return "timeout"
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return "timeout"
    return "killed" if done.returncode else "SURVIVES"
