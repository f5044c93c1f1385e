#include "server/board/board_state.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>

#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The functions below throw Json::exception where an act lacks what its kind has; Add turns that
// into its sentence.
int64_t NumberAt(const Json& content, const char* key) { return content.at(key).get<int64_t>(); }
std::string TextAt(const Json& content, const char* key) {
  return content.at(key).get<std::string>();
}

std::string TextOrEmpty(const Json& content, const char* key) {
  const auto found = content.find(key);
  return found == content.end() || found->is_null() ? "" : found->get<std::string>();
}

int64_t NumberOrZero(const Json& content, const char* key) {
  const auto found = content.find(key);
  return found == content.end() || found->is_null() ? 0 : found->get<int64_t>();
}

ActRow RowOf(const Act& act) {
  return {act.id, act.at, act.who, act.content.value("why", act.content.value("reason", ""))};
}

BoardName BoardAt(const Json& content) {
  return {TextOrEmpty(content, "phase"), TextAt(content, "track"), TextAt(content, "profile")};
}

void ReadDocument(const Json& document, RejudgeRow& rejudge) {
  rejudge.id = NumberAt(document, "rejudge");
  rejudge.purpose =
      ParseEnum<RejudgePurpose>(TextAt(document, "purpose")).value_or(RejudgePurpose::kRules);
  rejudge.board = BoardAt(document);
  rejudge.from_config = TextAt(document, "from_config");
  rejudge.to_config = TextAt(document, "to_config");
  rejudge.seeds = TextAt(document, "seeds");
  rejudge.method =
      ParseEnum<RejudgeMethod>(TextAt(document, "method")).value_or(RejudgeMethod::kAuto);
  rejudge.repeats = NumberAt(document, "repeats");
  rejudge.submissions = document.value("submissions", std::set<int64_t>());
  rejudge.who = TextAt(document, "who");
  rejudge.why = TextAt(document, "reason");
}

absl::Status Wrong(const Act& act, const auto&... parts) {
  return absl::InvalidArgumentError(absl::StrCat("entry ", act.entry, " ", parts...));
}

// The acts that change no board.
bool TouchesBoards(const Act& act) {
  return act.kind != kAcceptedAct && act.kind != kCommitmentAct && act.kind != kKeyAct &&
         !(act.kind == kTeamAct && act.content.value("event", "") == "created") &&
         !(act.kind == kGradedAct && !act.content.value("results", Json()).is_string() &&
           NumberOrZero(act.content, "rejudge") == 0);
}

}  // namespace

bool PhaseHistory::Has(const char* event) const {
  return std::ranges::find(events, event, &PhaseEventRow::event) != events.end();
}

const PhaseEventRow* PhaseHistory::Newest(const std::string& one, const std::string& other) const {
  const auto found = std::find_if(events.rbegin(), events.rend(), [&](const PhaseEventRow& event) {
    return event.event == one || event.event == other;
  });
  return found == events.rend() ? nullptr : &*found;
}

const PhaseEventRow* PhaseHistory::Pause() const {
  const PhaseEventRow* newest = Newest(kPausedEvent, kResumedEvent);
  return newest == nullptr || newest->event == kResumedEvent ? nullptr : newest;
}

// --- the fold ---

absl::Status BoardState::Add(const Act& act) {
  absl::Status applied;
  try {
    applied = Apply(act);
  } catch (const Json::exception&) {
    applied = Wrong(act, "lacks what an entry of its kind says");
  }
  last_ = act.id;
  if (!applied.ok()) damaged_[act.id] = std::string(applied.message());
  if (!applied.ok() || TouchesBoards(act)) board_changes_ = act.id;
  return applied;
}

absl::Status BoardState::Apply(const Act& act) {
  if (act.kind == kAcceptedAct) return AddAccepted(act);
  if (act.kind == kGradedAct) return AddGraded(act);
  if (act.kind == kCommitmentAct) return AddCommitment(act);
  if (act.kind == kMarkedAct) {
    AddMark(act);
  } else if (act.kind == kChosenAct) {
    choices_.push_back({act.at, NumberAt(act.content, "submission")});
  } else if (act.kind == kTeamAct) {
    AddTeam(act);
  } else if (act.kind == kPhaseAct) {
    AddPhase(act);
  } else if (act.kind == kRejudgeAct) {
    AddRejudge(act);
  } else if (act.kind == kConfigAct) {
    AddConfig(act);
  } else if (act.kind == kKeyAct) {
    key_ = TextAt(act.content, "key");
  } else {
    return Wrong(act, "is of a kind that is not known to this program");
  }
  return absl::OkStatus();
}

absl::Status BoardState::AddAccepted(const Act& act) {
  AcceptedSubmission submission{.id = NumberAt(act.content, "submission"),
                                .entry = act.entry,
                                .at = act.at,
                                .team = NumberAt(act.content, "team_id"),
                                .board = BoardAt(act.content),
                                .config = TextAt(act.content, "config"),
                                .artefact = TextAt(act.content, "artefact")};
  if (TeamState& team = teams_[submission.team]; team.name.empty()) {
    team.name = TextAt(act.content, "team");
  }
  const int64_t id = submission.id;
  if (!submissions_.emplace(id, std::move(submission)).second) {
    return Wrong(act, "accepts submission ", id, " a second time");
  }
  return absl::OkStatus();
}

absl::Status BoardState::AddGraded(const Act& act) {
  BoardResult ended{.evaluation = NumberAt(act.content, "evaluation"),
                    .entry = act.entry,
                    .at = act.at,
                    .submission = NumberAt(act.content, "submission"),
                    .config = TextAt(act.content, "config"),
                    .rejudge = NumberOrZero(act.content, "rejudge"),
                    .graded = TextAt(act.content, "state") == "graded",
                    .failed = act.content.value("failed", false)};
  const bool repeated = NumberOrZero(act.content, "repetition") > 1;
  const auto [place, added] = results_.emplace(ended.evaluation, std::move(ended));
  const BoardResult& result = place->second;
  if (!added) return Wrong(act, "ends evaluation ", result.evaluation, " a second time");
  if (result.rejudge == 0) {
    originals_[result.config].push_back(result.evaluation);
  } else if (!repeated) {
    rejudged_[result.rejudge].push_back(result.evaluation);
  }
  return absl::OkStatus();
}

absl::Status BoardState::AddCommitment(const Act& act) {
  const std::string name = TextAt(act.content, "phase");
  PhaseCommitment commitment{.commitment = TextAt(act.content, "commitment"),
                             .further = act.content.value("further", false),
                             .entry = act.entry};
  std::vector<PhaseCommitment>& all = phases_[name].commitments;
  if (!all.empty() && all.front().commitment != commitment.commitment) {
    return Wrong(act, "commits phase ", Sanitized(name), " to another secret than entry ",
                 all.front().entry, " did");
  }
  all.push_back(std::move(commitment));
  return absl::OkStatus();
}

void BoardState::AddMark(const Act& act) {
  MarkRow mark{RowOf(act), NumberAt(act.content, "submission"), TextAt(act.content, "mark"),
               act.content.at("set").get<bool>()};
  marks_[mark.submission].push_back(std::move(mark));
}

void BoardState::AddTeam(const Act& act) {
  TeamEventRow event{RowOf(act), /*team=*/"", TextAt(act.content, "event"),
                     act.content.value("detail", "")};
  const int64_t into = event.event == "merged" ? NumberAt(act.content, "into") : 0;
  std::string name = TextAt(act.content, "team");
  TeamState& team = teams_[NumberAt(act.content, "team_id")];
  team.name = std::move(name);
  if (event.event == "banned" || event.event == "unbanned") team.banned = event.event == "banned";
  if (into != 0) team.into = into;
  team.events.push_back(std::move(event));
}

void BoardState::AddPhase(const Act& act) {
  PhaseEventRow event{RowOf(act), TextOrEmpty(act.content, "phase"), TextAt(act.content, "event")};
  PhaseHistory& phase = phases_[event.phase];
  if (event.event == kRevealedEvent) phase.secret = TextOrEmpty(act.content, "secret");
  phase.events.push_back(std::move(event));
}

void BoardState::AddConfig(const Act& act) {
  const int64_t rejudge = NumberOrZero(act.content, "rejudge");
  configs_[BoardAt(act.content)].push_back(
      {RowOf(act), TextAt(act.content, "config"), rejudge,
       FindOrNone(rejudges_, rejudge).from_config});
}

// Until a rejudge is applied, a public record tells nothing but that it was created.
void BoardState::AddRejudge(const Act& act) {
  RejudgeEventRow event{
      RowOf(act), NumberAt(act.content, "rejudge"),
      ParseEnum<RejudgeEvent>(TextAt(act.content, "event")).value_or(RejudgeEvent::kCreated),
      /*document=*/{}, TextAt(act.content, "signature")};
  RejudgeRow rejudge = FindOrNone(rejudges_, event.rejudge);
  if (const auto document = act.content.find("document"); document != act.content.end()) {
    event.who = TextAt(*document, "who");
    event.why = TextAt(*document, "reason");
    event.document = *document;
    if (rejudge.to_config.empty()) ReadDocument(*document, rejudge);
  }
  if (event.event == RejudgeEvent::kCreated) rejudge.at = act.at;
  rejudge.id = event.rejudge;
  rejudge.events.push_back(std::move(event));
  rejudges_[rejudge.id] = std::move(rejudge);
}

// --- teams, marks, phases, rejudges ---

// Merges are one after another, so a chain of them ends; a forged circle does not.
int64_t BoardState::TeamInForce(int64_t team) const {
  for (size_t steps = 0; steps < teams_.size(); ++steps) {
    const auto found = teams_.find(team);
    if (found == teams_.end() || found->second.into == 0) return team;
    team = found->second.into;
  }
  return team;
}

const TeamState* BoardState::TeamOf(int64_t submission) const {
  const auto found = submissions_.find(submission);
  if (found == submissions_.end()) return nullptr;
  const auto team = teams_.find(TeamInForce(found->second.team));
  return team == teams_.end() ? nullptr : &team->second;
}

std::vector<TeamEventRow> BoardState::TeamEvents(int64_t team) const {
  std::vector<TeamEventRow> events;
  for (const auto& [id, each] : teams_) {
    if (TeamInForce(id) != team) continue;
    for (TeamEventRow event : each.events) {
      event.team = each.name;
      events.push_back(std::move(event));
    }
  }
  std::ranges::sort(events, {}, &TeamEventRow::id);
  return events;
}

const std::vector<MarkRow>& BoardState::MarkHistory(int64_t submission) const {
  return FindOrNone(marks_, submission);
}

bool BoardState::HasCommitted(const std::string& phase) const {
  const std::vector<PhaseCommitment>& all = Phase(phase).commitments;
  return std::ranges::find(all, false, &PhaseCommitment::further) != all.end();
}

const RejudgeRow* BoardState::Rejudge(int64_t id) const {
  const auto found = rejudges_.find(id);
  return found == rejudges_.end() ? nullptr : &found->second;
}

bool BoardState::WasApplied(int64_t rejudge) const {
  const std::vector<RejudgeEventRow>& events = FindOrNone(rejudges_, rejudge).events;
  return std::ranges::find(events, RejudgeEvent::kApplied, &RejudgeEventRow::event) != events.end();
}

bool BoardState::IsShown(int64_t rejudge) const {
  if (rejudge == 0 || WasApplied(rejudge)) return true;
  const RejudgeRow& row = FindOrNone(rejudges_, rejudge);
  return row.purpose == RejudgePurpose::kSeeds && Phase(row.board.phase).Has(kRevealedEvent);
}

int64_t BoardState::NewestChoice(int64_t team, const BoardName& board) const {
  for (auto choice = choices_.rbegin(); choice != choices_.rend(); ++choice) {
    const auto found = submissions_.find(choice->submission);
    if (found != submissions_.end() && found->second.board == board &&
        TeamInForce(found->second.team) == TeamInForce(team)) {
      return choice->submission;
    }
  }
  return 0;
}

}  // namespace myograde::server
