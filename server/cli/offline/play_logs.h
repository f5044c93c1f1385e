// Playing logs again on this host.
#pragma once

#include <absl/status/statusor.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/lease/track_config.h"
#include "protocol/log/episode_log.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/replay_run.h"

namespace myograde::server {

// The first episode that must be played before `episode`: where state carries over, the first of its
// lease; elsewhere `episode` itself.
int64_t FirstNeeded(const TrackConfig& track, int64_t episode);

// Parses a log that was read; passes on the error if it was not.
absl::StatusOr<EpisodeLog> ParseLog(const absl::StatusOr<std::string>& bytes);

struct ReplayLogFile {
  std::string path;  // packed or not
  LogHeader header;
};

// Writes the bytes of a log to a file in `folder`. InternalError if it can't be written.
absl::StatusOr<ReplayLogFile> SaveLog(const std::string& folder, std::string_view bytes,
                                      LogHeader header);

// A log of an evaluation, in a file and parsed.
struct FetchedLog {
  ReplayLogFile file;
  EpisodeLog log;
};

// Gets the log of an episode of an evaluation with rows into `folder`. Errors of RowOf and
// FetchLogBytes; DataLossError also if it is of another episode or config.
absl::StatusOr<FetchedLog> FetchLog(const Client& client, const Json& evaluation, int64_t episode,
                                    const std::string& folder);

// The log file at `path`, whose header is `header`, and where state carries over, those of its lease
// before it, by episode. These are in the same folder under the same name but for the episode's number
// ("episode-012.lcmlog.zst", as `local --logs` names them). InvalidArgumentError: its name has no
// such number, or one of them is of other episodes; NotFoundError names one that is missing.
absl::StatusOr<std::map<int64_t, ReplayLogFile>> LogsUpTo(const std::string& path,
                                                          const LogHeader& header);

// Adds --slots, the simulators at once; 0: as server.json says.
void AddSimulatorSlots(CLI::App& verb, int& slots);

// Plays logs, by episode, all of one config, and returns their records in order. Where state
// carries over, all of a lease before an episode must be there. `slots` 0: as server.json says.
// CancelledError after SIGINT, SIGTERM or SIGHUP.
absl::StatusOr<std::vector<ReplayRecord>> PlayLogs(const std::map<int64_t, ReplayLogFile>& files,
                                                   const HostOptions& host, int slots);

}  // namespace myograde::server
