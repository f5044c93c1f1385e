#!/usr/bin/env python3
"""Takes single checks out of the code and asks whether a test notices: of what may be removed
(Writer::Remove, Retention), of what is accepted (admission, quotas), and of what is done with a
damaged row. Each mutant is one textual change; its file is compiled beside the tree and linked into
one test program in place of the original, so neither sources nor build folder change. Prints a
line for each; exit status 1 if one survives, or no longer fits its file.

Use: run.py --build build/asan [WORD ...]   only mutants with one of the words in their line
     run.py --fits                          only whether each still has its place in its file
sweep.py tries those that operators.py makes."""

import argparse
import concurrent.futures
import pathlib
import sys
import tempfile

import operators
import trial

ROOT = pathlib.Path(__file__).resolve().parents[2]
STORE, ENGINE, BOARD = "server/store/", "server/engine/", "server/board/"

# Test program, what of it to run, file, the text, what stands in its place.
MUTANTS = [
    # What may be removed.
    ("store_test", "RemovalTest.*", STORE + "content.cc", "if (AnyRow(db_, needed, name)) return false;", ""),
    ("store_test", "RemovalTest.*", STORE + "content.cc", "e.finished_at IS NOT NULL AND ", "TRUE AND "),
    ("store_test", "RemovalTest.*", STORE + "content.cc", "s.ranked = 0 OR ", ""),
    ("store_test", "RemovalTest.*", STORE + "content.cc",
     "OR e.state IN ('failed', 'cancelled', 'grader_error')", ""),
    ("store_test", "RemovalTest.*", STORE + "content.cc", "'failed', 'cancelled', 'grader_error')) AND \"",
     "'done', 'failed', 'cancelled', 'grader_error')) AND \""),
    ("store_test", "RemovalTest.*", STORE + "content.cc", 'WHERE s.artefact = ?1 AND ",\n        Over(',
     'WHERE s.artefact = ?1 AND NOT ", Over('),
    ("store_test", "RemovalTest.*", STORE + "content.cc", 'p.log = ?1 AND "', 'p.log = ?1 AND NOT "'),
    ("store_test", "RemovalTest.*", STORE + "content.cc", "WHERE p.log != '' AND \",\n                        Over(",
     "WHERE p.log != '' AND NOT \",\n                        Over("),
    ("store_test", "RemovalTest.*", STORE + "content.cc", "R\"(INSERT INTO removal (at, kind, name, bytes, why) VALUES (?, ?, ?, ?, ?))\"",
     "\"SELECT 1 WHERE 0 AND (? OR ? OR ? OR ? OR ?)\""),
    ("store_test", "RemovalTest.*", STORE + "content.cc", 'upload || kind == "artefact"',
     'upload || kind != "artefact"'),
    ("store_test", "UploadsTest.*:RerunsTest.*", STORE + "content.cc",
     "if (taken == 0 && upload) return false;", ""),
    ("store_test", "UploadsTest.*:RerunsTest.*", STORE + "content.cc",
     "if (taken == 0 && upload) return false;", "if (upload) return false;"),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "if (file.needed) continue;", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "if (unused > age && ", "if (unused > age * 100 && "),
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
     "if (unneeded && rename(from.c_str(), to.c_str()) != 0", "if (rename(from.c_str(), to.c_str()) != 0"),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "fs::remove_all(to, error);", ""),
    ("engine_test", "Retention*", ENGINE + "retention.cc", "if (!fs::exists(file.path, error)) continue;", ""),
    # What is accepted.
    ("engine_test", "*AreGone*", ENGINE + "engine.cc",
     "HasArtefactFiles(core_.options().data_dir, submission.artefact)", "absl::OkStatus()"),
    ("engine_test", "*AreGone*", ENGINE + "engine.cc",
     "HasArtefactFiles(core_.options().data_dir, rerun.artefact)", "absl::OkStatus()"),
    ("store_test", "*", STORE + "submissions.cc", "if (!AnyRow(db_, \"SELECT 1 FROM artefact WHERE hash = ?\", asked.artefact))", "if (false)"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc", "if (first.has_value()) return *first;", ""),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc", "  if (submission.ranked) {\n", "  if (true) {\n"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc", "e.state != 'grader_error' AND ", ""),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc",
     "(e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)) ", "TRUE "),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc",
     "e.state != 'cancelled' OR EXISTS (SELECT 1 FROM episode WHERE evaluation = e.id)",
     "e.state != 'cancelled'"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc", "AND s.ranked = 1 AND", "AND"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc", "AND s.config = ? AND", "AND ? != '' AND"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc",
     "if (!rules.one_for_everyone) return std::optional<Accepted>();", ""),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc",
     "if (!taken) return std::optional<Accepted>();", "return std::optional<Accepted>();"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc",
     "CheckQuota(use, rules.quota, budget, submission.team, submission.track, submission.phase)",
     "absl::OkStatus()"),
    ("store_test", "QuotaTest.*", STORE + "submissions.cc",
     "RETURN_IF_ERROR(Content(context_).AddText(kSeedLists, submission.seeds, submission.seeds_json));",
     "(void)Content(context_).AddText(kSeedLists, submission.seeds, submission.seeds_json);"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "if (use.waiting >= limits.waiting)", "if (false)"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "use.waiting >= limits.waiting", "use.waiting > limits.waiting"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.left(allowance.total) < 1", "sum.left(allowance.total) < 0"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.left(allowance.per_day) < 1", "sum.left(allowance.per_day) < 0"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "  return CheckBudget(use, limits, Budget::kFailed, team, place);\n",
     "  return absl::OkStatus();\n"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "std::max(newest, today)", "today"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.charged -= amount;", ";"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "sum.open += amount;", ";"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "AND l.entry = 'charge')) GROUP BY",
     "AND l.entry = 'grant')) GROUP BY"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "amount BETWEEN 1 AND ?", "amount < ?"),
    ("store_test", "QuotaTest.*", STORE + "quota.cc", "submission WHERE day <= ?1", "submission WHERE day != ?1"),
    # What counts on a board.
    ("board_test", "*", BOARD + "board_state.cc", "} else if (!repeated) {", "} else {"),
    ("board_test", "*", BOARD + "board_results.cc", "return !entry.second->graded;", "return false;"),
    ("board_test", "*", BOARD + "board_results.cc", "id == moment.assumed_rejudge || id == moment.ignored_rejudge",
     "id == moment.assumed_rejudge"),
    ("board_test", "*", BOARD + "board_results.cc", "if (mark.at >= before_ms) continue;", ""),
    ("board_test", "*", BOARD + "board_results.cc", "choice.at >= moment.results_before_ms() || ", ""),
    ("board_test", "*", BOARD + "board_results.cc",
     "if (found->second.config != config && !deciding.contains(choice.submission)) continue;", ""),
    # What is done with a damaged row.
    ("engine_test", "-*ADamagedRow*", ENGINE + "engine_core.cc",
     "if (!status.ok()) GiveUpUnreadable(entry.evaluation, std::string(status.message()));",
     "if (!status.ok()) return status;"),
    ("engine_test", "-*ADamagedRow*", ENGINE + "engine_recover.cc",
     "  if (!stored.ok()) {\n    GiveUpUnreadable(id, std::string(stored.status().message()));\n    return absl::OkStatus();\n  }",
     "  if (!stored.ok()) return stored.status();"),
    ("engine_test", "-*ADamagedRow*", STORE + "content.cc",
     'if (Sha256Hex(text) != hash)', 'if (false)'),
    ("engine_test", "-*ADamagedRow*", ENGINE + "engine_ends.cc", "  deferred_.erase(evaluation);\n", ""),
]


def try_mutant(mutant, build):
    """"killed", or what is wrong."""
    program, tests, file, text, instead = mutant
    source = ROOT / file
    if source.read_text().count(text) != 1:
        return f"the text is there {source.read_text().count(text)} times"
    with tempfile.TemporaryDirectory() as folder:
        wrong = build.compile(source, source.read_text().replace(text, instead), pathlib.Path(folder))
        if wrong:
            return "does not compile: " + wrong
        wrong = build.link(program, folder)
        if wrong:
            return "does not link: " + wrong
        # The one object without a sanitizer does not mark its containers' ends.
        result = trial.run(folder, [f"--gtest_filter={tests}"],
                           {"ASAN_OPTIONS": "detect_container_overflow=0", "RC_PARAMS": "max_success=150"},
                           seconds=600, limited=False)
        return "killed" if result == "timeout" else result


def misfits():
    """What no longer fits the sources: a line for each mutant whose text is not in its file, or there more than once,
    and for each entry of equal.json that names no mutant."""
    texts = {mutant[2]: (ROOT / mutant[2]).read_text(encoding="utf-8") for mutant in MUTANTS}
    wrong = [f"{mutant[2]} does not have once: {mutant[3]}"
             for mutant in MUTANTS if texts[mutant[2]].count(mutant[3]) != 1]
    made = {(file, line.strip(), changed.strip()) for _, file, _, line, changed in operators.every_mutant()}
    wrong += [f"equal.json: no mutant of {file} is: {line}  ->  {changed}"
              for file, line, changed in operators.equal_ones() if (file, line, changed) not in made]
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build/asan", help="a build folder with the tests in it")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--fits", action="store_true")
    options = parser.parse_args()
    if options.fits:
        wrong = misfits()
        print("\n".join(wrong) or "Each fits.")
        return 1 if wrong else 0
    wanted = [m for m in MUTANTS if not options.words or any(w in " ".join(m) for w in options.words)]
    # Sanitizers look for no mistakes in a mutant.
    build = trial.Build((ROOT / options.build).resolve(), {mutant[0] for mutant in wanted},
                        extra=("-O0", "-fno-sanitize=all"))
    alive = 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        results = pool.map(lambda m: try_mutant(m, build), wanted)
        for mutant, result in zip(wanted, results):
            print(f"{result:8} {mutant[2]}: {' '.join(mutant[3].split())[:90]}", flush=True)
            alive += result != "killed"
    print(f"{len(wanted) - alive} of {len(wanted)} mutants are killed")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
