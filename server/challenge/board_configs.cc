#include "server/challenge/board_configs.h"

#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// A board that the files describe.
struct FileBoard {
  BoardName board;
  TrackPtr track;
};

std::vector<FileBoard> BoardsOfFiles(const Tracks& tracks, const Phases& phases) {
  std::vector<FileBoard> boards;
  for (const auto& [name, entry] : tracks.entries()) {
    for (const auto& [profile, track] : entry.profiles) {
      boards.push_back({{"", name, profile}, track});
    }
  }
  for (const PhasePtr& phase : phases.entries()) {
    const TrackConfig& config = phase->track->config;
    boards.push_back({{config.phase, config.id, config.profile}, phase->track});
  }
  return boards;
}

std::string ShownBoard(const BoardName& board) {
  return board.phase.empty() ? absl::StrCat("track \"", board.track, "\" in the profile \"",
                                            board.profile, "\"")
                             : absl::StrCat("phase \"", board.phase, "\"");
}

// What the file may say without meaning anything new: what it said before the rejudges that are
// behind the newest row, and what each of them made of it.
std::set<std::string> FileConfigsBehind(const std::vector<BoardConfigRow>& rows) {
  std::set<std::string> configs;
  for (auto row = rows.rbegin(); row != rows.rend() && row->rejudge != 0; ++row) {
    configs.insert({row->config, row->from_config});
  }
  return configs;
}

}  // namespace

absl::Status SwitchConfig(const TrackPtr& track, Tracks& tracks, Phases& phases) {
  if (track->config.phase.empty()) return tracks.Replace(track);
  const absl::Status replaced = phases.Replace(track);
  return absl::IsNotFound(replaced) ? absl::OkStatus() : replaced;
}

absl::Status SwitchConfig(const Transaction& reader, const std::string& config_hash, Tracks& tracks,
                          Phases& phases) {
  ASSIGN_OR_RETURN(const TrackPtr track, StoredTrack(reader, config_hash));
  return SwitchConfig(track, tracks, phases);
}

absl::StatusOr<Overlaid> OverlayConfigs(const Transaction& reader, Tracks& tracks, Phases& phases) {
  Overlaid overlaid;
  for (const FileBoard& file : BoardsOfFiles(tracks, phases)) {
    const std::string& hash = file.track->config.hash;
    const std::vector<BoardConfigRow>& own = reader.Board().ConfigsOf(file.board);
    const std::string before = reader.Board().ConfigAt(file.board);
    if (before.empty() || before == hash) continue;
    if (!FileConfigsBehind(own).contains(hash)) {
      overlaid.changed.push_back({file.board, hash, CanonicalJson(file.track->config.effective)});
      overlaid.warnings.push_back(absl::StrCat(
          ShownBoard(file.board), " was changed after it got submissions: they stand under its "
          "earlier config ", before, ", and not on its board"));
      continue;
    }
    const absl::Status switched = SwitchConfig(reader, before, tracks, phases);
    if (switched.ok()) {
      overlaid.notes.push_back(absl::StrCat(ShownBoard(file.board), " has the config ", before,
                                            " of rejudge ", own.back().rejudge,
                                            ", not that of its files, ", hash));
      continue;
    }
    if (!file.board.phase.empty()) {
      phases.Close(file.board.phase, switched);
      continue;
    }
    overlaid.errors.push_back(absl::StrCat(ShownBoard(file.board), " has the config of its files, "
                                           "and not the one of rejudge ", own.back().rejudge, ": ",
                                           switched.message()));
  }
  return overlaid;
}

}  // namespace myograde::server
