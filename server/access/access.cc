#include "server/access/access.h"

#include <algorithm>
#include <array>
#include <utility>

namespace myograde::server {
namespace {

// In the order of Role.
constexpr std::array<std::string_view, 4> kRoles = {"public", "participant", "organiser",
                                                    "operator"};

struct Rule {
  Action action;
  std::string_view name;
  Role role;
  bool of_a_team = false;
};

constexpr Rule kRules[] = {
    {Action::kReadHealth, "read health", Role::kPublic},
    {Action::kReadTracks, "read tracks", Role::kPublic},
    {Action::kReadBoard, "read board", Role::kPublic},
    {Action::kReadReplay, "read replay", Role::kPublic},
    {Action::kReadChallenge, "read challenge", Role::kPublic},
    {Action::kReadKey, "read key", Role::kPublic},
    {Action::kReadRecord, "read record", Role::kPublic},
    {Action::kReadApi, "read API", Role::kPublic},
    {Action::kUpload, "upload", Role::kParticipant, true},
    {Action::kSubmit, "submit", Role::kParticipant, true},
    {Action::kReadSubmission, "read submission", Role::kParticipant, true},
    {Action::kCancel, "cancel", Role::kParticipant, true},
    {Action::kRerun, "rerun", Role::kParticipant, true},
    {Action::kReadReceipt, "read receipt", Role::kParticipant, true},
    {Action::kReadLog, "read log", Role::kParticipant, true},
    {Action::kReadQuota, "read quota", Role::kParticipant, true},
    {Action::kChoose, "choose", Role::kParticipant, true},
    {Action::kReadTeam, "read team", Role::kParticipant, true},
    {Action::kMark, "mark", Role::kOrganiser},
    {Action::kGrant, "grant", Role::kOrganiser},
    {Action::kRebuildBoards, "rebuild boards", Role::kOrganiser},
    {Action::kExport, "export", Role::kOrganiser},
    {Action::kManageTeams, "manage teams", Role::kOrganiser},
    {Action::kManageTokens, "manage tokens", Role::kOrganiser},
    {Action::kManagePhases, "manage phases", Role::kOrganiser},
    {Action::kRejudge, "rejudge", Role::kOrganiser},
    {Action::kReadEvents, "read events", Role::kOrganiser},
    {Action::kReadHost, "read host", Role::kOrganiser},
    {Action::kReadMetrics, "read metrics", Role::kOrganiser},
    {Action::kImport, "import", Role::kOperator},
    {Action::kBackup, "back up", Role::kOperator},
    {Action::kManageOperators, "manage operators", Role::kOperator},
    {Action::kManageWebhooks, "manage webhooks", Role::kOperator},
    {Action::kManageNodes, "manage nodes", Role::kOperator},
};

// RuleOf finds a rule by its place.
static_assert([] {
  for (size_t i = 0; i < std::size(kRules); ++i) {
    if (static_cast<size_t>(kRules[i].action) != i) return false;
  }
  return true;
}());

const Rule& RuleOf(Action action) { return kRules[static_cast<size_t>(action)]; }

}  // namespace

std::string_view RoleName(Role role) { return kRoles[static_cast<size_t>(role)]; }

std::optional<Role> ParseRole(std::string_view name) {
  const auto* found = std::find(kRoles.begin(), kRoles.end(), name);
  if (found == kRoles.end()) return std::nullopt;
  return static_cast<Role>(found - kRoles.begin());
}

std::string_view ActionName(Action action) { return RuleOf(action).name; }

Role RoleFor(Action action) { return RuleOf(action).role; }

bool NeedsTeam(Action action) { return RuleOf(action).of_a_team; }

bool MayTake(const Identity& identity, Action action, const std::optional<std::string>& team) {
  const Rule& rule = RuleOf(action);
  if (action == Action::kReadMetrics && identity.scraper) return true;
  if (identity.role < rule.role) return false;
  const bool any_team = identity.role >= Role::kOrganiser || !rule.of_a_team;
  return any_team || !team.has_value() || identity.teams.contains(*team);
}

Visibility ComputeVisibility(Role role, const PhaseVisibility& phase) {
  if (role >= Role::kOrganiser) return {};
  Visibility visibility = phase.published || phase.revealed ? Visibility{} : phase.shown;
  visibility.seeds = !phase.committed || phase.revealed;
  visibility.progress = true;
  visibility.progress = phase.published || phase.revealed || SeesAll(visibility);
  return visibility;
}

bool IsReplayPublic(bool allowed, const PhaseVisibility& phase) {
  Visibility visibility = ComputeVisibility(Role::kPublic, phase);
  // A replay tells neither what a policy printed nor what runs.
  visibility.output = true;
  visibility.progress = true;
  return allowed && SeesAll(visibility);
}

std::vector<std::string_view> WithheldParts(const Visibility& visibility) {
  std::vector<std::string_view> parts;
  for (const auto& [name, seen] : {std::pair("aggregate", visibility.aggregate),
                                   std::pair("outcomes", visibility.outcomes),
                                   std::pair("metrics", visibility.metrics),
                                   std::pair("logs", visibility.logs),
                                   std::pair("output", visibility.output),
                                   std::pair("seeds", visibility.seeds)}) {
    if (!seen) parts.emplace_back(name);
  }
  return parts;
}

}  // namespace myograde::server
