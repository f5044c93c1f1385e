#include "server/api/more_seeds.h"

#include <algorithm>
#include <map>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/seed_commitment.h"
#include "server/api/board_source.h"
#include "server/api/board_statistics.h"
#include "server/api/rejudge_plan.h"
#include "server/api/requests.h"
#include "server/api/http_server.h"
#include "server/engine/stored.h"
#include "server/proof/seed_list.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kMostPlaces = 1'000'000;

std::pair<int64_t, int64_t> ReadPlaces(ConfigReader& reader) {
  if (!reader.Has("places")) return {0, 0};
  const Json& places = reader.Array("places");
  const bool numbers = places.size() == 2 && places[0].is_number_integer() &&
                       places[1].is_number_integer();
  const std::pair<int64_t, int64_t> range =
      numbers ? std::pair(places[0].get<int64_t>(), places[1].get<int64_t>()) : std::pair(0L, 0L);
  if (range.first < 1 || range.second <= range.first || range.second > kMostPlaces) {
    reader.Fail("places", "must be the first and the last of at least two ranks, as in [2, 4]");
  }
  return range;
}

bool IsWithin(int64_t rank, std::pair<int64_t, int64_t> places) {
  return rank >= places.first && rank <= places.second;
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

absl::StatusOr<std::vector<int64_t>> ChosenRows(Reader& reader, const ApiContext& context,
                                                const Track& track,
                                                const MoreSeedsRequest& request) {
  const absl::StatusOr<Leaderboard> board = BoardUnder(reader, track, request.board, {});
  if (!board.ok()) return board.status();
  std::vector<int64_t> chosen;
  if (request.places.first != 0) {
    for (const LeaderboardRow& row : board->rows) {
      if (IsWithin(row.ranked.rank, request.places)) chosen.push_back(row.source.submission);
    }
    if (chosen.size() >= 2) return chosen;
    return absl::InvalidArgumentError(
        absl::StrCat("the board has ", chosen.size(), " rows at the places ", request.places.first,
                     " to ", request.places.second, "; it takes two to compare"));
  }
  ASSIGN_OR_RETURN(const BoardStatistics statistics,
                   StatisticsOf(reader, track, track.scoring.boards.at(request.board).rules, *board,
                                StatisticsConfigOf(context, request.phase).groups, INT64_MAX,
                                HttpServer::IsOver));
  chosen = UndecidedOf(*board, statistics);
  if (!chosen.empty()) return chosen;
  return absl::FailedPreconditionError(
      absl::StrCat("no two of the ", statistics.places.size(), " tested places share a group, so "
                   "their order is decided; name \"places\" for others"));
}

// How many of `seeds` a submission has, or will have, from the first on.
size_t SeedsHad(const std::vector<FurtherItem>& items, const std::vector<uint64_t>& seeds) {
  std::set<uint64_t> had;
  for (const FurtherItem& item : items) {
    if (!item.dropped) had.insert(item.seeds.begin(), item.seeds.end());
  }
  const auto lacks = std::find_if(seeds.begin(), seeds.end(),
                                  [&](uint64_t seed) { return !had.contains(seed); });
  return static_cast<size_t>(lacks - seeds.begin());
}

// The board's config with other seeds. They stay hidden, also where the phase's own are public.
absl::StatusOr<NewRejudge> RejudgeWith(const TrackConfig& live, const std::string& secret,
                                       const std::vector<uint64_t>& seeds,
                                       const std::string& reason) {
  const PhaseSecrets secrets = SecretsOfPhase(secret, live.phase);
  ASSIGN_OR_RETURN(const TrackConfig to, WithPhase(live, {{"phase", live.phase},
                       {"seeds", seeds},
                       {"policy_seed_secret", secrets.policy_seed_secret},
                       {"seed_salt", secrets.seed_salt}}));
  NewRejudge rejudge;
  rejudge.purpose = RejudgePurpose::kSeeds;
  rejudge.phase = live.phase;
  rejudge.track = live.id;
  rejudge.profile = live.profile;
  rejudge.from_config = live.hash;
  rejudge.from_config_json = CanonicalJson(live.effective);
  rejudge.to_config = to.hash;
  rejudge.to_config_json = CanonicalJson(to.effective);
  rejudge.seeds_json = CanonicalJson(Json(to.seeds));
  rejudge.seeds = Sha256Hex(rejudge.seeds_json);
  rejudge.seed_count = static_cast<int64_t>(to.seeds.size());
  rejudge.method = RejudgeMethod::kPlay;
  rejudge.why = reason;
  return rejudge;
}

absl::Status CheckCount(const TrackConfig& live, int64_t episodes) {
  const int64_t most = kMaxEpisodes - static_cast<int64_t>(live.seeds.size());
  if (episodes <= most) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("\"episodes\" is ", episodes, ", and phase \"",
                                                 live.phase, "\" can have ", most,
                                                 " further ones at most"));
}

}  // namespace

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

std::vector<uint64_t> FurtherSeeds(const std::string& secret, const std::string& phase, size_t own,
                                   int64_t count) {
  const std::vector<uint64_t> all =
      DeriveSeeds(secret, phase, static_cast<int64_t>(own) + count);
  return {all.begin() + static_cast<std::ptrdiff_t>(own), all.end()};
}

absl::StatusOr<std::vector<uint64_t>> PlayedFurtherSeeds(Reader& reader, const std::string& phase,
                                                         const std::string& secret) {
  std::set<uint64_t> played;
  size_t own = 0;
  for (const RejudgeRow& rejudge : reader.Rejudges().rows) {
    if (rejudge.purpose != RejudgePurpose::kSeeds || rejudge.phase != phase) continue;
    ASSIGN_OR_RETURN(const std::vector<uint64_t> seeds, SeedsOfRejudge(reader, rejudge));
    ASSIGN_OR_RETURN(const TrackConfig config, StoredConfig(reader, rejudge.from_config));
    own = config.seeds.size();
    played.insert(seeds.begin(), seeds.end());
  }
  if (played.empty()) return std::vector<uint64_t>();
  std::vector<uint64_t> further =
      FurtherSeeds(secret, phase, own, kMaxEpisodes - static_cast<int64_t>(own));
  while (!further.empty() && !played.contains(further.back())) further.pop_back();
  return further;
}

absl::StatusOr<std::vector<NewRejudge>> MakeFurtherRejudges(Reader& reader,
                                                            const ApiContext& context,
                                                            const MoreSeedsRequest& request,
                                                            const std::string& secret) {
  ASSIGN_OR_RETURN(const TrackPtr track, TrackInForce(reader, context, request.phase, "", ""));
  const TrackConfig& live = track->config;
  RETURN_IF_ERROR(CheckCount(live, request.episodes));
  ASSIGN_OR_RETURN(const std::vector<int64_t> rows, ChosenRows(reader, context, *track, request));
  ASSIGN_OR_RETURN(FurtherItems items, FurtherItemsOf(reader, live.hash));
  const std::vector<uint64_t> seeds =
      FurtherSeeds(secret, request.phase, live.seeds.size(), request.episodes);
  std::map<size_t, std::vector<int64_t>> lacking;  // submissions by what they have
  for (const int64_t submission : rows) {
    const size_t had = SeedsHad(items[submission], seeds);
    if (had < seeds.size()) lacking[had].push_back(submission);
  }
  if (lacking.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("each of the ", rows.size(), " submissions has ", request.episodes,
                     " further episodes already; ask for more"));
  }
  std::vector<NewRejudge> rejudges;
  for (auto& [had, submissions] : lacking) {
    const std::vector<uint64_t> missing(seeds.begin() + static_cast<std::ptrdiff_t>(had),
                                        seeds.end());
    ASSIGN_OR_RETURN(NewRejudge rejudge, RejudgeWith(live, secret, missing, request.reason));
    rejudge.submissions = std::move(submissions);
    std::sort(rejudge.submissions.begin(), rejudge.submissions.end());
    rejudges.push_back(std::move(rejudge));
  }
  return rejudges;
}

}  // namespace myograde::server
