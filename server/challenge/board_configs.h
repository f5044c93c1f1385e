// The configs in force. At start they are those of the files, until a rejudge changes the rules of a
// board; the journal says which board has which config (server/board/board_state.h).
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/challenge/phases.h"
#include "server/grading/tracks.h"
#include "server/store/reader_pool.h"
#include "server/store/store.h"

namespace myograde::server {

// Has the daemon play and show a config on its board from now on: the phase that the config names
// or, if it names none, the track's profile. To be called once the journal has the act of it.
// Evaluations that were accepted before keep their config. A phase that no file describes any more
// is played by nobody, and nothing is changed. InvalidArgumentError if there is no such track or
// profile, or if it is of another environment.
absl::Status SwitchConfig(const TrackPtr& track, Tracks& tracks, Phases& phases);

// The same for a config of the store.
absl::Status SwitchConfig(const Transaction& reader, const std::string& config_hash, Tracks& tracks,
                          Phases& phases);

// What OverlayConfigs decided, for the log.
struct Overlaid {
  std::vector<std::string> notes;     // boards whose config is that of a rejudge
  std::vector<std::string> warnings;  // boards whose files say something new, which starts empty
  std::vector<std::string> errors;    // tracks whose config can't be read
  std::vector<NewBoardConfig> changed;  // by the files; to be written to the store
};

// Puts the configs that rejudges brought into force over those of the files, which must be loaded
// already. A board's config is the store's as long as its file says what it said before those
// rejudges, or what one of them made of it. If the file says anything else, the file wins. A phase
// whose config can't be read can't be played: Phases::Find says why.
absl::StatusOr<Overlaid> OverlayConfigs(const Transaction& reader, Tracks& tracks, Phases& phases);

}  // namespace myograde::server
