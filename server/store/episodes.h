// Episodes in the store, and what of two runs of one is compared.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/rows.h"

namespace myograde::server {

// The names of what differs, in this order: seed, outcome, reason, metrics, steps, sim_time,
// clipped, facts (everything else), digest. Values are compared bit for bit; what depends on the
// host's clock is left out.
std::vector<std::string> DifferencesBetween(const EpisodeRow& a, const EpisodeRow& b);

// A row's canonical bytes for the hash over an evaluation's results: index, seed, outcome, reason,
// metrics, steps and digest. With the salt of a config that hides its seeds
// (TrackConfig::seed_salt), "seed_commitment" takes the place of the seed; "" for all others.
std::string CanonicalResult(const EpisodeRow& row, const std::string& seed_salt);

// Episodes, their logs, and what evaluations are ranked by.
class Episodes : StorePart {
 public:
  using StorePart::StorePart;

  absl::StatusOr<std::vector<EpisodeRow>> Of(int64_t evaluation) const;  // by index
  absl::StatusOr<std::vector<RepeatRow>> Repeats(int64_t evaluation) const;
  // `ended_blocks`: only episodes of blocks that have ended, so that nothing tells how far one is.
  EpisodeCounts Counts(int64_t evaluation, bool ended_blocks = false) const;
  // The teams one of whose episodes has the log with this SHA-256, with the phases of those
  // episodes ("": of none).
  std::map<std::string, std::set<std::string>> TeamsOfLog(const std::string& sha256) const;
  // The first episode with this log. NotFoundError: there is none.
  absl::StatusOr<EpisodeRow> OfLog(const std::string& sha256) const;
  // Hashes of the logs of evaluations that have not ended, or are done and ranked.
  std::set<std::string> NeededLogs() const;
  // Hashes of the logs of practice episodes, except those that an evaluation which may rank needs
  // too.
  std::set<std::string> PracticeLogs() const;
  // Adds to rows of a board the artefact's name and what they are ranked by, as far as the view has it
  // and they can be read.
  void ReadStandings(std::vector<StandingRow>& rows) const;
  // The text of the JSON object with an episode's details, by index, of those that have some.
  absl::StatusOr<std::map<int64_t, std::string>> Details(int64_t evaluation) const;
  // Keeps an existing row; if the new one differs, records and returns in what.
  absl::StatusOr<std::vector<std::string>> Record(const EpisodeRow& row);
  // Sets or replaces what a finished evaluation is ranked by.
  absl::Status SetStanding(int64_t evaluation, const nlohmann::json& aggregate);
  absl::Status DropStandings();
  // How often that was done.
  int64_t TimesDropped() const;
};

}  // namespace myograde::server
