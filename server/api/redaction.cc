#include "server/api/redaction.h"

#include <algorithm>
#include <initializer_list>
#include <span>
#include <string_view>

#include <absl/strings/str_cat.h>

#include "server/api/caller.h"
#include "server/base/error_code.h"
#include "server/challenge/phases.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// What the conditions below are about.
struct View {
  Visibility visibility;
  bool complete = false;      // all episodes have been played
  bool grader_error = false;  // the evaluation ended by one
  bool no_episodes = false;   // no single episode is shown
};

bool Always(const View&) { return true; }
bool SeesProgress(const View& view) { return view.visibility.progress; }
bool SeesOutcomes(const View& view) { return view.visibility.outcomes && !view.no_episodes; }
bool SeesMetrics(const View& view) { return view.visibility.metrics && !view.no_episodes; }
bool SeesOutput(const View& view) { return view.visibility.output; }
bool SeesFacts(const View& view) { return view.visibility.logs && !view.no_episodes; }
bool SeesSeeds(const View& view) { return view.visibility.seeds; }
bool SeesComparison(const View& view) { return SeesOutcomes(view) && SeesMetrics(view); }

// Whoever asks again after each episode, or cancels after one, would see how that episode ended.
bool SeesAggregate(const View& view) {
  return view.visibility.aggregate && !view.no_episodes && (view.complete || SeesComparison(view));
}
bool SeesCounts(const View& view) {
  return SeesOutcomes(view) || (view.visibility.aggregate && !view.no_episodes && view.complete);
}

// Messages about the grader's faults quote what its programs wrote last.
bool SeesReason(const View& view) { return view.visibility.output || !view.grader_error; }

using Kind = Json::value_t;

// Keys of an answer that take the same to see.
struct Part {
  bool (*seen)(const View&);
  std::initializer_list<std::string_view> keys;
  Kind blank = Kind::null;  // an empty value of this kind stands in the place of what is withheld
};

using Parts = std::initializer_list<std::span<const Part>>;

// Blanks what is not to be seen of an object, and all keys that no table has.
void Apply(Parts tables, const View& view, Json& object) {
  if (!object.is_object()) return;
  for (auto& [key, value] : object.items()) {
    const Part* its = nullptr;
    for (const std::span<const Part> table : tables) {
      for (const Part& part : table) {
        if (std::find(part.keys.begin(), part.keys.end(), key) != part.keys.end()) its = &part;
      }
    }
    if (its == nullptr || !its->seen(view)) value = its == nullptr ? Json() : Json(its->blank);
  }
}

const Part kCounts[] = {
    {Always, {"total", "done"}},
    {SeesCounts, {"success", "failure", "fault"}},
};

// What lists, a submission's status and its evaluations have in common.
const Part kSubmission[] = {
    {Always,
     {"submission", "team", "track", "profile", "phase", "artefact", "name", "ranked", "state",
      "evaluation", "episodes", "accepted_at", "finished_at"}},
};

const Part kStatus[] = {
    {Always,
     {"queue", "waiting", "started_at", "running_wall_s", "remaining_wall_s", "estimated_end_at",
      "owner", "deadline_at", "history", "blocks", "marks", "evaluations", "linked", "repeated",
      "cancel", "chosen"}},
    {SeesReason, {"reason"}},
};

const Part kTransition[] = {
    {Always, {"at", "of", "from", "to", "who"}},
    {SeesReason, {"why"}},
};

// Where a block stands shows how long each episode takes: a policy could tell by that what it sees.
const Part kBlock[] = {
    {Always,
     {"block", "first", "last", "state", "slot", "attempt", "faults", "host", "process",
      "started_at", "deadline_at", "running_wall_s"}},
    {SeesProgress, {"episode", "step", "silent_wall_s"}},
    {SeesOutput, {"detail"}},
    {SeesMetrics, {"attempts"}, Kind::array},
};

const Part kEvaluation[] = {
    {Always,
     {"kind", "track_kind", "first", "last", "started_at", "official_figures", "metrics", "hashes",
      "merkle_root", "grader", "limits", "comparison", "episode_rows"}},
    {SeesReason, {"reason"}},
    {SeesOutcomes, {"outcomes", "reasons"}, Kind::object},
    {SeesAggregate, {"aggregate"}},
    {SeesOutput, {"output"}, Kind::array},
    {SeesComparison, {"not_repeatable"}, Kind::array},
    {SeesFacts, {"details_summary"}},
    {SeesComparison, {"highlights"}, Kind::object},
};

const Part kComparison[] = {
    {Always, {"with", "compared", "missing"}},
    {SeesComparison, {"equal"}},
    {SeesComparison, {"episodes"}, Kind::array},
};

const Part kRow[] = {
    {Always, {"index", "attempt", "seed_commitment"}},
    {SeesSeeds, {"seed"}},
    {SeesOutcomes, {"outcome", "reason", "end", "fault"}},
    {SeesMetrics, {"metrics"}, Kind::object},
    {SeesMetrics,
     {"steps", "sim_time_s", "clipped", "digest", "actions_digest", "wall_s", "policy_cpu_s"}},
    {SeesFacts, {"log", "facts", "details"}},
};

const Part kFault[] = {
    {Always, {"outcome", "whose", "limit", "limit_value"}},
    {SeesMetrics, {"value", "step"}},
    {SeesOutput, {"detail", "stderr_tail"}},
};

View ViewOf(const Json& answer, const Visibility& visibility) {
  const std::string state = answer.value("state", "");
  return {.visibility = visibility,
          .complete = state == "done" || state == "failed",
          .grader_error = state == "grader_error",
          // A failed submission is charged as a failed try only, and one that ends by the grader's
          // fault not at all. So they tell one reason for the whole and nothing of their episodes,
          // and nobody knows of one that runs how it will end.
          .no_episodes = !visibility.progress && state != "done" && state != "cancelled"};
}

void RedactCommon(Json& answer, const View& view) {
  Apply({kCounts}, view, answer["episodes"]);
  answer["withheld"] = WithheldParts(view.visibility);
}

void RedactRow(Json& row, const View& view) {
  Apply({kRow}, view, row);
  Apply({kFault}, view, row["fault"]);
  // The metrics say of each episode whether it was a success.
  if (!view.visibility.outcomes && row["metrics"].contains("success")) {
    row["metrics"]["success"] = nullptr;
  }
}

PhaseVisibility KnownOf(const Transaction& reader, const ApiContext& context,
                   const std::string& phase) {
  const PhaseHistory& history = reader.Board().Phase(phase);
  PhaseVisibility known = {.shown = kUnknownPhaseVisibility,
                           .published = history.Has(kPublishedEvent),
                           .committed = true,
                           .revealed = history.Has(kRevealedEvent)};
  if (const PhaseConfig* config = context.phases.ConfigOf(phase)) {
    known.shown = config->shown;
    known.committed = config->committed != 0;
  }
  return known;
}

}  // namespace

bool IsPhasePublic(const Transaction& reader, const ApiContext& context,
                   const std::string& phase) {
  if (phase.empty()) return true;
  const PhaseVisibility known = KnownOf(reader, context, phase);
  if (known.published || known.revealed) return true;
  const PhaseConfig* config = context.phases.ConfigOf(phase);
  const Visibility visibility = ComputeVisibility(Role::kParticipant, known);
  return config != nullptr && config->freezes == absl::InfiniteFuture() && visibility.aggregate &&
         SeesReceipt(visibility);
}

bool IsReplayPublic(const Transaction& reader, const ApiContext& context,
                    const TrackConfig& config) {
  if (config.phase.empty()) return IsReplayPublic(context.config.public_replay, {});
  PhaseVisibility known = KnownOf(reader, context, config.phase);
  // The salt tells for sure whether seeds were hidden, whatever the files say today.
  known.committed = known.committed || !config.seed_salt.empty();
  const PhaseConfig* phase = context.phases.ConfigOf(config.phase);
  return IsReplayPublic(phase != nullptr && phase->public_replay, known);
}

Visibility FindPhaseVisibility(const Transaction& reader, const ApiContext& context,
                        const std::string& phase) {
  const Role role = Caller().role;
  if (phase.empty() || role >= Role::kOrganiser) return {};
  return ComputeVisibility(role, KnownOf(reader, context, phase));
}

Visibility FindConfigVisibility(const Transaction& reader, const ApiContext& context,
                         const TrackConfig& config) {
  Visibility visibility = FindPhaseVisibility(reader, context, config.phase);
  // The salt tells for sure whether there is anything to hide, whatever the files say today.
  if (config.seed_salt.empty() && !visibility.seeds) {
    visibility.seeds = true;
    visibility.progress = true;
    visibility.progress = SeesAll(visibility);
  }
  return visibility;
}

absl::Status WithheldError(const std::string& what) {
  return WithErrorCode(absl::FailedPreconditionError(absl::StrCat(
                           what,
                           "; wait until the organiser has published the phase and revealed "
                           "its seeds")),
                       kWithheldCode);
}

void RedactEvaluation(Json& answer, const Visibility& visibility) {
  if (SeesAll(visibility)) return;
  const View view = ViewOf(answer, visibility);
  Apply({kSubmission, kEvaluation}, view, answer);
  RedactCommon(answer, view);
  Apply({kComparison}, view, answer["comparison"]);
  for (const char* rows : {"episode_rows", "highlights"}) {
    if (!answer.contains(rows)) continue;
    for (Json& row : answer[rows]) RedactRow(row, view);
  }
  // Each block has a text of its own.
  if (view.no_episodes && answer["output"].size() > 1)
    answer["output"] = Json::array({answer["output"][0]});
}

void RedactStatus(Json& answer, const Visibility& visibility) {
  if (SeesAll(visibility)) return;
  const View view = ViewOf(answer, visibility);
  Apply({kSubmission, kStatus}, view, answer);
  RedactCommon(answer, view);
  for (Json& entry : answer["history"]) Apply({kTransition}, view, entry);
  for (Json& block : answer["blocks"]) Apply({kBlock}, view, block);
}

void RedactListed(Json& entry, const Visibility& visibility) {
  if (SeesAll(visibility)) return;
  const View view = ViewOf(entry, visibility);
  Apply({kSubmission}, view, entry);
  RedactCommon(entry, view);
}

void RedactLedgerRow(Json& row, const Visibility& visibility) {
  if (!visibility.outcomes) row["why"] = "withheld by the phase";
}

}  // namespace myograde::server
