#!/usr/bin/env python3
"""Checks what the compiler does not: who may include and link whom, directly or through others, the
length of files, marks of unfinished work, that every test is built, that ./dev knows each verb that
its help names, that nothing strays into the root folder, and that nothing is timed by the calendar.
Prints one line per mistake; exit status 1 if there is one. Use: lint.py ROOT"""

import pathlib
import re
import subprocess
import sys

MAX_LINES = 450
PARTS = {"protocol", "scoring", "sim", "server", "policies", "tests"}
# All that may lie in the root: the parts, and what tools look for there.
ROOT = PARTS | {"configs", "docker", "CMakeLists.txt", "CMakePresets.json", "README.md",
                "CHANGELOG.md", "LICENSE", "dev", ".ci", ".clang-format", ".clang-tidy",
                ".dockerignore", ".gitignore"}

# Folder -> (folders of the project it may include, patterns of foreign headers it must not).
# The longest matching folder counts.
RULES = {
    "protocol/base": ({"protocol/base"}, r"lcm/|mujoco/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/"),
    "protocol/policy": ({"protocol/base", "protocol/policy"},
                        r"nlohmann/|mujoco/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|archive"),
    "protocol/tracks": ({"protocol/base", "protocol/policy", "protocol/tracks"},
                        r"lcm/|mujoco/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|archive"),
    "protocol/lease": ({"protocol/base", "protocol/policy", "protocol/tracks", "protocol/lease"},
                       r"lcm/|mujoco/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|archive"),
    "protocol/log": ({"protocol/base", "protocol/policy", "protocol/tracks", "protocol/lease",
                      "protocol/log"},
                     r"mujoco/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|archive"),
    "protocol": ({"protocol"}, r"mujoco/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|archive"),
    "sim": ({"protocol", "sim"}, r"SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|archive|lcm/"),
    # What a track is judged by is read from its config, so JSON is not foreign here.
    "scoring": ({"protocol/base", "protocol/tracks/episode_facts.h", "scoring"},
                r"lcm/|mujoco/|openssl/|SQLiteCpp/|sqlite3|boost/|CLI/|spdlog/|"
                r"absl/time|absl/random|chrono$|random$|fstream$|filesystem$|ctime$|unistd"),
    "server/base": ({"protocol/base", "server/base"}, r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    # Who may do what is a function of values.
    "server/access": ({"protocol/base", "server/base", "server/store/rows.h", "server/access"},
                      r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/|spdlog/|chrono$|fstream$|filesystem$|"
                      r"unistd"),
    "server/metrics": ({"protocol/base", "server/metrics"},
                       r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/|spdlog/"),
    # No HTTP server: it only calls others.
    "server/webhook": ({"protocol/base", "server/base", "server/metrics", "server/config",
                        "server/store", "server/webhook"}, r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    "server/runtime": ({"protocol/base", "server/base", "server/artefact/listing.h",
                        "server/runtime"}, r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/|spdlog/"),
    "server/scheduler": ({"protocol/base", "server/base", "server/scheduler"},
                         r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/|fstream$|filesystem$|unistd"),
    # What counts is a function of acts.
    "server/board": ({"protocol/base", "server/base/plain_text.h", "server/base/json_value.h",
                      "server/base/enum_names.h", "server/board"},
                     r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/|spdlog/|chrono$|fstream$|filesystem$|"
                     r"unistd"),
    "server/store": ({"protocol", "server/base", "server/config/limits.h",
                      "server/config/webhook_config.h", "server/board", "server/store"}, r"mujoco/|lcm/|boost/|CLI/"),
    "server/config": ({"protocol", "scoring/statistics_config.h", "server/base", "server/access",
                       "server/scheduler", "server/config"}, r"mujoco/|lcm/|boost/|CLI/"),
    # Who is connected and what they ask; it knows no address of the API.
    "server/http": ({"protocol/base", "server/base", "server/access/access.h",
                     "server/access/rate_limit.h", "server/config/server_config.h", "server/http"},
                    r"mujoco/|lcm/|SQLiteCpp/|CLI/"),
    "server/grading": ({"protocol", "scoring", "server/base", "server/board", "server/store", "server/proof",
                        "server/grading"}, r"mujoco/|lcm/|boost/|CLI/|fstream$|filesystem$|unistd"),
    "server/challenge": ({"protocol", "scoring"} | {f"server/{part}" for part in (
        "base", "access", "board", "proof/seed_list.h", "store", "grading", "challenge")},
        r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/|fstream$|unistd"),
    "server/engine": ({"protocol", "scoring"} | {f"server/{part}" for part in (
        "base", "metrics", "artefact", "runtime", "sandbox", "runner", "executor", "proof", "scheduler",
        "board", "store", "config", "grading", "engine")}, r"mujoco/|lcm/|boost/|CLI/"),
    # Where leases run; it decides nothing, and knows neither evaluations nor boards.
    "server/executor": ({"protocol"} | {f"server/{part}" for part in (
        "base", "artefact", "runtime", "sandbox", "runner", "proof", "config/slurm_config.h",
        "executor")}, r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    # What is made of logs; no HTTP, no rights.
    "server/pictures": ({"protocol", "scoring"} | {f"server/{part}" for part in (
        "base", "runner", "proof", "store", "grading", "pictures")},
        r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    "server/admission": ({"protocol"} | {f"server/{part}" for part in (
        "base", "artefact", "runtime", "sandbox", "proof", "store", "config", "grading", "challenge",
        "engine", "admission")}, r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    "server/api": ({"protocol", "scoring"} | {f"server/{part}" for part in (
        "base", "metrics", "access", "board", "runner", "executor", "proof", "store", "config", "http", "grading",
        "challenge", "webhook", "web", "runtime", "scheduler/team_line.h", "engine", "pictures", "admission", "api")},
        r"mujoco/|lcm/|SQLiteCpp/|CLI/"),
    # What browsers are sent as it is.
    "server/web": ({"server/web"}, r"absl/|nlohmann/|mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    "server/cli/terminal": ({"protocol/base", "server/base", "server/cli/terminal"},
                            r"mujoco/|lcm/|SQLiteCpp/|boost/|CLI/"),
    "server/cli/base": ({"protocol/base", "protocol/lease", "server/base", "server/cli/terminal",
                         "server/cli/base"}, r"mujoco/|lcm/|SQLiteCpp/|boost/"),
    "server/cli/client": ({"protocol", "server/base", "server/artefact/artefact.h", "server/board/acts.h",
                           "server/proof/logs.h", "server/proof/merkle_tree.h",
                           "server/proof/record_head.h",
                           "server/store/transfer.h"} | {f"server/cli/{part}" for part in (
                               "terminal", "base", "client")}, r"mujoco/|lcm/|SQLiteCpp/"),
    "server/cli/offline": ({"protocol", "scoring"} | {f"server/{part}" for part in (
        "base", "artefact", "runtime", "sandbox", "runner", "executor/slurm/srun.h", "proof",
        "scheduler", "board", "store", "config", "grading", "challenge", "engine", "cli")}, r"mujoco/|lcm/|SQLiteCpp/|boost/"),
    "server/cli": ({"protocol/tracks/registry.h", "server/cli"},
                   r"mujoco/|lcm/|SQLiteCpp/|boost/"),
    "server": ({"protocol", "scoring", "server"}, r"mujoco/|lcm/"),
    "policies": ({"protocol", "policies"}, r"mujoco/|SQLiteCpp/|sqlite3|boost/|spdlog/"),
    "tests": (PARTS, r"$^"),
}
# Targets of the project that a folder must not link.
FORBIDDEN_LINKS = {
    "protocol": r"myograde_(sim|scoring|mujoco)\b",
    "sim": r"myograde_(scoring|store|runner|sandbox|engine|grading)\b|SQLiteCpp|SQLite",
    "scoring": r"myograde_(sim|lease|episode_log|store|mujoco)\b|LCM|SQLite",
    "server": r"myograde_(sim|mujoco)\b|PkgConfig::LCM",
    "policies": r"myograde_(sim|lease|scoring|store|mujoco)\b",
}
# Targets that a target must not even reach through others.
FORBIDDEN_REACH = {
    "myograde_cli_terminal": r"myograde_(cli_base|cli_client|cli_offline|store|lease)$|CLI11",
    "myograde_cli_base": r"myograde_(cli_client|cli_offline|store|episode_log)$",
    "myograde_cli_client":
        r"myograde_(cli_offline|engine|grading|proof|runner|sandbox|scheduler|scoring)$",
}
# The calendar can be set while a deadline runs, so whatever waits or measures counts on the
# monotonic clock (protocol/base/clock.h). These files alone may ask for the date, and why.
CALENDAR = re.compile(r"absl::Now\(|\b(system_clock|high_resolution_clock|file_clock)\b|"
                      r"\bgettimeofday\(|\bCLOCK_REALTIME|\btime\((NULL|nullptr|0|&\w+)\)|"
                      r"\b(\w*[cC]lock_?|SystemClock\(\))\.Now\(\)|"
                      r"\btime\.time(_ns)?\(|\bdate(time)?\.(now|utcnow|today)\(")
CALENDAR_USERS = {
    "policies/python/myograde/connect/worker.py": "the server keeps the keys of requests for a day",
    "protocol/base/clock.cc": "is the port",
    "server/admission/admission.cc": "quotas are of a day, phases open and close at a date",
    "server/api/access_resource.cc": "tokens expire by the calendar",
    "server/api/board_source.cc": "phases freeze at a date, and boards are asked for as of one",
    "server/api/challenges_resource.cc": "phases open and close at a date",
    "server/api/metrics_resource.cc": "compares with stored times of day",
    "server/api/guard.cc": "tokens expire at a time of day",
    "server/api/seeds_resource.cc": "phases close at a date",
    "server/api/submissions_resource.cc": "shows times of day",
    "server/api/teams_resource.cc": "quotas are of a day",
    "server/api/views.cc": "shows times of day",
    "server/cli/offline/challenge.cc": "warns of dates in the past",
    "server/cli/offline/cluster_checks.cc": "compares a node's clock with this host's",
    "server/daemon/daemon.cc": "shows when it started",
    "server/daemon/main.cc": "stamps a line of the log",
    "server/engine/engine_leases.cc": "stores when an attempt began, ended and will be over, for people",
    "server/engine/retention.cc": "compares with stored times of day",
    "server/runtime/make/make_runtime.py": "stamps a runtime",
    "server/store/store.cc": "stamps rows",
    "server/webhook/sender.cc": "signs times of day, and compares with stored ones",
    "tests/bench/latency_policy.cc": "is compared with stored times of day",
    "tests/integration/shifted_calendar.c": "shifts it",
    "tests/integration/soak.py": "draws a seed",
    "tests/lint/lint.py": "names them",
    "tests/redteam/programs/c44_guesses_seeds.py": "prints it, to see that no result hangs on it",
    "tests/server/admission/submit_phase_test.cc": "sets it",
    "tests/server/api/board_moments_test.cc": "compares with stored times of day",
    "tests/server/admission/calendar_watch_test.cc": "sets it",
    "tests/server/daemon/phases_test.py": "phases open and close at a date",
    "tests/server/web/home_browser_test.py": "its phases open and close at a date",
    "tests/server/daemon/secrets_test.py": "sets dates in a challenge file",
    "tests/server/engine/retention_test.cc": "compares with times of files",
    "tests/server/openapi/world.py": "sets dates in a challenge file",
    "tests/server/store/people_fixture.h": "compares with stored times of day",
    "tests/server/store/phases_test.cc": "compares with stored times of day",
    "tests/server/store/quota_test.cc": "compares with stored times of day",
    "tests/server/store/tokens_test.cc": "compares with stored times of day",
    "tests/support/waiting.py": "a team's units of a day come back at midnight",
}
# A track lives in folders of its own name (protocol/tracks/<track>, sim/<track>, scoring/<track>).
# These files list the tracks; nothing else in these parts names one.
TRACKS = {folder.name for folder in pathlib.Path(__file__).parents[2].glob("protocol/tracks/*/")}
TRACKLESS = {"protocol", "sim", "scoring", "server"}
# arm.h has a joint of a track's name.
REGISTRIES = {"protocol/tracks/arm.h", "protocol/tracks/CMakeLists.txt", "protocol/tracks/episode_details.h",
              "protocol/tracks/episode_facts.h", "protocol/tracks/registry.cc",
              "scoring/CMakeLists.txt", "scoring/track.cc", "sim/CMakeLists.txt", "sim/tracks.cc"}
IDENTIFIER = re.compile(r"\w+")
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
QUOTES = ('"', "'", "`")
QUOTED = re.compile(r"[\w.:-]*$")  # the part of a name without spaces before one of its words
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', re.MULTILINE)
# It throws where reading fails, which a file of /proc does whose process has ended.
THROWING_READ = re.compile(r"istreambuf_iterator")
LOOSE_PROPERTY = re.compile(r"^\s*rc::check\(", re.MULTILINE)
UNFINISHED = re.compile(r"\b(TO" r"DO|FIX" r"ME|XX" r"X)\b")


def folder_rule(path):
    fits = [folder for folder in RULES if path.startswith(folder + "/")]
    return max(fits, key=len) if fits else None


def check_includes(path, text):
    folder = folder_rule(path)
    if folder is None:
        return
    allowed, foreign = RULES[folder]
    for header in INCLUDE.findall(text):
        own = header.split("/")[0] in PARTS and "/" in header
        if own and not any(header == part or header.startswith(part + "/") for part in allowed):
            yield f"includes {header}, which {folder}/ must not"
        elif not own and re.match(foreign, header):
            yield f"includes <{header}>, which {folder}/ must not"


def words_of(identifier):
    """["k", "hand", "facts"] of kHandFacts, hand_facts likewise."""
    return [word.lower() for word in WORD.findall(identifier)]


def names_track(path, text, name):
    """Whether `text` uses a track's name: as a part of an identifier or of a path, in quotes, as a
    namespace, alone in a list of CMake, or beside the word "track". Alone in a sentence, and within
    another word, it is English ("by hand", "Fingerprint")."""
    if path.endswith((".txt", ".cmake")):
        text = re.sub(r"#.*", "", text)
    wanted = words_of(name)
    if wanted[0] not in text.lower():
        return False
    for match in IDENTIFIER.finditer(text):
        words = words_of(match.group())
        if not any(words[i:i + len(wanted)] == wanted for i in range(len(words))):
            continue
        before, after = text[max(0, match.start() - 12):match.start()], text[match.end():][:12]
        if len(words) > len(wanted) or path.endswith((".txt", ".cmake")):
            return True
        if before.endswith(("/", "::", "namespace ")) or re.match(r"/|::|\.\w", after):
            return True
        before = QUOTED.sub("", text[max(0, match.start() - 40):match.start()])
        if before[-1:] in QUOTES and QUOTED.sub("", text[match.end():][:40][::-1])[-1:] == before[-1:]:
            return True
        if re.search(r"\btracks? $", before) or re.match(r"['’]?s? tracks?\b", after):
            return True
    return False


def check_tracks(path, text):
    folders = path.split("/")
    if folders[0] not in TRACKLESS or TRACKS & set(folders) or path in REGISTRIES:
        return
    for name in sorted(TRACKS):
        if names_track(path, text, name):
            yield f"names the track {name}, which its own folders and the registries alone may"


def check_links(path, text):
    folder = path.split("/")[0]
    if folder in FORBIDDEN_LINKS:
        text = re.sub(r"#.*", "", text)
        for match in re.finditer(r"target_link_libraries\(([^)]*)\)", text):
            for name in re.finditer(FORBIDDEN_LINKS[folder], match.group(1)):
                yield f"links {name.group(0)}, which {folder}/ must not"


def link_graph(root):
    """Of each target what it links, whether it passes it on or not: a static library needs both."""
    graph = {}
    for file in root.rglob("CMakeLists.txt"):
        text = re.sub(r"#.*", "", file.read_text(encoding="utf-8"))
        for match in re.finditer(r"target_link_libraries\(\s*(\S+)([^)]*)\)", text):
            graph.setdefault(match.group(1), set()).update(match.group(2).split())
    return graph


def check_reach(graph):
    for target, forbidden in FORBIDDEN_REACH.items():
        if target not in graph:
            yield f"{target}: is not a target any more; correct FORBIDDEN_REACH in lint.py"
        paths = {target: target}
        waiting = [target]
        while waiting:
            name = waiting.pop()
            for linked in sorted(graph.get(name, set()) - set(paths)):
                paths[linked] = f"{paths[name]} -> {linked}"
                waiting.append(linked)
                if re.match(forbidden, linked):
                    yield f"{paths[linked]}: links what {target} must not reach"


def check_file(root, file):
    path = file.relative_to(root).as_posix()
    text = file.read_text(encoding="utf-8", errors="replace")
    problems = []
    if file.suffix in (".h", ".cc", ".c", ".py", ".lcm"):
        lines = text.count("\n")
        if lines > MAX_LINES:
            problems.append(f"has {lines} lines; split it, {MAX_LINES} are the most")
    if UNFINISHED.search(text):
        problems.append("has a mark of unfinished work")
    if file.suffix in (".h", ".cc"):
        problems += check_includes(path, text)
    problems += check_tracks(path, text)
    if CALENDAR.search(text) and path not in CALENDAR_USERS:
        problems.append("asks the calendar for the time; count on the monotonic clock "
                        "(protocol/base/clock.h), or say in lint.py why it needs the date")
    if file.name == "CMakeLists.txt":
        problems += check_links(path, text)
    if THROWING_READ.search(text) and not path.startswith("tests/"):
        problems.append("reads with std::istreambuf_iterator, which throws; use ReadFile of "
                        "protocol/base/file.h")
    if LOOSE_PROPERTY.search(text):
        problems.append("has an rc::check whose result is dropped, so it can't fail: "
                        "EXPECT_TRUE it")
    if file.suffix == ".cc" and path.startswith("tests/"):
        near = [p / "CMakeLists.txt" for p in file.parents if root in (p, *p.parents)]
        lists = "".join(p.read_text() for p in near if p.exists())
        if not re.search(rf"\b{re.escape(file.name)}\b", lists):
            problems.append("is in no CMakeLists.txt, so it never runs")
    return [f"{path}: {problem}" for problem in problems]


def check_verbs(script):
    """A verb of ./dev that is only described, or only there."""
    text = script.read_text(encoding="utf-8")
    described = set(re.findall(r"^  ([a-z]+)(?= |$)", text.split("USAGE")[1], re.MULTILINE))
    known = set(re.findall(r"^  ([a-z]+)[a-z |-]*\) ", text.split("case $verb in")[1],
                           re.MULTILINE))
    return [f"dev: the verb {verb} is not both described and known"
            for verb in sorted(described ^ (known - {"help"}))]


def check_root(root):
    """What git keeps in the root folder beside ROOT, a fuzzer's findings for one. An unpacked
    archive of the sources has no git, and nothing to commit."""
    listed = subprocess.run(["git", "-C", root, "ls-files", "-z"], capture_output=True, text=True)
    entries = {path.split("/")[0] for path in listed.stdout.split("\0") if path}
    return [f"{entry}: does not belong into the root folder" for entry in sorted(entries - ROOT)]


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    suffixes = {".h", ".cc", ".c", ".py", ".lcm", ".txt", ".cmake", ".in", ".sql"}
    files = sorted(f for part in PARTS for f in (root / part).rglob("*")
                   if f.is_file() and f.suffix in suffixes)
    if not files:
        sys.exit(f"{root}: no sources found; give the project's root folder")
    problems = [problem for file in files for problem in check_file(root, file)]
    problems += check_verbs(root / "dev") + check_root(root)
    problems += check_reach({target: linked for part in sorted(PARTS)
                             for target, linked in link_graph(root / part).items()})
    print("\n".join(problems) or f"{len(files)} files, no mistakes")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
