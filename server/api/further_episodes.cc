#include "server/api/further_episodes.h"

#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

absl::StatusOr<bool> IsDropped(Reader& reader, int64_t rejudge) {
  ASSIGN_OR_RETURN(const std::vector<RejudgeEventRow> events, reader.RejudgeEvents(rejudge));
  return !events.empty() && events.back().event == RejudgeEvent::kDropped;
}

absl::Status AddItems(Reader& reader, const RejudgeRow& rejudge, FurtherItems& all) {
  ASSIGN_OR_RETURN(const bool dropped, IsDropped(reader, rejudge.id));
  ASSIGN_OR_RETURN(const std::vector<uint64_t> seeds, SeedsOfRejudge(reader, rejudge));
  ASSIGN_OR_RETURN(const std::vector<RejudgeItemRow> items, reader.RejudgeItems(rejudge.id));
  for (const RejudgeItemRow& item : items) {
    const bool has_none = item.state == EvaluationState::kCancelled ||
                          item.state == EvaluationState::kGraderError;
    if (has_none) continue;
    all[item.submission].push_back({rejudge.id, item.evaluation, item.state, seeds, dropped});
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<uint64_t>> SeedsOfRejudge(Reader& reader, const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(const std::string text, reader.SeedsJson(rejudge.seeds));
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  return ParseSeeds(json, absl::StrCat("the seeds of rejudge ", rejudge.id));
}

absl::StatusOr<FurtherItems> FurtherItemsOf(Reader& reader, const std::string& config) {
  FurtherItems all;
  const Listed<RejudgeRow> rejudges = reader.Rejudges();
  for (auto rejudge = rejudges.rows.rbegin(); rejudge != rejudges.rows.rend(); ++rejudge) {
    if (rejudge->purpose != RejudgePurpose::kSeeds || rejudge->from_config != config) continue;
    RETURN_IF_ERROR(AddItems(reader, *rejudge, all));
  }
  return all;
}

absl::StatusOr<Further> FurtherEpisodes(
    Reader& reader, const Track& track, const std::vector<FurtherItem>& items, int64_t before_ms,
    FurtherIndices& indices) {
  Further further;
  std::set<uint64_t> seen;  // seeds, of dropped ones too
  std::set<int64_t> there;
  for (const FurtherItem& item : items) {
    if (item.state != EvaluationState::kDone && item.state != EvaluationState::kFailed) continue;
    const absl::StatusOr<EvaluationRow> evaluation = reader.Evaluation(item.evaluation);
    if (!evaluation.ok()) return evaluation.status();
    if (evaluation->finished_at >= before_ms) continue;
    seen.insert(item.seeds.begin(), item.seeds.end());
    further.looks.insert(std::ssize(seen));
    if (item.dropped) continue;
    ASSIGN_OR_RETURN(std::vector<EpisodeRow> rows, reader.Episodes(item.evaluation));
    for (EpisodeRow& row : rows) row.index = indices.Of(row.seed);
    ASSIGN_OR_RETURN(const std::vector<scoring::JudgedEpisode> judged,
                     JudgedEpisodes(*track.scoring.track, rows));
    for (const scoring::JudgedEpisode& episode : judged) {
      if (there.insert(episode.index).second) further.episodes.push_back(episode);
    }
  }
  return further;
}

}  // namespace myograde::server
