#!/usr/bin/env python3
"""Writes what the Debian packages hold beside programs: manual pages and completions, made of what
the programs themselves print for --help, the page of server.json(5), the lists of conffiles and the
changelog. Use: pages.py VERSION PROGRAMS SOURCE OUTPUT. Equal programs give equal bytes."""

import datetime
import gzip
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

from roff import from_markdown, items, page, roff

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "server/docs"))
from help import DEADLINE_S, HEADINGS, help_of, helps_below  # noqa: E402

def parts_of(helps):
    parts = []
    for section, heading in HEADINGS.items():
        lines = helps.sections.get(section)
        if not lines:
            continue
        if section in ("Positionals", "Options", "Subcommands"):
            parts.append((heading, items(helps.entries(section))))
        elif section == "Example":
            parts.append((heading, ".nf\n" + roff("\n".join(x.strip() for x in lines)) + "\n.fi"))
        else:
            parts.append((heading, roff(" ".join(x.strip() for x in lines).strip())))
    return parts


def date_of(source):
    """The day of SOURCE_DATE_EPOCH, else of the last commit; "" for sources without either."""
    if os.environ.get("SOURCE_DATE_EPOCH"):
        day = datetime.datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), datetime.timezone.utc)
        return day.strftime("%Y-%m-%d")
    done = subprocess.run(["git", "-C", source, "log", "-1", "--format=%cs"], text=True,
                          capture_output=True, timeout=DEADLINE_S)
    return done.stdout.strip()


def changelog(version, day):
    """Debian's form of it, which only names the version; NEWS.gz has what changed."""
    date = datetime.datetime.fromisoformat(day or "2026-01-01")
    return (f"myograde ({version}) bookworm; urgency=medium\n\n  * NEWS.gz lists what changed.\n\n"
            f" -- MyoGrade maintainers <maintainers@myograde.invalid>  "
            f"{date:%a, %d %b %Y} 00:00:00 +0000\n")


def one_line(text):
    return " ".join(text.split()).rstrip(".")


def program_page(command, name, section, day, see):
    helps = help_of(*command)
    text = roff(helps.summary)
    parts = [("SYNOPSIS", ".B " + roff(helps.usage)), ("DESCRIPTION", text), *parts_of(helps)]
    for words, inner in helps_below(*command) if len(command) > 1 else []:
        body = f".B {roff(inner.usage)}\n.PP\n{roff(inner.summary)}\n"
        for section_of, entries in ((x, inner.entries(x)) for x in ("Positionals", "Options")):
            if entries:
                body += items(entries) + "\n"
        parts.insert(-1, (f'"{roff(" ".join(command[1:2] + words)).upper()}"', body))
    parts.append(("SEE ALSO", ",\n".join(f".BR {roff(x)} ({y})" for x, y in see)))
    parts[-1] = ("SEE ALSO", "\n".join(f".BR {roff(x)} ({y}){',' if i + 1 < len(see) else ''}"
                                       for i, (x, y) in enumerate(see)))
    return page(name, section, one_line(helps.summary).split(";")[0], parts, day)


def described(value, path=()):
    """Each key of server.json with its default and the comment above it."""
    for key, inner in value.items():
        if key.startswith("//"):
            continue
        comment = value.get("// " + key, value.get("//" + key, ""))
        name = ".".join((*path, key))
        if isinstance(inner, dict) and any(x.startswith("//") for x in inner):
            if comment:
                yield name, comment
            yield from described(inner, (*path, key))
        else:
            default = json.dumps(inner)
            yield name, f"{comment or 'See the key above.'} (default: {default})"


def file_page(name, summary, where, body, day):
    """The page of a file: where it is, then `body` (parts), then where else to look."""
    see = [("myograded", 8), ("myograde-server.json", 5), ("myograde-track", 5), ("myograde-challenge", 5),
           ("myograde-sandbox", 5), ("myograde-policy.json", 5)]
    see.remove((name, 5))
    parts = [("SYNOPSIS", f".I {roff(where)}"), *body,
             ("SEE ALSO", "\n".join(f".BR {roff(x)} ({y}){',' if i + 1 < len(see) else ''}"
                                    for i, (x, y) in enumerate(see)))]
    return page(name, 5, summary, parts, day)


def section_of(path, first, last=None):
    """A document from the heading `first` (left out; "": from its title) to before the heading `last`.
    Ends the program with a sentence where a heading is missing."""
    text = path.read_text(encoding="utf-8")

    def place_of(heading, start):
        place = text.find(f"\n{heading}\n", start)
        if place < 0:
            raise SystemExit(f"pages.py: {path} has no heading \"{heading}\"" + (
                f" after \"{first}\"" if start else "") + "; file_pages() needs its present name")
        return place

    start = place_of(first, 0) + len(first) + 2 if first else text.index("\n") + 1
    return text[start:place_of(last, start) if last else None]


def track_sections(path):
    """What the document says of each track: its sections "## The track NAME", which follow each other."""
    headings = re.findall(r"^## The track \w+$|^## How to add a track$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return [part for first, last in zip(headings, headings[1:])
            for part in from_markdown(section_of(path, first, last), first.removeprefix("## ").upper())]


def file_pages(source, day):
    """{name: page} of each file that somebody may write."""
    configs, share = source / "configs", "/usr/share/myograde/schema"
    server = json.loads((configs / "server.json").read_text())
    strict = "An unknown key is an error; keys that begin with \"//\" are comments. "
    schema = lambda name: f"A JSON Schema for editors is in {share}/{name}.json."
    start = lambda text: ("DESCRIPTION", roff(text))
    pages = {
        "myograde-server.json": ("configuration of the MyoGrade daemon", "/etc/myograde/server.json", [
            start("The file is one JSON object. " + strict + "The daemon reads it when it starts. "
                  + schema("server")), ("KEYS", items(described(server))),
            *from_markdown(section_of(configs / "README.md", "## Listening on the network", "## Track configs"),
                           "LISTENING ON THE NETWORK")]),
        "myograde-track": ("config of a MyoGrade track", "/etc/myograde/tracks/NAME.json", [
            start("What a result depends on, beside the submission and the grader's build. " + strict
                  + schema("track")),
            *from_markdown(section_of(configs / "README.md", "## Track configs", "## Reference episodes"),
                           "FORM AND KEYS"),
            *track_sections(configs / "README.md")]),
        "myograde-challenge": ("a challenge of the MyoGrade server", "/etc/myograde/challenges/NAME.json", [
            start("Phases with seeds, times and quotas of their own. " + schema("challenge")),
            *from_markdown(section_of(configs / "challenges/README.md", ""), "FORM AND KEYS")]),
        "myograde-sandbox": (
            "what the sandboxes of the MyoGrade server allow",
            "/etc/myograde/sandbox/policy.json, /etc/myograde/sandbox/sim.json",
            [start("The two files set the sandbox of the policy's and of the simulator's processes. " + strict),
             *((f"KEYS OF {name.upper()}.JSON",
                items(described(json.loads((configs / f"sandbox/{name}.json").read_text()))))
               for name in ("policy", "sim"))]),
        "myograde-policy.json": ("what a submission to MyoGrade says of itself", "policy.json", [
            *from_markdown(section_of(source / "server/artefact/README.md", ""), "DESCRIPTION")]),
    }
    return {f"man5/{name}.5": file_page(name, summary, where, body, day)
            for name, (summary, where, body) in pages.items()}


def compress(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as raw, gzip.GzipFile("", "wb", 9, raw, mtime=0) as packed:
        packed.write(text.encode())


def values_of(source):
    """Options whose values can be known, with the shell's command that prints these, in double quotes and
    without single ones."""
    tracks = [json.loads(file.read_text()) for file in sorted((source / "configs/tracks").glob("*.json"))]
    profiles = sorted({profile for track in tracks for profile in track.get("profiles", {})})
    return {"--track": 'ls "${MYOGRADE_CONFIG_DIR:-/usr/share/myograde/configs}/tracks" 2>/dev/null'
                       ' | sed -n "s/[.]json$//p"',
            "--profile": f'printf "%s\\n" {" ".join(profiles)}',
            # The daemon knows; one that does not answer keeps nobody waiting.
            "--phase": 'timeout 2 myograde phase status --json 2>/dev/null | grep -Eo '
                       '"\\"phase\\": *\\"[^\\"]+" | sed "s/.*\\"//"'}


def completions(tree, verbs, values):
    """tree: {the words of a verb: Help}; values: of values_of. Returns what each shell reads."""
    def words(helps):
        return [name for names, _, _ in helps.options() for name in names] + helps.verbs()

    quote = lambda text: "'" + text.replace("'", "'\\''") + "'"
    deepest = max(name.count(" ") for name in tree)
    pattern_of = lambda name: quote(name) + ("" if name.count(" ") == deepest else "\\ *")
    bash = ["# Completion of myograde for bash.", "_myograde() {",
            "  local word=${COMP_WORDS[COMP_CWORD]} verb words",
            "  verb=\"" + " ".join(f"${{COMP_WORDS[{i + 1}]:-}}" for i in range(deepest + 1)) + "\"",
            "  if [ \"$COMP_CWORD\" = 1 ]; then",
            f"    words={quote(' '.join(verbs + ['--help', '--version']))}", "  else",
            "    case $verb in"]
    for name, helps in sorted(tree.items(), key=lambda item: -item[0].count(" ")):
        bash.append(f"      {pattern_of(name)}) words={quote(' '.join(words(helps)))} ;;")
    bash += ["    esac", "  fi", "  case ${COMP_WORDS[COMP_CWORD-1]} in"]
    bash += [f"    {option}) words=$(sh -c {quote(command)}) ;;" for option, command in values.items()]
    bash += ["  esac", "  COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))",
             "  if [ ${#COMPREPLY[@]} = 0 ]; then",
             "    compopt -o default 2>/dev/null", "  fi", "}", "complete -F _myograde myograde"]
    zsh = ["#compdef myograde", "local -a names", "if (( CURRENT == 2 )); then", "  names=("]
    zsh += [f"    {quote(verb + ':' + one_line(tree[verb].summary).replace(':', ' -'))}" for verb in verbs]
    zsh += ["  )", "  _describe verb names", "  return", "fi",
            "case \"" + " ".join(f"$words[{i + 2}]" for i in range(deepest + 1)) + "\" in"]
    for name, helps in sorted(tree.items(), key=lambda item: -item[0].count(" ")):
        zsh.append(f"  {pattern_of(name)}) names=({' '.join(map(quote, words(helps)))}) ;;")
    zsh += ["esac", "case \"$words[CURRENT-1]\" in"]
    zsh += [f"  {option}) names=(${{(f)\"$(sh -c {quote(command)})\"}}); compadd -a names; return ;;"
            for option, command in values.items()]
    zsh += ["esac", "compadd -a names", "_files"]
    fish = ["# Completion of myograde for fish.",
            f"set -l verbs {' '.join(verbs)}"]
    for verb in verbs:
        fish.append("complete -c myograde -n \"not __fish_seen_subcommand_from $verbs\" -f -a "
                    f"{verb} -d {quote(one_line(tree[verb].summary))}")
    for name, helps in tree.items():
        condition = " and ".join(f"__fish_seen_subcommand_from {x}" for x in name.split())
        condition = condition.replace(" and ", "; and ")
        for names, takes, meaning in helps.options():
            flags = " ".join(f"-l {x[2:]}" if x.startswith("--") else f"-s {x[1:]}" for x in names)
            known = next((values[name] for name in names if name in values), None)
            # fish reads it twice, with a rule of its own for backslashes.
            inner = f"(sh -c '{known}')".replace("\\", "\\\\").replace("'", "\\'")
            taken = f" -x -a '{inner}'" if known else " -r"
            fish.append(f"complete -c myograde -n '{condition}' {flags}{taken if takes else ''} "
                        f"-d {quote(one_line(meaning)[:80])}")
        for sub in helps.verbs():
            fish.append(f"complete -c myograde -n '{condition}' -f -a {sub}")
    return {"bash": bash, "zsh": zsh, "fish": fish}


def main():
    programs, source, output = map(pathlib.Path, sys.argv[2:])
    shutil.rmtree(output, ignore_errors=True)
    stamp = date_of(source)
    program = str(programs / "myograde")
    top = help_of(program)
    tree = {" ".join(words): helps for words, helps in helps_below(program)}
    verbs = top.verbs()
    pages = {f"man1/myograde-{verb}.1": program_page([program, verb], f"myograde-{verb}", 1, stamp,
                                                     [("myograde", 1), ("myograded", 8)])
             for verb in verbs}
    pages["man1/myograde.1"] = program_page([program], "myograde", 1, stamp,
                                            [("myograde-submit", 1), ("myograded", 8)])
    pages["man8/myograded.8"] = program_page([str(programs / "myograded")], "myograded", 8, stamp,
                                             [("myograde-server.json", 5), ("myograde-setup", 8)])
    setup = (source / "docker/debian/myograde-setup").read_text()
    usage = re.search(r"<<'USAGE'\n(.*?)^USAGE$", setup, re.S | re.M)[1]
    pages["man8/myograde-setup.8"] = page(
        "myograde-setup", 8, "make an installed MyoGrade ready to grade",
        [("DESCRIPTION", ".nf\n" + roff(usage) + "\n.fi")], stamp)
    pages |= file_pages(source, stamp)
    for name, text in pages.items():
        compress(output / (name + ".gz"), text)
    for shell, lines in completions(tree, verbs, values_of(source)).items():
        (output / "completion").mkdir(exist_ok=True)
        (output / "completion" / shell).write_text("\n".join(lines) + "\n")
    compress(output / "NEWS.gz", (source / "CHANGELOG.md").read_text())
    compress(output / "changelog.gz", changelog(sys.argv[1], stamp))
    conffiles = {
        "client": [f"/etc/myograde/tracks/{x.name}" for x in (source / "configs/tracks").glob("*.json")],
        "server": ["/etc/myograde/server.json", "/etc/logrotate.d/myograde",
                   *(f"/etc/myograde/sandbox/{x.name}" for x in (source / "configs/sandbox").glob("*.json"))]}
    for name, paths in conffiles.items():
        folder = output / "control" / name
        folder.mkdir(parents=True)
        (folder / "conffiles").write_text("".join(f"{path}\n" for path in sorted(paths)))


if __name__ == "__main__":
    main()
