#!/usr/bin/env python3
"""Takes single checks out of the code and asks whether a test notices: of what may be removed
(Writer::Remove, Retention), of what is accepted (admission, quotas), and of what is done with a
damaged row. Each mutant is one textual change; its file is compiled beside the tree and linked into
one test program in place of the original, so neither sources nor build folder change. Prints a
line for each; exit status 1 if one survives, or no longer fits its file.

Use: run.py --build build/asan [WORD ...]   only mutants with one of the words in their line
     run.py --fits                          only whether each still has its place in its file
     run.py --every 50 [--first K]          instead every 50th, from the Kth on, of all that operators.py makes
                                            of scoring/ and server/scheduler/"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

import operators

ROOT = pathlib.Path(__file__).resolve().parents[2]
STORE, ENGINE = "server/store/", "server/engine/"

# Test program, what of it to run, file, the text, what stands in its place.
MUTANTS = [
    # What may be removed.
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", "if (select.executeStep()) return false;", ""),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", "e.finished_at IS NOT NULL AND ", "TRUE AND "),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", "s.ranked = 0 OR ", ""),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc",
     "OR e.state IN ('failed', 'cancelled', 'grader_error')", ""),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", "'failed', 'cancelled', 'grader_error')) AND NOT",
     "'done', 'failed', 'cancelled', 'grader_error')) AND NOT"),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", 'WHERE s.artefact = ?1 AND ", kOver',
     'WHERE s.artefact = ?1 AND NOT ", kOver'),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", 'kLogOfEpisode, ") = ?1 AND ", kOver',
     'kLogOfEpisode, ") = ?1 AND NOT ", kOver'),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", '") IS NULL AND instr(p.facts_json, ?1) > 0',
     '") IS NULL AND instr(p.facts_json, ?1) < 0'),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", "if (end - begin == 64) hashes", "if (end - begin == 63) hashes"),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", "  insert.exec();\n  return true;", "  return true;"),
    ("store_test", "RemovalTest.*", STORE + "store_files.cc", 'upload || kind == "artefact"',
     'upload || kind != "artefact"'),
    ("store_test", "UploadsTest.*:RerunsTest.*", STORE + "store_files.cc",
     "if (taken.exec() == 0 && upload) return false;", "taken.exec();"),
    ("store_test", "UploadsTest.*:RerunsTest.*", STORE + "store_files.cc",
     "if (taken.exec() == 0 && upload) return false;", "if (upload) return false;"),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "if (file.needed) continue;", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "if (unused > age)", "if (unused > age * 100)"),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "else if (sum > bytes)", "else if (false)"),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "    sum -= file.bytes;\n", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "needed.contains(file.name) || ", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", " || file.last_use > old", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc",
     "file.last_use = std::max(file.last_use, ChangedAt(file.path));", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc",
     "if (name.size() <= kHashDigits || name[kHashDigits] != '.') continue;", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "logs = WithNeeded(*std::move(logs));", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc",
     "if (*removed && rename(from.c_str(), to.c_str()) != 0", "if (rename(from.c_str(), to.c_str()) != 0"),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "fs::remove_all(to, error);", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "if (!fs::exists(file.path, error)) continue;", ""),
    # What is accepted.
    ("engine_test", "*AreGone*", ENGINE + "engine_requests.cc",
     "HasArtefactFiles(data_dir_, submission.artefact)", "absl::OkStatus()"),
    ("engine_test", "*AreGone*", ENGINE + "engine_requests.cc",
     "HasArtefactFiles(data_dir_, rerun.artefact)", "absl::OkStatus()"),
    ("store_test", "*", STORE + "admission.cc", "if (!artefact.executeStep())", "if (false)"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc", "if (first->has_value()) return **first;", ""),
    ("store_test", "QuotaTest.*", STORE + "admission.cc", "  if (submission.ranked) {\n", "  if (true) {\n"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc", "e.state != 'grader_error' AND ", ""),
    ("store_test", "QuotaTest.*", STORE + "admission.cc",
     "(e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)) ", "TRUE "),
    ("store_test", "QuotaTest.*", STORE + "admission.cc",
     "e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)",
     "e.state != 'cancelled'"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc", "AND s.ranked = 1 AND", "AND"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc", "AND s.config = ? AND", "AND ? != '' AND"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc",
     "if (!rules.one_for_everyone) return std::optional<Accepted>();", ""),
    ("store_test", "QuotaTest.*", STORE + "admission.cc",
     "if (!any.executeStep()) return std::optional<Accepted>();", "return std::optional<Accepted>();"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc",
     "CheckQuota(use, rules.quota, budget, submission.team, submission.track,\n                     submission.phase)",
     "absl::OkStatus()"),
    ("store_test", "QuotaTest.*", STORE + "admission.cc",
     "if (absl::Status status = AddContent(db_, submission, now_ms_); !status.ok()) return status;",
     "(void)AddContent(db_, submission, now_ms_);"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "if (use.waiting >= limits.waiting)", "if (false)"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "use.waiting >= limits.waiting", "use.waiting > limits.waiting"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.left(allowance.total) < 1", "sum.left(allowance.total) < 0"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.left(allowance.per_day) < 1", "sum.left(allowance.per_day) < 0"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "  return CheckBudget(use, limits, Budget::kFailed, team, place);\n",
     "  return absl::OkStatus();\n"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "std::max(select.getColumn(0).getInt64(), now_ms / kDayMs)",
     "now_ms / kDayMs"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.charged -= amount;", ";"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "use.total[Index(*budget)].open += 1;", ""),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "if (!budget || select.getColumn(3).getInt() != 0) continue;",
     "if (!budget) continue;"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "amount BETWEEN 1 AND ?", "amount < ?"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "admission WHERE day <= ?1", "admission WHERE day != ?1"),
    # What is done with a damaged row.
    ("engine_test", "-*ADamagedRow*", ENGINE + "engine_core.cc",
     "if (!status.ok()) GiveUpUnreadable(entry.evaluation, std::string(status.message()));",
     "if (!status.ok()) return status;"),
    ("engine_test", "-*ADamagedRow*", ENGINE + "engine_recover.cc",
     "  if (!loaded.ok()) {\n    GiveUpUnreadable(id, std::string(loaded.status().message()));\n    return absl::OkStatus();\n  }",
     "  if (!loaded.ok()) return loaded.status();"),
    ("engine_test", "-*ADamagedRow*", STORE + "reader.cc",
     'if (row.ok() && Sha256Hex(text) != hash)', 'if (false)'),
    ("engine_test", "-*ADamagedRow*", ENGINE + "engine_ends.cc", "  deferred_.erase(evaluation);\n", ""),
]


def commands(build):
    """Source -> (the file that is compiled with it in it, its command); target -> its link
    command. A build may compile many sources together, in a file that includes them."""
    compdb = json.loads(subprocess.check_output(["ninja", "-C", build, "-t", "compdb"], text=True))
    compiles = {}
    for entry in compdb:
        if " -c " not in entry["command"]:
            continue
        unit = pathlib.Path(build, entry["file"])
        compiles[str(unit)] = (unit, entry["command"])
        if "/Unity/" in str(unit):
            for source in re.findall(r'#include "([^"]+)"', unit.read_text()):
                compiles[source] = (unit, entry["command"])
    links = {}
    for target in {mutant[0] for mutant in MUTANTS} | set(operators.AREAS.values()):
        out = subprocess.check_output(["ninja", "-C", build, "-t", "commands", "-s",
                                       f"tests/{target}"], text=True)
        links[target] = out.strip().splitlines()[-1]
    return compiles, links


def compile_mutant(source, changed, folder, build, compiles):
    """Makes folder/mutant.o with the changed text in place of the source; "" or what is wrong."""
    unit, command = compiles[str(source)]
    mutant = folder / "mutant.cc"
    mutant.write_text(changed)
    if unit != source:
        together = folder / "together.cc"
        together.write_text(unit.read_text().replace(f'"{source}"', f'"{mutant}"'))
        mutant = together
    words = shlex.split(command)
    words[words.index("-c") + 1] = str(mutant)
    words[words.index("-o") + 1] = f"{folder}/mutant.o"
    for option in ("-MF", "-MT"):
        if option in words:
            words[words.index(option) + 1] = f"{folder}/mutant.d"
    # Unused names are no mistake of a mutant's, and sanitizers look for none.
    words += ["-O0", "-w", "-fno-sanitize=all"]
    done = subprocess.run(words, cwd=build, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stderr[:2000]


def try_mutant(mutant, build, compiles, links):
    """"killed", or what is wrong."""
    target, tests, file, text, instead = mutant
    source = ROOT / file
    if source.read_text().count(text) != 1:
        return f"the text is there {source.read_text().count(text)} times"
    return try_change(target, tests, source, source.read_text().replace(text, instead), build, compiles,
                      links)


def try_made(mutant, build, compiles, links):
    """The same of a mutant of operators.py; one that does not compile is none."""
    target, file, number, _, changed = mutant
    lines = (ROOT / file).read_text().split("\n")
    lines[number] = changed
    result = try_change(target, "*", ROOT / file, "\n".join(lines), build, compiles, links)
    return "no code" if result.startswith("does not compile") else result


def try_change(target, tests, source, changed, build, compiles, links):
    """What the test program says with the changed text in place of the source."""
    with tempfile.TemporaryDirectory() as folder:
        wrong = compile_mutant(source, changed, pathlib.Path(folder), build, compiles)
        if wrong:
            return "does not compile: " + wrong
        # An object before the archives: the archive's own is not asked for any more.
        link = links[target].replace(" -o ", f" {folder}/mutant.o -o ", 1)
        words = shlex.split(link.removeprefix(": && ").removesuffix(" && :"))
        words[words.index("-o") + 1] = f"{folder}/test"
        done = subprocess.run(words, cwd=build, capture_output=True, text=True, check=False)
        if done.returncode:
            return "does not link: " + done.stderr[:2000]
        try:
            # The one object without a sanitizer does not mark its containers' ends.
            done = subprocess.run([f"{folder}/test", f"--gtest_filter={tests}"], cwd=folder,
                                  capture_output=True, text=True, timeout=600, check=False,
                                  env={**os.environ,
                                       "ASAN_OPTIONS": "detect_container_overflow=0",
                                       "RC_PARAMS": "max_success=150"})
        except subprocess.TimeoutExpired:
            return "killed"
        return "killed" if done.returncode else "SURVIVES"


def misfits():
    """The mutants whose text is not in their file, or there more than once."""
    texts = {mutant[2]: (ROOT / mutant[2]).read_text(encoding="utf-8") for mutant in MUTANTS}
    return [mutant for mutant in MUTANTS if texts[mutant[2]].count(mutant[3]) != 1]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build/asan", help="a build folder with the tests in it")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--every", type=int, help="try every Nth mutant of operators.py instead")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--fits", action="store_true")
    options = parser.parse_args()
    if options.fits:
        for mutant in misfits():
            print(f"{mutant[2]} does not have once: {mutant[3]}")
        return 1 if misfits() else 0
    build = str((ROOT / options.build).resolve())
    compiles, links = commands(build)
    if options.every:
        wanted, attempt = operators.sample(options.every, options.first), try_made
        describe = lambda m: f"{m[1]}:{m[2] + 1}: {m[3].strip()}  ->  {m[4].strip()}"
    else:
        wanted = [m for m in MUTANTS if not options.words or any(w in " ".join(m) for w in options.words)]
        attempt, describe = try_mutant, lambda m: f"{m[2]}: {' '.join(m[3].split())[:90]}"
    alive = 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        results = pool.map(lambda m: attempt(m, build, compiles, links), wanted)
        for mutant, result in zip(wanted, results):
            print(f"{result:8} {describe(mutant)}", flush=True)
            alive += result not in ("killed", "no code")
    print(f"{len(wanted) - alive} of {len(wanted)} mutants are killed")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
