// Requests about rejudges (store/rejudges.h).
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/engine/engine.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

constexpr char kRejudger[] = "daemon";  // in audit rows

// The items of a rejudge with further episodes, complete but for its id.
absl::StatusOr<std::vector<NewRejudgeItem>> ItemsOf(const Transaction& reader,
                                                    const NewRejudge& rejudge,
                                                    const std::string& data_dir) {
  std::vector<NewRejudgeItem> items;
  if (rejudge.purpose != RejudgePurpose::kSeeds) return items;
  ASSIGN_OR_RETURN(nlohmann::json json, ParseJson(rejudge.to_config_json, "the new config"));
  ASSIGN_OR_RETURN(const TrackConfig config, ParseTrackConfig(json, "the new config"));
  for (const RejudgeCandidate& candidate : reader.rejudges.CandidatesFor(rejudge)) {
    ASSIGN_OR_RETURN(NewRejudgeItem item,
                     ItemToPlay(reader, candidate, rejudge.grader_json, rejudge.seed_count,
                                config.episodes_per_lease, data_dir));
    items.push_back(std::move(item));
  }
  return items;
}

using EvaluationIds = std::vector<int64_t>;

// Adds an item, and its evaluation to `to_queue` if there is something to play.
absl::Status AddItem(Transaction& writer, const NewRejudgeItem& item, const std::string& who,
                     EvaluationIds& to_queue) {
  ASSIGN_OR_RETURN(const Accepted added, writer.rejudges.AddItem(item, who));
  if (added.is_new() && item.impossible.empty()) to_queue.push_back(added.evaluation);
  return absl::OkStatus();
}

absl::Status EnqueueAll(EngineCore& core, const EvaluationIds& evaluations) {
  for (const int64_t evaluation : evaluations) {
    RETURN_IF_ERROR(core.Enqueue(evaluation));
  }
  return absl::OkStatus();
}

}  // namespace

nlohmann::json Engine::HostBuild() const {
  return WithRuntimes(GraderBuild(cache_dir_, AdapterNames()), RuntimeDigests(runtimes_));
}

absl::StatusOr<CreatedRejudge> Engine::CreateRejudge(const NewRejudge& asked,
                                                     const SignDocument& sign,
                                                     const std::string& who,
                                                     absl::Duration timeout) {
  NewRejudge rejudge = asked;
  if (rejudge.grader_json.empty()) rejudge.grader_json = CanonicalJson(HostBuild());
  RETURN_IF_ERROR(CheckNewRejudge(rejudge));
  RejudgePlan plan;
  ASSIGN_OR_RETURN(
      std::vector<NewRejudgeItem> items,
      readers_.Read<std::vector<NewRejudgeItem>>(
          [&](const Transaction& reader) -> absl::StatusOr<std::vector<NewRejudgeItem>> {
            ASSIGN_OR_RETURN(plan, PlanRejudge(reader, rejudge, data_dir_));
            return ItemsOf(reader, rejudge, data_dir_);
          }));
  const auto to_queue = std::make_shared<EvaluationIds>();
  ASSIGN_OR_RETURN(
      RejudgeRow created,
      Change<RejudgeRow>(
          [=, items = std::move(items)](Transaction& writer) -> absl::StatusOr<RejudgeRow> {
            ASSIGN_OR_RETURN(RejudgeRow row, writer.rejudges.Add(rejudge, sign, who));
            to_queue->clear();
            for (NewRejudgeItem item : items) {
              item.rejudge = row.id;
              RETURN_IF_ERROR(AddItem(writer, item, who, *to_queue));
            }
            return row;
          },
          timeout, [this, to_queue](const RejudgeRow&) { return EnqueueAll(core_, *to_queue); }));
  return CreatedRejudge{std::move(created), std::move(plan)};
}

absl::StatusOr<RejudgeDone> Engine::ApplyRejudge(const RejudgeAct& act, const SignDocument& sign,
                                                 const std::string& who, absl::Duration timeout,
                                                 AfterRejudge after) {
  return ActOnRejudge([=](Transaction& writer) { return writer.rejudges.Apply(act, sign, who); },
                      timeout, std::move(after));
}

absl::StatusOr<RejudgeDone> Engine::DropRejudge(const RejudgeAct& act, const SignDocument& sign,
                                                const std::string& who, absl::Duration timeout,
                                                AfterRejudge after) {
  return ActOnRejudge([=](Transaction& writer) { return writer.rejudges.Drop(act, sign, who); },
                      timeout, std::move(after));
}

absl::StatusOr<RejudgeDone> Engine::ActOnRejudge(
    std::function<absl::StatusOr<RejudgeDone>(Transaction&)> act, absl::Duration timeout,
    AfterRejudge after) {
  return Change<RejudgeDone>(std::move(act), timeout,
                             [this, after = std::move(after)](const RejudgeDone& done) {
                               core_.StopEnded(done.cancelled);
                               if (after) after(done);
                               return absl::OkStatus();
                             });
}

absl::StatusOr<std::vector<absl::Status>> Engine::AddRejudgeItems(
    std::vector<JudgedItem> judged, std::vector<NewRejudgeItem> to_play, absl::Duration timeout) {
  using Statuses = std::vector<absl::Status>;
  const auto to_queue = std::make_shared<EvaluationIds>();
  return Change<Statuses>(
      [=, judged = std::move(judged), to_play = std::move(to_play)](
          Transaction& writer) -> absl::StatusOr<Statuses> {
        Statuses statuses;
        to_queue->clear();
        absl::Status passing;
        const auto part = [&](const StoreChange& change) {
          statuses.push_back(writer.Part(change));
          if (MayPass(statuses.back()) || IsBrokenStore(statuses.back())) {
            passing.Update(statuses.back());
          }
        };
        for (const JudgedItem& item : judged) {
          part([&](Transaction& one) {
            return one.rejudges.AddJudgedItem(item, kRejudger).status();
          });
        }
        for (const NewRejudgeItem& item : to_play) {
          part([&](Transaction& one) { return AddItem(one, item, kRejudger, *to_queue); });
        }
        RETURN_IF_ERROR(passing);
        return statuses;
      },
      timeout, [this, to_queue](const Statuses&) { return EnqueueAll(core_, *to_queue); });
}

}  // namespace myograde::server
