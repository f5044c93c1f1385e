// The phases of a server: what each plays, in what state it is, and which configs boards have.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "server/challenge/challenge.h"
#include "server/challenge/offered_tracks.h"
#include "server/store/rows.h"
#include "server/store/store.h"

namespace myograde::server {

// Immutable and shared.
struct Phase {
  PhaseConfig config;
  TrackPtr track;          // what it plays: its config and hash are the phase's own
  std::string commitment;  // SHA-256 of its secret's hexadecimal digits; "": the seeds are public
};
using PhasePtr = std::shared_ptr<const Phase>;

// The secret of a phase with committed seeds, 32 bytes.
using SecretOfPhase = std::function<absl::StatusOr<std::string>(const PhaseConfig& phase)>;

// The phases of all challenges. What they are never changes, only what each plays. Safe to use from
// any thread: a reader gets what is played at that moment.
class Phases {
 public:
  // Without a challenge.
  Phases() = default;

  // Of challenges that CheckChallenges found no mistake in. A phase whose secret can't be had exists,
  // but Find gives that error; any other error is returned.
  static absl::StatusOr<Phases> Make(std::vector<ChallengeConfig> challenges, const Tracks& tracks,
                                     const SecretOfPhase& secret_of);

  // NotFoundError with the code "unknown_phase" (ErrorCodeOf of base/error_code.h) lists those that
  // there are.
  absl::StatusOr<PhasePtr> Find(const std::string& name) const;
  // What the files say of a phase; nullptr: there is none of that name.
  const PhaseConfig* ConfigOf(const std::string& name) const;
  // Those that can be played, in order of opening, then by name.
  std::vector<PhasePtr> entries() const;
  const std::vector<ChallengeConfig>& challenges() const { return challenges_; }
  // Of phases whose secret can't be had, by name.
  const std::map<std::string, absl::Status>& unusable() const { return unusable_; }
  // From now on the phase that the config names plays `track`. NotFoundError: there is no such phase;
  // InvalidArgumentError: it is of another track, profile or environment.
  absl::Status Replace(const TrackPtr& track);
  // Takes a phase that can't be played out of those that can; `why` is what Find says then. Not while
  // other threads use this object.
  void Close(const std::string& name, const absl::Status& why);
  // Whether a challenge is held on this server.
  bool any() const { return !challenges_.empty(); }

 private:
  struct Played {
    Mutex mutex;
    std::vector<PhasePtr> entries ABSL_GUARDED_BY(mutex);
  };

  std::vector<ChallengeConfig> challenges_;
  std::map<std::string, absl::Status> unusable_;
  std::unique_ptr<Played> played_ = std::make_unique<Played>();  // a mutex can't be moved
};

// What the calendar and the organisers say of a phase.
enum class PhaseState { kUpcoming, kOpen, kPaused, kClosed };
std::string_view PhaseStateName(PhaseState state);

struct PhaseStatus {
  PhaseState state = PhaseState::kUpcoming;
  // The pause in force, of the phase or of all submissions; of the board's state. nullptr: none.
  const PhaseEventRow* pause = nullptr;
  bool published = false;
  bool revealed = false;
  // Only organisers see the board as it is.
  bool frozen = false;
};

// A function of its arguments alone.
PhaseStatus StatusOfPhase(const PhaseConfig& phase, const BoardState& board, absl::Time now);

// Where a store contradicts challenges, one sentence for each phase with the file and what to do:
// its seeds were revealed, and its times would let submissions in again; its secret can't be had
// (PhaseActs::CheckSecret); or it has public seeds, after a commitment to hidden ones.
absl::StatusOr<std::vector<std::string>> CheckAgainstStore(
    std::span<const ChallengeConfig> challenges, const Transaction& reader, absl::Time now);

// Whether the calendar lets a submission in. FailedPreconditionError with the code "phase_closed"
// says when the phase opens, or closed.
absl::Status CheckOpen(const PhaseConfig& phase, absl::Time now);

// Which phase a ranked submission belongs to: what a participant asks for; "" is anything.
struct PhaseQuery {
  std::string phase;
  std::string track;  // required
  std::string profile;
};

// Whether ranked submissions to a track need a phase.
bool HasPhases(const Phases& phases, const std::string& track);

// The phase of the query's name, whatever its state; without a name, the only one of the track that
// is open by the calendar.
//   NotFoundError            code "unknown_phase"; or as Phases::Find
//   InvalidArgumentError     it is of another track or profile, or several are open
//   FailedPreconditionError  code "phase_closed": none is open; says which one opens next
absl::StatusOr<PhasePtr> FindPhase(const Phases& phases, const PhaseQuery& query, absl::Time now);

// The configs in force. At start they are those of the files, until a rejudge changes the rules of a
// board; the journal says which board has which config (server/board/board_state.h).

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
