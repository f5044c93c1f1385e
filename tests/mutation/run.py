#!/usr/bin/env python3
"""Takes single checks out of the code and asks whether a test notices: of what may be removed
(Writer::Remove, Retention), of what is accepted (admission, quotas), and of what is done with a
damaged row. Each mutant is one textual change; its file is compiled beside the tree and linked into
one test program in place of the original, so neither sources nor build folder change. Prints a
line for each; exit status 1 if one survives, or no longer fits its file.

Use: run.py --build build/asan [WORD ...]   only mutants with one of the words in their line"""

import argparse
import concurrent.futures
import json
import pathlib
import shlex
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
STORE, DAEMON = "server/store/", "server/daemon/"

# Test program, what of it to run, file, the text, what stands in its place.
MUTANTS = [
    # What may be removed.
    ("removal_test", "*", STORE + "store_files.cc", "if (select.executeStep()) return false;", ""),
    ("removal_test", "*", STORE + "store_files.cc", "e.finished_at IS NOT NULL AND ", "TRUE AND "),
    ("removal_test", "*", STORE + "store_files.cc", "s.ranked = 0 OR ", ""),
    ("removal_test", "*", STORE + "store_files.cc",
     "OR e.state IN ('failed', 'cancelled', 'grader_error')", ""),
    ("removal_test", "*", STORE + "store_files.cc", "'failed', 'cancelled', 'grader_error')))",
     "'done', 'failed', 'cancelled', 'grader_error')))"),
    ("removal_test", "*", STORE + "store_files.cc", 'WHERE s.artefact = ?1 AND ", kOver',
     'WHERE s.artefact = ?1 AND NOT ", kOver'),
    ("removal_test", "*", STORE + "store_files.cc", 'kLog, ") = ?1 AND ", kOver,\n                          " IS NOT TRUE UNION',
     'kLog, ") = ?1 AND NOT ", kOver,\n                          " IS NOT TRUE UNION'),
    ("removal_test", "*", STORE + "store_files.cc", '") IS NULL AND instr(p.facts_json, ?1) > 0',
     '") IS NULL AND instr(p.facts_json, ?1) < 0'),
    ("removal_test", "*", STORE + "store_files.cc", "if (end - begin == 64) hashes", "if (end - begin == 63) hashes"),
    ("removal_test", "*", STORE + "store_files.cc", "  insert.exec();\n  return true;", "  return true;"),
    ("removal_test", "*", STORE + "store_files.cc", 'upload || kind == "artefact"',
     'upload || kind != "artefact"'),
    ("uploads_test", "*", STORE + "store_files.cc",
     "if (taken.exec() == 0 && upload) return false;", "taken.exec();"),
    ("uploads_test", "*", STORE + "store_files.cc",
     "if (taken.exec() == 0 && upload) return false;", "if (upload) return false;"),
    ("retention_test", "*", DAEMON + "retention.cc", "if (file.needed) continue;", ""),
    ("retention_test", "*", DAEMON + "retention.cc", "if (unused > age)", "if (unused > age * 100)"),
    ("retention_test", "*", DAEMON + "retention.cc", "else if (sum > bytes)", "else if (false)"),
    ("retention_test", "*", DAEMON + "retention.cc", "    sum -= file.bytes;\n", ""),
    ("retention_test", "*", DAEMON + "retention.cc", "needed.contains(file.name) || ", ""),
    ("retention_test", "*", DAEMON + "retention.cc", " || file.last_use > old", ""),
    ("retention_test", "*", DAEMON + "retention.cc",
     "file.last_use = std::max(file.last_use, ChangedAt(file.path));", ""),
    ("retention_test", "*", DAEMON + "retention.cc",
     "if (name.size() <= kHashDigits || name[kHashDigits] != '.') continue;", ""),
    ("retention_test", "*", DAEMON + "retention.cc", "logs = WithNeeded(*std::move(logs));", ""),
    ("retention_test", "*", DAEMON + "retention.cc",
     "if (*removed && rename(from.c_str(), to.c_str()) != 0", "if (rename(from.c_str(), to.c_str()) != 0"),
    ("retention_test", "*", DAEMON + "retention.cc", "fs::remove_all(to, error);", ""),
    ("retention_test", "*", DAEMON + "retention.cc", "if (!fs::exists(file.path, error)) continue;", ""),
    # What is accepted.
    ("retention_test", "*AreGone*", DAEMON + "engine_requests.cc",
     "HasArtefactFiles(data_dir_, submission.artefact)", "absl::OkStatus()"),
    ("retention_test", "*AreGone*", DAEMON + "engine_requests.cc",
     "HasArtefactFiles(data_dir_, rerun.artefact)", "absl::OkStatus()"),
    ("store_test", "*", STORE + "admission.cc", "if (!artefact.executeStep())", "if (false)"),
    ("quota_test", "*", STORE + "admission.cc", "if (first->has_value()) return **first;", ""),
    ("quota_test", "*", STORE + "admission.cc", "  if (submission.ranked) {\n", "  if (true) {\n"),
    ("quota_test", "*", STORE + "admission.cc", "e.state != 'grader_error' AND ", ""),
    ("quota_test", "*", STORE + "admission.cc",
     "(e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)) ", "TRUE "),
    ("quota_test", "*", STORE + "admission.cc",
     "e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)",
     "e.state != 'cancelled'"),
    ("quota_test", "*", STORE + "admission.cc", "AND s.ranked = 1 AND", "AND"),
    ("quota_test", "*", STORE + "admission.cc", "AND s.config = ? AND", "AND ? != '' AND"),
    ("quota_test", "*", STORE + "admission.cc",
     "if (!rules.one_for_everyone) return std::optional<Accepted>();", ""),
    ("quota_test", "*", STORE + "admission.cc",
     "if (!any.executeStep()) return std::optional<Accepted>();", "return std::optional<Accepted>();"),
    ("quota_test", "*", STORE + "admission.cc",
     "CheckQuota(use, rules.quota, budget, submission.team, submission.track)", "absl::OkStatus()"),
    ("quota_test", "*", STORE + "admission.cc",
     "if (absl::Status status = AddContent(db_, submission, now_ms_); !status.ok()) return status;",
     "(void)AddContent(db_, submission, now_ms_);"),
    ("quota_test", "*", STORE + "quota.cc", "if (use.waiting >= limits.waiting)", "if (false)"),
    ("quota_test", "*", STORE + "quota.cc", "use.waiting >= limits.waiting", "use.waiting > limits.waiting"),
    ("quota_test", "*", STORE + "quota.cc", "sum.left(allowance.total) < 1", "sum.left(allowance.total) < 0"),
    ("quota_test", "*", STORE + "quota.cc", "sum.left(allowance.per_day) < 1", "sum.left(allowance.per_day) < 0"),
    ("quota_test", "*", STORE + "quota.cc", "  return CheckFailures(use, limits, team, track);\n",
     "  return absl::OkStatus();\n"),
    ("quota_test", "*", STORE + "quota.cc", "std::max(select.getColumn(0).getInt64(), now_ms / kDayMs)",
     "now_ms / kDayMs"),
    ("quota_test", "*", STORE + "quota.cc", "sum.charged -= amount;", ";"),
    ("quota_test", "*", STORE + "quota.cc", "use.total[Index(*budget)].open += 1;", ""),
    ("quota_test", "*", STORE + "quota.cc", "if (!budget || select.getColumn(3).getInt() != 0) continue;",
     "if (!budget) continue;"),
    ("quota_test", "*", STORE + "quota.cc", "amount BETWEEN 1 AND ?", "amount < ?"),
    ("quota_test", "*", STORE + "quota.cc", "admission WHERE day <= ?1", "admission WHERE day != ?1"),
    # What is done with a damaged row.
    ("damage_test", "-*ADamagedRow*", DAEMON + "engine_core.cc",
     "if (!status.ok()) GiveUpUnreadable(entry.evaluation, std::string(status.message()));",
     "if (!status.ok()) return status;"),
    ("damage_test", "-*ADamagedRow*", DAEMON + "engine_recover.cc",
     "  if (!loaded.ok()) {\n    GiveUpUnreadable(id, std::string(loaded.status().message()));\n    return absl::OkStatus();\n  }",
     "  if (!loaded.ok()) return loaded.status();"),
    ("damage_test", "-*ADamagedRow*", STORE + "reader.cc",
     'if (row.ok() && Sha256Hex(text) != hash)', 'if (false)'),
    ("damage_test", "-*ADamagedRow*", DAEMON + "engine_ends.cc", "  to_take_up_.erase(evaluation);\n", ""),
]


def commands(build):
    """File -> its compile command; target -> its link command."""
    compdb = json.loads(subprocess.check_output(["ninja", "-C", build, "-t", "compdb"], text=True))
    compiles = {entry["file"]: entry["command"] for entry in compdb if " -c " in entry["command"]}
    links = {}
    for target in {mutant[0] for mutant in MUTANTS}:
        out = subprocess.check_output(["ninja", "-C", build, "-t", "commands", "-s",
                                       f"tests/{target}"], text=True)
        links[target] = out.strip().splitlines()[-1]
    return compiles, links


def try_mutant(mutant, build, compiles, links):
    """"killed", or what is wrong."""
    target, tests, file, text, instead = mutant
    source = (ROOT / file).read_text()
    if source.count(text) != 1:
        return f"the text is there {source.count(text)} times"
    with tempfile.TemporaryDirectory() as folder:
        changed = pathlib.Path(folder, "mutant.cc")
        changed.write_text(source.replace(text, instead))
        compile_words = shlex.split(compiles[str(ROOT / file)])
        compile_words[compile_words.index("-c") + 1] = str(changed)
        compile_words[compile_words.index("-o") + 1] = f"{folder}/mutant.o"
        for option in ("-MF", "-MT"):
            if option in compile_words:
                compile_words[compile_words.index(option) + 1] = f"{folder}/mutant.d"
        # Unused names are no mistake of a mutant's.
        compile_words += ["-O0", "-w"]
        done = subprocess.run(compile_words, cwd=build, capture_output=True, text=True)
        if done.returncode:
            return "does not compile: " + done.stderr[:2000]
        # An object before the archives: the archive's own is not asked for any more.
        link = links[target].replace(" -o ", f" {folder}/mutant.o -o ", 1)
        words = shlex.split(link.removeprefix(": && ").removesuffix(" && :"))
        words[words.index("-o") + 1] = f"{folder}/test"
        done = subprocess.run(words, cwd=build, capture_output=True, text=True)
        if done.returncode:
            return "does not link: " + done.stderr[:2000]
        try:
            done = subprocess.run([f"{folder}/test", f"--gtest_filter={tests}"], cwd=folder,
                                  capture_output=True, text=True, timeout=600)
        except subprocess.TimeoutExpired:
            return "killed"
        return "killed" if done.returncode else "SURVIVES"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build/asan", help="a build folder with the tests in it")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("words", nargs="*")
    options = parser.parse_args()
    build = str((ROOT / options.build).resolve())
    compiles, links = commands(build)
    wanted = [m for m in MUTANTS if not options.words or any(w in " ".join(m) for w in options.words)]
    alive = 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        results = pool.map(lambda m: try_mutant(m, build, compiles, links), wanted)
        for mutant, result in zip(wanted, results):
            print(f"{result:8} {mutant[2]}: {' '.join(mutant[3].split())[:90]}", flush=True)
            alive += result != "killed"
    print(f"{len(wanted) - alive} of {len(wanted)} mutants are killed")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
