#include "server/api/redaction.h"

#include <array>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// What the conditions below are about.
struct View {
  Visibility sight;
  bool complete = false;      // all episodes have been played
  bool grader_error = false;  // the evaluation ended by one
  bool no_episodes = false;   // no single episode is shown
};

bool Always(const View&) { return true; }
bool SeesProgress(const View& view) { return view.sight.progress; }
bool SeesOutcomes(const View& view) { return view.sight.outcomes && !view.no_episodes; }
bool SeesMetrics(const View& view) { return view.sight.metrics && !view.no_episodes; }
bool SeesOutput(const View& view) { return view.sight.output; }
bool SeesFacts(const View& view) { return view.sight.logs && !view.no_episodes; }
bool SeesSeeds(const View& view) { return view.sight.seeds; }
bool SeesComparison(const View& view) { return SeesOutcomes(view) && SeesMetrics(view); }

// Whoever asks again after each episode, or cancels after one, would see how that episode ended.
bool SeesAggregate(const View& view) {
  return view.sight.aggregate && !view.no_episodes && (view.complete || SeesComparison(view));
}
bool SeesCounts(const View& view) {
  return SeesOutcomes(view) || (view.sight.aggregate && !view.no_episodes && view.complete);
}

// Messages about the grader's faults quote what its programs wrote last.
bool SeesReason(const View& view) { return view.sight.output || !view.grader_error; }

// What stands in the place of what is withheld.
enum class Blank { kNull, kList, kObject };

struct Part {
  std::string_view key;
  bool (*seen)(const View&);
  Blank blank = Blank::kNull;
};

Json Placeholder(Blank blank) {
  switch (blank) {
    case Blank::kList:
      return Json::array();
    case Blank::kObject:
      return Json::object();
    case Blank::kNull:
      break;
  }
  return nullptr;
}

using Parts = std::initializer_list<std::span<const Part>>;

const Part* Find(Parts tables, std::string_view key) {
  for (const std::span<const Part> table : tables) {
    for (const Part& part : table) {
      if (part.key == key) return &part;
    }
  }
  return nullptr;
}

void Apply(Parts tables, const View& view, Json& object) {
  if (!object.is_object()) return;
  for (auto& [key, value] : object.items()) {
    const Part* part = Find(tables, key);
    if (part == nullptr) {
      value = nullptr;
    } else if (!part->seen(view)) {
      value = Placeholder(part->blank);
    }
  }
}

constexpr auto kCounts = std::to_array<Part>({
    {"total", Always},
    {"done", Always},
    {"success", SeesCounts},
    {"failure", SeesCounts},
    {"fault", SeesCounts},
});

// What lists, a submission's status and its evaluations have in common.
constexpr auto kSubmission = std::to_array<Part>({
    {"submission", Always},
    {"team", Always},
    {"track", Always},
    {"profile", Always},
    {"phase", Always},
    {"artefact", Always},
    {"name", Always},
    {"ranked", Always},
    {"state", Always},
    {"evaluation", Always},
    {"episodes", Always},
    {"accepted_at", Always},
    {"finished_at", Always},
});

constexpr auto kStatus = std::to_array<Part>({
    {"queue", Always},
    {"waiting", Always},
    {"reason", SeesReason},
    {"started_at", Always},
    {"running_wall_s", Always},
    {"remaining_wall_s", Always},
    {"estimated_end_at", Always},
    {"owner", Always},
    {"deadline_at", Always},
    {"history", Always},
    {"leases", Always},
    {"marks", Always},
    {"evaluations", Always},
    {"linked", Always},
    {"repeated", Always},
    {"cancel", Always},
    {"chosen", Always},
});

constexpr auto kTransition = std::to_array<Part>({
    {"at", Always}, {"of", Always}, {"from", Always},
    {"to", Always}, {"who", Always}, {"why", SeesReason},
});

// Where a lease stands shows how long each episode takes: a policy could tell by that what it sees.
constexpr auto kLease = std::to_array<Part>({
    {"lease", Always},
    {"first", Always},
    {"last", Always},
    {"state", Always},
    {"slot", Always},
    {"attempt", Always},
    {"faults", Always},
    {"episode", SeesProgress},
    {"step", SeesProgress},
    {"host", Always},
    {"process", Always},
    {"started_at", Always},
    {"deadline_at", Always},
    {"running_wall_s", Always},
    {"silent_wall_s", SeesProgress},
    {"detail", SeesOutput},
    {"attempts", SeesMetrics, Blank::kList},
});

constexpr auto kEvaluation = std::to_array<Part>({
    {"kind", Always},
    {"track_kind", Always},
    {"reason", SeesReason},
    {"first", Always},
    {"last", Always},
    {"started_at", Always},
    {"outcomes", SeesOutcomes, Blank::kObject},
    {"reasons", SeesOutcomes, Blank::kObject},
    {"aggregate", SeesAggregate},
    {"official_figures", Always},
    {"metrics", Always},
    {"hashes", Always},
    {"merkle_root", Always},
    {"grader", Always},
    {"limits", Always},
    {"output", SeesOutput, Blank::kList},
    {"not_repeatable", SeesComparison, Blank::kList},
    {"comparison", Always},
    {"episode_rows", Always},
    {"details_summary", SeesFacts},
    {"highlights", SeesComparison, Blank::kObject},
});

constexpr auto kComparison = std::to_array<Part>({
    {"with", Always},
    {"compared", Always},
    {"equal", SeesComparison},
    {"missing", Always},
    {"episodes", SeesComparison, Blank::kList},
});

constexpr auto kRow = std::to_array<Part>({
    {"index", Always},
    {"attempt", Always},
    {"seed", SeesSeeds},
    {"seed_commitment", Always},
    {"outcome", SeesOutcomes},
    {"reason", SeesOutcomes},
    {"end", SeesOutcomes},
    {"fault", SeesOutcomes},
    {"metrics", SeesMetrics, Blank::kObject},
    {"steps", SeesMetrics},
    {"sim_time_s", SeesMetrics},
    {"clipped", SeesMetrics},
    {"digest", SeesMetrics},
    {"actions_digest", SeesMetrics},
    {"wall_s", SeesMetrics},
    {"policy_cpu_s", SeesMetrics},
    {"log", SeesFacts},
    {"facts", SeesFacts},
    {"details", SeesFacts},
});

constexpr auto kFault = std::to_array<Part>({
    {"outcome", Always},
    {"whose", Always},
    {"limit", Always},
    {"limit_value", Always},
    {"value", SeesMetrics},
    {"step", SeesMetrics},
    {"detail", SeesOutput},
    {"stderr_tail", SeesOutput},
});

View ViewOf(const Json& answer, const Visibility& sight) {
  const std::string state = answer.value("state", "");
  return {.sight = sight,
          .complete = state == "done" || state == "failed",
          .grader_error = state == "grader_error",
          // A failed submission is charged as a failed try only, and one that ends by the grader's fault not
          // at all. So they tell one reason for the whole and nothing of their episodes, and nobody knows
          // of one that runs how it will end.
          .no_episodes = !sight.progress && state != "done" && state != "cancelled"};
}

void RedactCommon(Json& answer, const View& view) {
  Apply({kCounts}, view, answer["episodes"]);
  answer["withheld"] = WithheldParts(view.sight);
}

void RedactRow(Json& row, const View& view) {
  Apply({kRow}, view, row);
  Apply({kFault}, view, row["fault"]);
  // The metrics say of each episode whether it was a success.
  if (!view.sight.outcomes && row["metrics"].contains("success")) {
    row["metrics"]["success"] = nullptr;
  }
}

}  // namespace

void RedactEvaluation(Json& answer, const Visibility& sight) {
  if (SeesAll(sight)) return;
  const View view = ViewOf(answer, sight);
  Apply({kSubmission, kEvaluation}, view, answer);
  RedactCommon(answer, view);
  Apply({kComparison}, view, answer["comparison"]);
  for (const char* rows : {"episode_rows", "highlights"}) {
    if (!answer.contains(rows)) continue;
    for (Json& row : answer[rows]) RedactRow(row, view);
  }
  // Each block has a text of its own.
  if (view.no_episodes && answer["output"].size() > 1) answer["output"] = Json::array({answer["output"][0]});
}

void RedactStatus(Json& answer, const Visibility& sight) {
  if (SeesAll(sight)) return;
  const View view = ViewOf(answer, sight);
  Apply({kSubmission, kStatus}, view, answer);
  RedactCommon(answer, view);
  for (Json& entry : answer["history"]) Apply({kTransition}, view, entry);
  for (Json& lease : answer["leases"]) Apply({kLease}, view, lease);
}

void RedactListed(Json& entry, const Visibility& sight) {
  if (SeesAll(sight)) return;
  const View view = ViewOf(entry, sight);
  Apply({kSubmission}, view, entry);
  RedactCommon(entry, view);
}

void RedactLedgerRow(Json& row, const Visibility& sight) {
  if (!sight.outcomes) row["why"] = "withheld by the phase";
}

}  // namespace myograde::server
