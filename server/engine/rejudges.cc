#include "server/engine/rejudges.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "server/grading/results.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kScoring[] = "scoring";

// Whether two effective configs give the same facts: they differ in "scoring" at most.
bool HaveSameFacts(Json from, Json to) {
  if (!from.is_object() || !to.is_object()) return false;
  from.erase(kScoring);
  to.erase(kScoring);
  return from == to;
}

// The same of a rejudge's two.
bool HasSameFacts(const NewRejudge& rejudge) {
  return HaveSameFacts(ParsedText(rejudge.from_config_json), ParsedText(rejudge.to_config_json));
}

absl::Status CheckNewRejudge(const NewRejudge& rejudge) {
  const bool rules = rejudge.purpose == RejudgePurpose::kRules;
  const bool facts = rejudge.method == RejudgeMethod::kFacts;
  if (rejudge.why.empty()) return absl::InvalidArgumentError("a rejudge needs a reason");
  if (rejudge.repeats < 1 || rejudge.repeats > kMostRepeats) {
    return absl::InvalidArgumentError(
        absl::StrCat("a rejudge has 1 to ", kMostRepeats, " repeats, not ", rejudge.repeats));
  }
  if (rules != rejudge.submissions.empty()) {
    return absl::InvalidArgumentError(
        rules ? "a change of rules covers all submissions of the board; don't list some"
              : "list at least one submission for further episodes");
  }
  if (facts && (rejudge.repeats > 1 || !rules)) {
    return absl::InvalidArgumentError(
        "repeats and further episodes have to be played; stored facts are not enough");
  }
  if (facts && !HasSameFacts(rejudge)) {
    return absl::InvalidArgumentError(
        "stored facts are not enough: the configs differ in more than \"scoring\"; leave the "
        "method at \"auto\", or choose \"play\"");
  }
  for (const auto& [hash, json] : {std::pair(&rejudge.from_config, &rejudge.from_config_json),
                                   std::pair(&rejudge.to_config, &rejudge.to_config_json),
                                   std::pair(&rejudge.seeds, &rejudge.seeds_json)}) {
    if (Sha256Hex(*json) == *hash) continue;
    return absl::InvalidArgumentError(absl::StrCat(*hash, " is not the hash of its content"));
  }
  return absl::OkStatus();
}

// Of those listed, each is to have a result.
absl::Status CheckListed(const NewRejudge& rejudge, const std::vector<EvaluationRow>& missing) {
  for (const int64_t submission : rejudge.submissions) {
    const auto found = std::ranges::find(missing, submission, &EvaluationRow::submission);
    if (found != missing.end()) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("submission ", submission,
                     " can't get further episodes: it is not ranked, has "
                     "no result under config ",
                     rejudge.from_config.substr(0, 12), ", or is on another board"));
  }
  return absl::OkStatus();
}

constexpr absl::Duration kWrite = absl::Seconds(30);
// About as many rows are written together: a few ms, for which the engine's loop stands still.
constexpr int64_t kRowsAtOnce = 256;

// Computes an item from the facts of its source: pure but for reading. InternalError if the facts
// can't be judged; a damaged row (store/damage.h).
absl::Status JudgeAnew(const Transaction& reader, const Track& track,
                       const std::vector<uint64_t>& seeds, NewRejudgeItem& item) {
  ASSIGN_OR_RETURN(const EvaluationRow source, reader.evaluations.Find(item.source));
  if (source.last >= std::ssize(seeds)) {
    return absl::InternalError(absl::StrCat("evaluation ", source.id,
                                            " has more episodes than the "
                                            "new config has seeds"));
  }
  ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, WholeEpisodes(reader, source, seeds));
  ASSIGN_OR_RETURN(const TrackPtr before, StoredTrack(reader, source.config));
  RETURN_IF_ERROR(CheckResults(reader, source, rows, before->config.seed_salt));
  for (EpisodeRow& row : rows) {
    const auto facts = EpisodeFactsFromJson(ParsedText(row.facts_json));
    auto judged = facts.ok() ? JudgedRow(track, *facts) : facts.status();
    if (!judged.ok()) {
      return absl::InternalError(absl::StrCat("the facts of episode ", row.index, " of evaluation ",
                                              row.evaluation, " can't be judged: ",
                                              std::string(judged.status().message())));
    }
    row.outcome = judged->outcome;
    row.reason = judged->reason;
    row.metrics_json = std::move(judged->metrics_json);
  }
  ASSIGN_OR_RETURN(item.result, ComputeResult(track, rows));
  item.episodes = std::move(rows);
  return absl::OkStatus();
}

// One that can't be read, or judged, is without a result, and holds up no other.
absl::StatusOr<NewRejudgeItem> WithoutResult(const absl::Status& why, NewRejudgeItem item) {
  if (MayPass(why) || IsBrokenStore(why)) return why;
  item.result = {EvaluationState::kGraderError, std::string(why.message())};
  return item;
}

// An item but for its blocks and what is computed; impossible if it has to be played and the files
// of its artefact are no longer in `data_dir`. `today` is this host's build.
absl::StatusOr<NewRejudgeItem> ItemOf(const Transaction& reader, const RejudgeRow& rejudge,
                                      const EvaluationRow& candidate, bool same_facts,
                                      const Json& today, const std::string& data_dir) {
  NewRejudgeItem item{candidate};
  item.grader_json = CanonicalJson(today);
  const absl::StatusOr<EvaluationRow> source = reader.evaluations.Find(candidate.source);
  if (!source.ok()) return WithoutResult(source.status(), std::move(item));
  item.method = rejudge.method;
  if (item.method == RejudgeMethod::kAuto) {
    const bool facts = rejudge.repeats == 1 && same_facts &&
                       SameSimulation(ParsedText(source->grader_json), today);
    item.method = facts ? RejudgeMethod::kFacts : RejudgeMethod::kPlay;
  }
  if (item.method == RejudgeMethod::kFacts) return item;
  const absl::StatusOr<SubmissionRow> row = reader.submissions.Find(candidate.submission);
  if (!row.ok()) return WithoutResult(row.status(), std::move(item));
  if (!HasArtefactFiles(data_dir, row->artefact).ok()) {
    item.result = {EvaluationState::kGraderError,
                   absl::StrCat("it can't be played again: the files of artefact ", row->artefact,
                                " are no longer on this host")};
  }
  return item;
}

}  // namespace

absl::StatusOr<RejudgePlan> PlanRejudge(const Transaction& reader, const NewRejudge& rejudge,
                                        const std::string& data_dir) {
  RETURN_IF_ERROR(CheckNewRejudge(rejudge));
  const auto candidates = reader.rejudges.MissingItems(rejudge);
  RETURN_IF_ERROR(CheckListed(rejudge, candidates));
  const bool same_facts = rejudge.purpose == RejudgePurpose::kRules && HasSameFacts(rejudge);
  const Json today = ParsedText(rejudge.grader_json);
  RejudgePlan plan;
  for (const EvaluationRow& candidate : candidates) {
    ASSIGN_OR_RETURN(const NewRejudgeItem item,
                     ItemOf(reader, rejudge, candidate, same_facts, today, data_dir));
    ++(item.method == RejudgeMethod::kFacts ? plan.facts : plan.play);
    if (candidate.repetition != 1) continue;
    ++plan.submissions;
    if (IsFinal(item.result.state)) plan.without_files.push_back(candidate.submission);
  }
  return plan;
}

Rejudger::Rejudger(RejudgerOptions options, Engine& engine, ReaderPool& readers)
    : options_(std::move(options)),
      engine_(engine),
      readers_(readers),
      thread_([this](std::stop_token stop) {
        stop_ = std::move(stop);
        Loop();
      }) {}

void Rejudger::Loop() {
  std::string trouble;
  do {
    const std::string now = std::string(LookForWork().message());
    if (!now.empty() && now != trouble) spdlog::warn("rejudges can't continue yet: {}", now);
    trouble = now;
  } while (!WaitForStop(stop_, options_.every));
}

absl::Status Rejudger::LookForWork() {
  int64_t newest = 0;
  std::vector<Work> open;
  RETURN_IF_ERROR(readers_.Read([&](const Transaction& reader) -> absl::Status {
    newest = reader.Board().last();
    if (newest == seen_) return absl::OkStatus();
    for (const auto& [id, rejudge] : reader.Board().rejudges()) {
      absl::StatusOr<Work> work = FindWork(reader, rejudge);
      if (MayPass(work.status()) || IsBrokenStore(work.status())) return work.status();
      if (!work.ok()) {
        spdlog::error("rejudge {} can't continue: {}", id, std::string(work.status().message()));
      } else if (!work->missing.empty()) {
        open.push_back(*std::move(work));
      }
    }
    return absl::OkStatus();
  }));
  for (const Work& work : open) RETURN_IF_ERROR(Carry(work));
  if (!stop_.stop_requested()) seen_ = newest;
  return absl::OkStatus();
}

absl::StatusOr<Rejudger::Work> Rejudger::FindWork(const Transaction& reader, RejudgeRow rejudge) {
  Work work;
  work.rejudge = std::move(rejudge);
  if (work.rejudge.last() == RejudgeEvent::kDropped) return work;
  work.missing = reader.rejudges.MissingItems(work.rejudge);
  if (work.missing.empty()) return work;
  ASSIGN_OR_RETURN(work.track, content_.Track(reader, work.rejudge.to_config));
  ASSIGN_OR_RETURN(work.seeds, content_.Seeds(reader, work.rejudge.seeds));
  ASSIGN_OR_RETURN(const TrackPtr from, content_.Track(reader, work.rejudge.from_config));
  work.same_facts = HaveSameFacts(from->config.effective, work.track->config.effective);
  return work;
}

absl::Status Rejudger::Carry(const Work& work) {
  const Json today = options_.grader();
  std::vector<NewRejudgeItem> items;
  int64_t rows = 0;  // that adding them writes
  for (const EvaluationRow& candidate : work.missing) {
    if (stop_.stop_requested()) return absl::OkStatus();
    ASSIGN_OR_RETURN(NewRejudgeItem item,
                     readers_.Read<NewRejudgeItem>([&](const Transaction& reader) {
                       return Make(reader, work, candidate, today);
                     }));
    rows += std::ssize(item.episodes) + 2 * std::ssize(item.blocks);
    items.push_back(std::move(item));
    if (rows < kRowsAtOnce) continue;
    RETURN_IF_ERROR(engine_.AddRejudgeItems(std::exchange(items, {}), kWrite));
    rows = 0;
  }
  return items.empty() ? absl::OkStatus() : engine_.AddRejudgeItems(std::move(items), kWrite);
}

absl::StatusOr<NewRejudgeItem> Rejudger::Make(const Transaction& reader, const Work& work,
                                              const EvaluationRow& candidate, const Json& today) {
  ASSIGN_OR_RETURN(
      NewRejudgeItem item,
      ItemOf(reader, work.rejudge, candidate, work.same_facts, today, options_.data_dir));
  item.blocks = SplitIntoBlocks(std::ssize(*work.seeds), work.track->config.episodes_per_lease);
  if (item.method != RejudgeMethod::kFacts || IsFinal(item.result.state)) return item;
  const absl::Status judged = JudgeAnew(reader, *work.track, *work.seeds, item);
  if (!judged.ok()) return WithoutResult(judged, std::move(item));
  return item;
}

}  // namespace myograde::server
