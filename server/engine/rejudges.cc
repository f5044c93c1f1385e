#include "server/engine/rejudges.h"

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr absl::Duration kWrite = absl::Seconds(30);
// About as many rows are written together: a few ms, for which the engine's loop stands still.
constexpr int64_t kRowsAtOnce = 256;

absl::Status CantBeJudged(const EpisodeRow& row, const absl::Status& why) {
  return absl::InternalError(absl::StrCat("the facts of episode ", row.index, " of evaluation ",
                                          row.evaluation, " can't be judged: ",
                                          std::string(why.message())));
}

// Computes an item from the facts of its source: pure but for reading. InternalError if the facts
// can't be judged; a damaged row (store/damage.h).
absl::Status JudgeAnew(const Transaction& reader, const EvaluationRow& source, const Track& track,
                       const std::vector<uint64_t>& seeds, NewRejudgeItem& item) {
  if (source.last >= std::ssize(seeds)) {
    return absl::InternalError(absl::StrCat("evaluation ", source.id,
                                            " has more episodes than the "
                                            "new config has seeds"));
  }
  ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, WholeEpisodes(reader, source, seeds));
  ASSIGN_OR_RETURN(const SubmissionRow submission, reader.submissions.Find(source.submission));
  ASSIGN_OR_RETURN(const TrackConfig before, StoredConfig(reader, ConfigOf(source, submission)));
  RETURN_IF_ERROR(CheckResults(reader, source, rows, before.seed_salt));
  for (EpisodeRow& row : rows) {
    const absl::StatusOr<EpisodeFacts> facts = EpisodeFactsFromJson(ParsedText(row.facts_json));
    if (!facts.ok()) return CantBeJudged(row, facts.status());
    absl::StatusOr<EpisodeRow> judged = JudgedRow(track, *facts);
    if (!judged.ok()) return CantBeJudged(row, judged.status());
    row.outcome = judged->outcome;
    row.reason = judged->reason;
    row.metrics_json = std::move(judged->metrics_json);
  }
  ASSIGN_OR_RETURN(item.judged, ComputeResult(track, rows));
  item.episodes = std::move(rows);
  return absl::OkStatus();
}

}  // namespace

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
  ASSIGN_OR_RETURN(const int64_t newest, readers_.Read<int64_t>([](const Transaction& reader) {
    return reader.Board().last();
  }));
  if (newest == seen_) return absl::OkStatus();
  ASSIGN_OR_RETURN(const std::vector<Work> open, OpenWork());
  for (const Work& work : open) RETURN_IF_ERROR(Carry(work));
  if (!stop_.stop_requested()) seen_ = newest;
  return absl::OkStatus();
}

absl::StatusOr<std::vector<Rejudger::Work>> Rejudger::OpenWork() {
  std::vector<Work> open;
  RETURN_IF_ERROR(readers_.Read([&](const Transaction& reader) -> absl::Status {
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
  return open;
}

absl::StatusOr<Rejudger::Work> Rejudger::FindWork(const Transaction& reader, RejudgeRow rejudge) {
  Work work;
  work.rejudge = std::move(rejudge);
  if (work.rejudge.last() == RejudgeEvent::kDropped) return work;
  work.missing = reader.rejudges.MissingItems(work.rejudge);
  if (work.missing.empty()) return work;
  ASSIGN_OR_RETURN(work.track, content_.Track(reader, work.rejudge.to_config));
  ASSIGN_OR_RETURN(work.seeds, content_.Seeds(reader, work.rejudge.seeds));
  ASSIGN_OR_RETURN(const std::string from, reader.content.ConfigJson(work.rejudge.from_config));
  ASSIGN_OR_RETURN(const std::string to, reader.content.ConfigJson(work.rejudge.to_config));
  work.same_facts = SameFacts(ParsedText(from), ParsedText(to));
  return work;
}

absl::Status Rejudger::Carry(const Work& work) {
  const Json today = options_.grader();
  Items items;
  int64_t rows = 0;  // that adding them writes
  for (const NewEvaluation& candidate : work.missing) {
    if (stop_.stop_requested()) return absl::OkStatus();
    ASSIGN_OR_RETURN(NewRejudgeItem item,
                     readers_.Read<NewRejudgeItem>([&](const Transaction& reader) {
                       return ItemOf(reader, work, candidate, today);
                     }));
    rows += std::ssize(item.episodes) + 2 * std::ssize(item.blocks);
    items.push_back(std::move(item));
    if (rows < kRowsAtOnce) continue;
    RETURN_IF_ERROR(Write(std::exchange(items, {})));
    rows = 0;
  }
  return items.empty() ? absl::OkStatus() : Write(std::move(items));
}

absl::StatusOr<NewRejudgeItem> Rejudger::ItemOf(const Transaction& reader, const Work& work,
                                                const NewEvaluation& candidate, const Json& today) {
  NewRejudgeItem item{candidate};
  item.grader_json = CanonicalJson(today);
  item.blocks = SplitIntoBlocks(std::ssize(*work.seeds), work.track->config.episodes_per_lease);
  const absl::StatusOr<EvaluationRow> source = reader.evaluations.Find(candidate.source);
  absl::Status why_not = source.status();
  if (source.ok()) {
    item.method = ChooseMethod(work.rejudge.method, work.rejudge.repeats, work.same_facts,
                               ParsedText(source->grader_json), today);
  }
  if (source.ok() && item.method == RejudgeMethod::kFacts) {
    why_not = JudgeAnew(reader, *source, *work.track, *work.seeds, item);
    if (why_not.ok()) return item;
  }
  const absl::StatusOr<std::string> impossible =
      WhyNotPlayed(reader, candidate.submission, options_.data_dir);
  why_not.Update(impossible.status());
  if (MayPass(why_not) || IsBrokenStore(why_not)) return why_not;
  // One that can't be read is without a result, and holds up no other.
  item.impossible = why_not.ok() ? *impossible : std::string(why_not.message());
  return item;
}

absl::Status Rejudger::Write(Items items) {
  ASSIGN_OR_RETURN(const std::vector<absl::Status> statuses,
                   engine_.AddRejudgeItems(std::move(items), kWrite));
  for (const absl::Status& status : statuses) {
    // One that was dropped meanwhile takes no more items.
    if (!status.ok()) spdlog::warn("can't add an item: {}", std::string(status.message()));
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
