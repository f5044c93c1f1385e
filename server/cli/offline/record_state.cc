#include "server/cli/offline/record_state.h"

#include <algorithm>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "server/cli/terminal/text.h"
#include "server/store/boards.h"
#include "server/store/record.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The functions below throw Json::exception where an entry lacks what its kind has; Add turns that
// into its sentence.
std::string TextOrEmpty(const Json& entry, const char* key) {
  const Json& value = entry.at(key);
  return value.is_null() ? "" : value.get<std::string>();
}

int64_t NumberOrZero(const Json& entry, const char* key) {
  const auto it = entry.find(key);
  return it == entry.end() || it->is_null() ? 0 : it->get<int64_t>();
}

int64_t MillisOf(const Json& entry) {
  absl::Time at;
  std::string error;
  const std::string text = entry.at("at").get<std::string>();
  if (!absl::ParseTime(absl::RFC3339_full, text, &at, &error)) return 0;
  return absl::ToUnixMillis(at);
}

}  // namespace

absl::Status RecordState::Add(int64_t index, const Json& entry) {
  try {
    const std::string kind = entry.at("kind").get<std::string>();
    if (entry.value("unreadable", false)) {
      ++unreadable_;
    } else if (kind == kAcceptedEntry) {
      return AddAccepted(index, entry);
    } else if (kind == kGradedEntry) {
      return AddGraded(index, entry);
    } else if (kind == kMarkedEntry) {
      AddMark(entry);
    } else if (kind == kChosenEntry) {
      choices_.push_back(entry.at("submission").get<int64_t>());
    } else if (kind == kTeamEntry) {
      AddTeam(entry);
    } else if (kind == kCommitmentEntry) {
      return AddCommitment(index, entry);
    } else if (kind == kPhaseEntry) {
      AddPhase(entry);
    } else if (kind == kRejudgeEntry) {
      AddRejudge(index, entry);
    } else if (kind == kKeyEntry) {
      key_ = entry.at("key").get<std::string>();
    } else if (kind != kConfigEntry) {
      return absl::InvalidArgumentError(
          absl::StrCat("entry ", index, " is of a kind that is not known here"));
    }
    return absl::OkStatus();
  } catch (const Json::exception&) {
    return absl::InvalidArgumentError(
        absl::StrCat("entry ", index, " lacks what an entry of its kind says"));
  }
}

absl::Status RecordState::AddAccepted(int64_t index, const Json& entry) {
  const int64_t team = entry.at("team_id").get<int64_t>();
  const int64_t id = entry.at("submission").get<int64_t>();
  if (submissions_.contains(id)) {
    return absl::InvalidArgumentError(
        absl::StrCat("entry ", index, " accepts submission ", id, " a second time"));
  }
  submissions_[id] = {
      .entry = index,
      .team = team,
      .track = entry.at("track").get<std::string>(),
      .profile = entry.at("profile").get<std::string>(),
      .phase = TextOrEmpty(entry, "phase"),
      .config = entry.at("config").get<std::string>(),
      .artefact = entry.at("artefact").get<std::string>()};
  // A team of an old store may have no entry of its own.
  teams_.try_emplace(team, RecordedTeam{.name = entry.at("team").get<std::string>()});
  return absl::OkStatus();
}

absl::Status RecordState::AddCommitment(int64_t index, const Json& entry) {
  const std::string name = entry.at("phase").get<std::string>();
  const std::string commitment = entry.at("commitment").get<std::string>();
  RecordedPhase& phase = phases_[name];
  if (!phase.commitment.empty() && phase.commitment != commitment) {
    return absl::InvalidArgumentError(
        absl::StrCat("entry ", index, " commits phase ", Harmless(name), " to another secret than entry ",
                     phase.commitment_entry, " did"));
  }
  if (!phase.commitment.empty()) return absl::OkStatus();
  phase.commitment = commitment;
  phase.commitment_entry = index;
  phase.further = entry.value("further", false);
  return absl::OkStatus();
}

absl::Status RecordState::AddGraded(int64_t index, const Json& entry) {
  const int64_t evaluation = entry.at("evaluation").get<int64_t>();
  if (results_.contains(evaluation)) {
    return absl::InvalidArgumentError(
        absl::StrCat("entry ", index, " ends evaluation ", evaluation, " a second time"));
  }
  results_[evaluation] = {
      .entry = index,
      .submission = entry.at("submission").get<int64_t>(),
      .graded = entry.at("state").get<std::string>() == "graded",
      .rejudge = NumberOrZero(entry, "rejudge"),
      .repetition = std::max<int64_t>(1, NumberOrZero(entry, "repetition")),
      .config = entry.at("config").get<std::string>()};
  return absl::OkStatus();
}

void RecordState::AddMark(const Json& entry) {
  const int64_t submission = entry.at("submission").get<int64_t>();
  const std::string name = entry.at("mark").get<std::string>();
  if (!entry.at("set").get<bool>()) {
    marks_[submission].erase(name);
    return;
  }
  MarkRow mark;
  mark.at = MillisOf(entry);
  mark.submission = submission;
  mark.mark = name;
  mark.set = true;
  mark.why = entry.value("reason", "");
  marks_[submission][name] = std::move(mark);
}

void RecordState::AddTeam(const Json& entry) {
  const std::string event = entry.at("event").get<std::string>();
  RecordedTeam& team = teams_[entry.at("team_id").get<int64_t>()];
  team.name = entry.at("team").get<std::string>();
  if (event == "banned" || event == "unbanned") team.banned = event == "banned";
  if (event == "merged") team.into = entry.at("into").get<int64_t>();
}

void RecordState::AddPhase(const Json& entry) {
  const std::string event = entry.at("event").get<std::string>();
  const std::string name = TextOrEmpty(entry, "phase");
  if (name.empty()) return;
  RecordedPhase& phase = phases_[name];
  phase.published = phase.published || event == "published";
  if (event != "revealed") return;
  phase.revealed = true;
  phase.secret = TextOrEmpty(entry, "secret");
}

void RecordState::AddRejudge(int64_t index, const Json& entry) {
  const int64_t rejudge = entry.at("rejudge").get<int64_t>();
  const std::string event = entry.at("event").get<std::string>();
  if (event == "created") newest_rejudge_ = index;
  if (event == "dropped") applied_.erase(rejudge);
  if (event != "applied") return;
  ever_applied_.insert(rejudge);
  if (entry.at("purpose") != "rules") return;
  applied_[rejudge] = {.entry = index, .to_config = entry.at("to_config").get<std::string>()};
}

// Merges are one after another, so a chain of them ends; a forged circle does not.
int64_t RecordState::TeamInForce(int64_t team) const {
  for (size_t steps = 0; steps < teams_.size(); ++steps) {
    const auto found = teams_.find(team);
    if (found == teams_.end() || found->second.into == 0) return team;
    team = found->second.into;
  }
  return team;
}

const RecordedTeam* RecordState::TeamOf(int64_t submission) const {
  const auto found = submissions_.find(submission);
  if (found == submissions_.end()) return nullptr;
  const auto team = teams_.find(TeamInForce(found->second.team));
  return team == teams_.end() ? nullptr : &team->second;
}

std::vector<int64_t> RecordState::AppliedTo(const std::string& config) const {
  std::vector<std::pair<int64_t, int64_t>> found;
  for (const auto& [rejudge, applied] : applied_) {
    if (applied.to_config == config) found.emplace_back(applied.entry, rejudge);
  }
  std::sort(found.begin(), found.end());
  std::vector<int64_t> rejudges;
  for (const auto& [entry, rejudge] : found) rejudges.push_back(rejudge);
  return rejudges;
}

std::map<int64_t, int64_t> RecordState::InForce(const std::string& config) const {
  std::vector<EndedResult> originals;
  std::map<int64_t, std::vector<EndedResult>> rejudged;
  for (const auto& [evaluation, result] : results_) {
    const auto submission = submissions_.find(result.submission);
    if (submission == submissions_.end() || result.repetition != 1) continue;
    const EndedResult ended{result.submission, evaluation, result.graded};
    if (result.rejudge != 0) {
      rejudged[result.rejudge].push_back(ended);
    } else if (submission->second.config == config) {
      originals.push_back(ended);
    }
  }
  std::vector<std::vector<EndedResult>> rejudges;
  for (const int64_t rejudge : AppliedTo(config)) rejudges.push_back(rejudged[rejudge]);
  return EvaluationsInForce(originals, rejudges);
}

std::set<int64_t> RecordState::Chosen(const std::string& config) const {
  const std::vector<int64_t> rejudges = AppliedTo(config);
  std::set<int64_t> rejudged;
  for (const auto& [evaluation, result] : results_) {
    const bool applied = std::find(rejudges.begin(), rejudges.end(), result.rejudge) != rejudges.end();
    if (applied && result.repetition == 1) rejudged.insert(result.submission);
  }
  std::vector<TeamChoice> choices;
  for (const int64_t submission : choices_) {
    const auto found = submissions_.find(submission);
    if (found == submissions_.end()) continue;
    choices.push_back({TeamInForce(found->second.team), submission,
                       found->second.config == config, rejudged.contains(submission)});
  }
  return StandingChoices(choices);
}

}  // namespace myograde::server
