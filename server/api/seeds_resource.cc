#include "server/api/resources.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/lease/seed_commitment.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/rejudge_plan.h"
#include "server/challenge/phases.h"
#include "server/engine/rejudges.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

// The further seeds of a phase that has `own` seeds: those that its secret gives after them.
std::vector<uint64_t> FurtherSeeds(const std::string& secret, const std::string& phase, size_t own,
                                   int64_t count) {
  const std::vector<uint64_t> all = DeriveSeeds(secret, phase, static_cast<int64_t>(own) + count);
  return {all.begin() + static_cast<std::ptrdiff_t>(own), all.end()};
}

// The further seeds of a phase from the first to the last that was played, or will be.
absl::StatusOr<std::vector<uint64_t>> PlayedFurtherSeeds(const Transaction& reader,
                                                         const std::string& phase,
                                                         const std::string& secret) {
  std::set<uint64_t> played;
  size_t own = 0;
  for (const auto& [id, rejudge] : reader.Board().rejudges()) {
    if (rejudge.purpose != RejudgePurpose::kSeeds || rejudge.board.phase != phase) continue;
    ASSIGN_OR_RETURN(const std::vector<uint64_t> seeds, StoredSeeds(reader, rejudge.seeds));
    ASSIGN_OR_RETURN(const TrackPtr from, StoredTrack(reader, rejudge.from_config));
    own = from->config.seeds.size();
    played.insert(seeds.begin(), seeds.end());
  }
  if (played.empty()) return std::vector<uint64_t>();
  std::vector<uint64_t> further =
      FurtherSeeds(secret, phase, own, kMaxEpisodes - static_cast<int64_t>(own));
  while (!further.empty() && !played.contains(further.back())) further.pop_back();
  return further;
}

struct HiddenSeeds {
  std::string secret;           // 32 bytes
  std::vector<uint64_t> seeds;  // of the phase, which may be public
  std::vector<uint64_t>
      further;  // that follow from the secret after them, as far as they were played
};

// Before the close a reveal would end the phase for good, so nothing does it early.
absl::Status CheckOver(const PhaseConfig& phase, absl::Time now) {
  if (now >= phase.closes) return absl::OkStatus();
  const std::string when =
      phase.closes == absl::InfiniteFuture()
          ? "it never closes; set its \"closes_at\" first"
          : absl::StrCat("it closes at ", UtcText(phase.closes), "; reveal it afterwards");
  return absl::FailedPreconditionError(
      absl::StrCat("the seeds of phase \"", phase.name,
                   "\" can't be revealed while it accepts submissions: ", when));
}

absl::Status NothingToReveal(const std::string& phase) {
  return absl::FailedPreconditionError(
      absl::StrCat("the seeds of phase \"", phase, "\" are public; there is nothing to reveal"));
}

absl::StatusOr<HiddenSeeds> SeedsToReveal(const Transaction& reader, const ApiContext& context,
                                          const std::string& name) {
  ASSIGN_OR_RETURN(const TrackPtr track, TrackInForce(reader, context, {name, "", ""}));
  const TrackConfig& config = track->config;
  const bool is_public = config.seed_salt.empty();
  absl::StatusOr<std::string> secret = reader.phases.Secret(name);
  if (absl::IsNotFound(secret.status()) && is_public) return NothingToReveal(name);
  if (const PhaseConfig* phase = context.phases.ConfigOf(name)) {
    const absl::Time now = context.clock.Now();
    const absl::Status over = CheckOver(*phase, now);
    // To move its close afterwards hides nothing again.
    if (!over.ok() && !reader.Board().Phase(name).Has(kRevealedEvent)) return over;
  }
  if (absl::IsNotFound(secret.status())) {
    return absl::FailedPreconditionError(absl::StrCat(
        "this store does not have the secret of phase \"", name,
        "\", because exports leave it out; reveal it on the server that ran the phase, with "
        "\"myograde phase seeds reveal --secret\""));
  }
  if (!secret.ok()) return secret.status();
  ASSIGN_OR_RETURN(std::vector<uint64_t> further, PlayedFurtherSeeds(reader, name, *secret));
  if (is_public && further.empty()) return NothingToReveal(name);
  return HiddenSeeds{*std::move(secret), config.seeds, std::move(further)};
}

ApiResult RevealSeeds(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const std::string reason, ParseReason(body));
  const std::string phase = request.matches[1];
  ASSIGN_OR_RETURN(const HiddenSeeds hidden, ReadStore(context, [&](const Transaction& reader) {
    return SeedsToReveal(reader, context, phase);
  }));
  const auto reveal = [phase, reason, who = CallerKey()](Transaction& writer) {
    return writer.phases.AddEvent(phase, kRevealedEvent, who, reason);
  };
  ASSIGN_OR_RETURN(const bool changed, ChangeStore(context, reveal));
  NoteAct(absl::StrCat("phase ", phase), kRevealedEvent);
  return ApiAnswer{200,
                   {{"phase", phase},
                    {"event", kRevealedEvent},
                    {"changed", changed},
                    {"reason", reason},
                    {"commitment", SecretCommitment(hidden.secret)},
                    {"secret", absl::BytesToHexString(hidden.secret)},
                    {"seeds_sha256", SeedListHash(hidden.seeds)},
                    {"seeds", hidden.seeds},
                    {"further_seeds", hidden.further}}};
}

constexpr int64_t kMostPlaces = 1'000'000;

// The body of POST /v1/phases/NAME/more-seeds.
struct MoreSeedsRequest {
  std::string phase;
  std::string board;     // whose order is asked about
  int64_t episodes = 0;  // further ones that each of the submissions is to have in the end
  // First and last rank by the rules; 0 and 0: all rows that share a group.
  std::pair<int64_t, int64_t> places = {0, 0};
  std::string reason;
};

std::pair<int64_t, int64_t> ReadPlaces(ConfigReader& reader) {
  if (!reader.Has("places")) return {0, 0};
  const Json& places = reader.Array("places");
  const bool numbers =
      places.size() == 2 && places[0].is_number_integer() && places[1].is_number_integer();
  const std::pair<int64_t, int64_t> range =
      numbers ? std::pair(places[0].get<int64_t>(), places[1].get<int64_t>()) : std::pair(0L, 0L);
  if (range.first < 1 || range.second <= range.first || range.second > kMostPlaces) {
    reader.Fail("places", "must be the first and the last of at least two ranks, as in [2, 4]");
  }
  return range;
}

// The submissions of all groups of more than one row.
std::vector<int64_t> UndecidedOf(const Leaderboard& board, const BoardStatistics& statistics) {
  std::map<int64_t, std::vector<int64_t>> groups;
  for (const TestedPlace& tested : statistics.places) {
    groups[tested.place.group].push_back(board.rows[tested.row].source.submission);
  }
  std::vector<int64_t> undecided;
  for (const auto& [group, submissions] : groups) {
    if (submissions.size() < 2) continue;
    undecided.insert(undecided.end(), submissions.begin(), submissions.end());
  }
  return undecided;
}

absl::StatusOr<std::vector<int64_t>> ChosenRows(const Transaction& reader,
                                                const ApiContext& context, const Track& track,
                                                const MoreSeedsRequest& request) {
  ASSIGN_OR_RETURN(const Leaderboard board, BoardUnder(reader, track, request.board, {}));
  std::vector<int64_t> chosen;
  if (const auto [first, last] = request.places; first != 0) {
    for (const LeaderboardRow& row : board.rows) {
      const int64_t rank = row.ranked.rank;
      if (rank >= first && rank <= last) chosen.push_back(row.source.submission);
    }
    if (chosen.size() >= 2) return chosen;
    return absl::InvalidArgumentError(absl::StrCat("the board has ", chosen.size(),
                                                   " rows at the places ", first, " to ", last,
                                                   "; a comparison needs two"));
  }
  ASSIGN_OR_RETURN(
      const BoardStatistics statistics,
      ComputeStatistics(reader, track, track.scoring.boards.at(request.board).rules, board,
                        FindStatisticsConfig(context, request.phase).groups, INT64_MAX));
  chosen = UndecidedOf(board, statistics);
  if (!chosen.empty()) return chosen;
  return absl::FailedPreconditionError(
      absl::StrCat("no two of the ", statistics.places.size(),
                   " tested places share a group, so their order is decided; give \"places\" to "
                   "choose others"));
}

// How many of `seeds` a submission has, or will have, from the first on.
size_t SeedsHad(const std::vector<FurtherItem>& items, const std::vector<uint64_t>& seeds) {
  std::set<uint64_t> had;
  for (const FurtherItem& item : items) {
    if (!item.dropped) had.insert(item.seeds.begin(), item.seeds.end());
  }
  const auto lacks =
      std::find_if(seeds.begin(), seeds.end(), [&](uint64_t seed) { return !had.contains(seed); });
  return static_cast<size_t>(lacks - seeds.begin());
}

// The board's config with other seeds. They stay hidden, also where the phase's own are public.
absl::StatusOr<NewRejudge> RejudgeWith(const TrackConfig& live, const std::string& secret,
                                       const std::vector<uint64_t>& seeds,
                                       const std::string& reason) {
  const PhaseSecrets secrets = SecretsOfPhase(secret, live.phase);
  ASSIGN_OR_RETURN(const TrackConfig to,
                   WithPhase(live, {{"phase", live.phase},
                                    {"seeds", seeds},
                                    {"policy_seed_secret", secrets.policy_seed_secret},
                                    {"seed_salt", secrets.seed_salt}}));
  NewRejudge rejudge = RejudgeBetween(live, to);
  rejudge.purpose = RejudgePurpose::kSeeds;
  rejudge.method = RejudgeMethod::kPlay;
  rejudge.why = reason;
  return rejudge;
}

absl::StatusOr<MoreSeedsRequest> ParseMoreSeeds(const Json& body, const std::string& phase) {
  ConfigReader reader(body, "request");
  MoreSeedsRequest request;
  request.phase = phase;
  request.board = reader.Has("board") ? reader.String("board") : scoring::kMainBoard;
  request.episodes = reader.Integer("episodes", 1, kMaxEpisodes);
  request.places = ReadPlaces(reader);
  request.reason = ReadReason(reader);
  RETURN_IF_ERROR(reader.Finish());
  return request;
}

// What the store is to create: one rejudge for all submissions that lack the same seeds.
// FailedPreconditionError: nothing is undecided, or all have as many already; InvalidArgumentError:
// there are no such places, or too many episodes. `secret`: the phase's.
absl::StatusOr<std::vector<NewRejudge>> MakeFurtherRejudges(const Transaction& reader,
                                                            const ApiContext& context,
                                                            const MoreSeedsRequest& request,
                                                            const std::string& secret) {
  ASSIGN_OR_RETURN(const TrackPtr track, TrackInForce(reader, context, {request.phase, "", ""}));
  const TrackConfig& live = track->config;
  if (const int64_t most = kMaxEpisodes - std::ssize(live.seeds); request.episodes > most) {
    return absl::InvalidArgumentError(absl::StrCat("\"episodes\" is ", request.episodes,
                                                   ", and phase \"", live.phase, "\" can have ",
                                                   most, " further ones at most"));
  }
  ASSIGN_OR_RETURN(const std::vector<int64_t> rows, ChosenRows(reader, context, *track, request));
  ASSIGN_OR_RETURN(FurtherItems items, ListFurtherItems(reader, live.hash));
  const std::vector<uint64_t> seeds =
      FurtherSeeds(secret, request.phase, live.seeds.size(), request.episodes);
  std::map<size_t, std::set<int64_t>> lacking;  // submissions by what they have
  for (const int64_t submission : rows) {
    const size_t had = SeedsHad(items[submission], seeds);
    if (had < seeds.size()) lacking[had].insert(submission);
  }
  if (lacking.empty()) {
    return absl::FailedPreconditionError(absl::StrCat("each of the ", rows.size(),
                                                      " submissions has ", request.episodes,
                                                      " further episodes already; ask for a larger "
                                                      "number"));
  }
  std::vector<NewRejudge> rejudges;
  for (auto& [had, submissions] : lacking) {
    const std::vector<uint64_t> missing(seeds.begin() + static_cast<std::ptrdiff_t>(had),
                                        seeds.end());
    ASSIGN_OR_RETURN(NewRejudge rejudge, RejudgeWith(live, secret, missing, request.reason));
    rejudge.submissions = std::move(submissions);
    rejudges.push_back(std::move(rejudge));
  }
  return rejudges;
}

// The secret of a phase. One whose own seeds are public gets one for its further seeds.
absl::StatusOr<std::string> SecretOfPhase(const ApiContext& context, const std::string& phase) {
  bool hidden = false;
  absl::StatusOr<std::string> secret = context.readers.Read<std::string>(
      [&](const Transaction& reader) -> absl::StatusOr<std::string> {
        ASSIGN_OR_RETURN(const TrackPtr track, TrackInForce(reader, context, {phase, "", ""}));
        hidden = !track->config.seed_salt.empty();
        return reader.phases.Secret(phase);
      });
  if (!absl::IsNotFound(secret.status())) return secret;
  if (hidden) {
    return absl::FailedPreconditionError(absl::StrCat(
        "this store does not have the secret of phase \"", phase,
        "\", because exports leave it out; only the server that ran the phase can draw further "
        "seeds"));
  }
  return ChangeStore(context, [phase](Transaction& writer) {
    return writer.phases.EnsureSecret(phase, "", /*further=*/true);
  });
}

ApiResult PlayMoreSeeds(const ApiContext& context, const Request& request, const Json& body) {
  ASSIGN_OR_RETURN(const MoreSeedsRequest asked, ParseMoreSeeds(body, request.matches[1]));
  ASSIGN_OR_RETURN(const std::string secret, SecretOfPhase(context, asked.phase));
  ASSIGN_OR_RETURN(const auto rejudges, ReadStore(context, [&](const Transaction& reader) {
    return MakeFurtherRejudges(reader, context, asked, secret);
  }));
  ASSIGN_OR_RETURN(const SignDocument sign, RejudgeSigner(context));
  Json created = Json::array();
  for (const NewRejudge& rejudge : rejudges) {
    ASSIGN_OR_RETURN(
        const RejudgePlan plan,
        context.engine.CreateRejudge(rejudge, sign, CallerKey(), context.config.http.request));
    NoteAct(absl::StrCat("rejudge ", plan.rejudge), "created for further episodes");
    created.push_back({{"rejudge", plan.rejudge},
                       {"episodes", Json::parse(rejudge.seeds_json).size()},
                       {"seeds_sha256", rejudge.seeds},
                       {"submissions", rejudge.submissions},
                       {"without_files", plan.without_files}});
  }
  return ApiAnswer{201,
                   {{"phase", asked.phase},
                    {"board", asked.board},
                    {"episodes", asked.episodes},
                    {"commitment", SecretCommitment(secret)},
                    {"reason", asked.reason},
                    {"rejudges", std::move(created)}}};
}

}  // namespace

void AddSeeds(Routes& routes, const ApiContext& context) {
  routes.Post("/v1/phases/([a-z0-9-]{1,64})/reveal", Action::kManagePhases,
              Bind(context, RevealSeeds));
  routes.Post("/v1/phases/([a-z0-9-]{1,64})/more-seeds", Action::kManagePhases,
              Bind(context, PlayMoreSeeds));
}

}  // namespace myograde::server
