// Decides what is accepted from participants (README.md): turns an uploaded archive into an
// artefact, and an artefact into a submission whose evaluation is queued. The API parses requests
// into these values and maps the statuses to answers.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/mutex.h"
#include "server/artefact/artefact.h"
#include "server/artefact/known_archives.h"
#include "server/challenge/offered_tracks.h"
#include "server/challenge/phases.h"
#include "server/config/server_config.h"
#include "server/engine/engine.h"
#include "server/runtime/runtimes.h"
#include "server/store/store.h"

namespace myograde::server {

struct AdmissionOptions {
  ServerConfig config;
  std::string data_dir;   // artefacts/ and spool/ lie in it
  std::string cache_dir;  // the files that identify the grader's build
  // Whether this host may grade ranked submissions: called and answered as ReferenceCheck::Result.
  // Null: it may.
  std::function<std::optional<std::string>(std::string_view kind, absl::Duration timeout)> reference =
      nullptr;
};

// A complete archive, wherever its bytes are kept.
class IncomingArchive {
 public:
  virtual ~IncomingArchive() = default;

  virtual int64_t size() const = 0;  // bytes
  // At most `size` bytes from `offset` on; 0 at its end, negative for errors.
  virtual ssize_t ReadAt(char* to, size_t size, int64_t offset) const = 0;
  // Moves the archive to a new file at `path`, in the data folder's spool/. Nothing else is called
  // afterwards.
  virtual absl::Status MoveTo(const std::string& path) = 0;
};

struct ReceivedArtefact {
  ArtefactRow artefact;
  bool is_new = false;  // false: the store had it already
};

// Notices that the host's calendar was set. Safe from any thread.
class CalendarWatch {
 public:
  // By how much the calendar moved against the monotonic clock since the last call, if by more than
  // kTolerance; forward is positive. Adjustments smaller than that are never added up.
  std::optional<absl::Duration> Jump(absl::Time calendar, absl::Duration monotonic) {
    const absl::Time started = calendar - monotonic;
    const MutexLock lock(mutex_);
    const absl::Duration jump = started - started_.value_or(started);
    started_ = started;
    if (absl::AbsDuration(jump) <= kTolerance) return std::nullopt;
    return jump;
  }

  static constexpr absl::Duration kTolerance = absl::Minutes(1);

 private:
  Mutex mutex_;
  std::optional<absl::Time> started_ ABSL_GUARDED_BY(mutex_);  // the calendar's time at monotonic 0
};

struct UploadRequest {
  NewUpload from;     // who uploads, and for which team
  std::string track;  // where a refusal counts as a failed try; "" if `from` has no team
  std::optional<Founding> founding = std::nullopt;  // of that team
  // Polled during the upload; true: give up.
  std::function<bool()> stopping = [] { return false; };
};

struct SubmitRequest {
  std::string artefact;
  std::string team;
  std::string track;
  std::string profile;     // "": the track's default, or the phase's
  std::string phase = "";  // "": the only open one of the track, where it has phases
  // Both nullopt: a ranked evaluation of all seeds of the track, or of the phase.
  std::optional<std::vector<uint64_t>> seeds;  // of practice; nullopt: the track's practice seeds
  std::optional<int64_t> episodes;             // only so many of them; nullopt: all
  RequestKey key = {};  // if it came before, the result is what was accepted then
  std::optional<Founding> founding = std::nullopt;  // of the team
  bool organiser = false;  // may name any artefact, whoever uploaded it
};

// Statuses carry the code that API clients get (base/error_code.h), where it is not the
// usual one of their kind. Safe from any thread; calls block, up to the limits of HTTP requests
// and uploads.
class Admission {
 public:
  // All but `options` must outlive it.
  Admission(AdmissionOptions options, const Tracks& tracks, const Phases& phases, Engine& engine,
            ReaderPool& readers, const Clock& clock);

  // Turns an archive into an artefact that can be submitted: unpacks it in a separate process,
  // unless the same bytes were received before, writes the artefact's row and moves its files to
  // artefacts/. Leaves nothing in the spool. If a team is named, an archive that is refused because
  // of its content is charged to it as a failed try; no other error is.
  //   NotFoundError           code "unknown_track"
  //   InvalidArgumentError    code "bad_artefact": the archive breaks a rule, its command could not
  //                           start, or its adapter can't play the track; no code: the team's name
  //   FailedPreconditionError code "look_alike": the team's name (Submissions::Accept);
  //                           "forbidden": the team can't be founded (Teams::Found); "quota": no
  //                           failed tries left, or too many uploads that were never submitted
  //   UnavailableError        code "busy": the host was too busy to unpack it
  //   CancelledError          `stopping` returned true
  //   ResourceExhaustedError  the disk is too full
  // and the errors of Engine::AddArtefact and ReaderPool::Read.
  absl::StatusOr<ReceivedArtefact> Receive(const UploadRequest& request, IncomingArchive& archive);

  // Accepts a submission made by `who` and queues its evaluation. If it names neither seeds nor
  // episodes it plays exactly the seeds of its phase and is ranked, otherwise it is practice; a
  // track that has no phases is one itself, which is always open. A linked result is an earlier
  // submission: nothing new is played or charged.
  //   NotFoundError           code "unknown_track", "unknown_profile", "unknown_phase"; no code:
  //                           the artefact, which is also one that neither `who` nor the team
  //                           uploaded or submitted before
  //   InvalidArgumentError    code "bad_artefact": too large for the track, has an adapter that
  //                           can't play it, or asks for extra observations that the profile does
  //                           not allow; "unknown_runtime"; "ranked_seed": practice on a seed that
  //                           is ranked; no code: episodes, the team's name, a phase of another
  //                           track, several phases to choose from
  //   FailedPreconditionError code "quota", "same_artefact", "look_alike", "paused",
  //                           "phase_revealed" (Submissions::Accept), "forbidden" (Teams::Found);
  //                           "phase_closed"
  //   UnavailableError        code "not_official": this host may not grade ranked submissions
  // and the errors of Engine::Submit and ReaderPool::Read. A result that is repeated was accepted
  // before, when the request came for the first time; nothing is checked again.
  absl::StatusOr<Accepted> Submit(const SubmitRequest& request, const std::string& who);

 private:
  // Of uploads (uploads.cc). `kind`: what the adapter must be able to play; nullptr: anything.
  absl::StatusOr<ReceivedArtefact> Take(const UploadRequest& request, IncomingArchive& archive,
                                        const TrackKind* kind);
  // The artefact of an archive with this hash that was received before. NotFoundError: unpack it.
  absl::StatusOr<ArtefactRow> Known(const std::string& archive_sha256);
  absl::StatusOr<Artefact> Unpack(const std::string& file, const std::string& folder,
                                  const std::function<bool()>& stopping) const;
  // Records the artefact, and who has uploaded it; true: it is new. `here`: so are its files, and
  // whoever holds it already causes no change of the store, and no wait for the disk.
  absl::StatusOr<bool> Hold(const ArtefactRow& row, const NewUpload& from, bool here);
  // Writes the row and moves the unpacked `folder` to artefacts/.
  absl::StatusOr<ReceivedArtefact> Keep(const Artefact& artefact, const std::string& folder,
                                        const NewUpload& from);

  // What a request plays, and as what.
  struct Entry {
    TrackPtr track;
    PhasePtr phase;     // nullptr: none
    bool ranks = true;  // if it plays all seeds
  };
  absl::StatusOr<Entry> EntryOf(const SubmitRequest& request, absl::Time now) const;
  // The date, with a warning in the log if it was set.
  absl::Time Now();
  absl::Status CheckTries(const std::string& team, const std::string& track);
  absl::Status Found(const std::string& team, const Founding& founding);
  // Charges a failed try to the request's team, if it names one.
  absl::Status ChargeRefusal(const UploadRequest& request, const absl::Status& refusal);
  // FailedPreconditionError with the code "forbidden": the phase is for other teams only.
  absl::Status CheckInvited(const std::string& team, const PhaseConfig& phase);
  // The artefact's row, if `who` may submit it and the config can be played with it.
  absl::StatusOr<ArtefactRow> CheckedArtefact(const SubmitRequest& request, const std::string& who,
                                              const TrackConfig& config);
  absl::Status CheckRankedHere(const TrackKind& kind) const;
  NewSubmission Compose(const SubmitRequest& request, const Entry& entry,
                        const std::vector<uint64_t>& seeds, const ArtefactRow& artefact) const;

  const AdmissionOptions options_;
  const Tracks& tracks_;
  const Phases& phases_;
  Engine& engine_;
  ReaderPool& readers_;
  const Clock& clock_;
  const Runtimes runtimes_;
  KnownArchives known_archives_{4096};
  std::atomic<int64_t> spooled_ = 0;  // names of files in the spool
  CalendarWatch calendar_;
};

// What `who` was answered when this key came for the first time, so that what would not be accepted
// any more is answered as it was then; nullopt if it is new. Errors of Submissions::FindRequest and
// ReaderPool::Read.
absl::StatusOr<std::optional<Accepted>> FindEarlier(ReaderPool& readers, const std::string& who,
                                                    const RequestKey& key);

}  // namespace myograde::server
