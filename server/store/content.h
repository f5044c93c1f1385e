// What is found by its hash, in the store.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/rows.h"
#include "server/store/submissions.h"

namespace myograde::server {

// The kind of an artefact that Content::Remove removes only if it is still unsubmitted.
inline constexpr char kUploadKind[] = "upload";
inline constexpr char kPracticeLogKind[] = "practice log";

// Tables of texts that are found by their hash and never changed.
inline constexpr char kConfigs[] = "config";
inline constexpr char kSeedLists[] = "seed_list";

// NotFoundError: the store has no artefact of this hash, as far as whoever asks is to know.
absl::Status UnknownArtefact(const std::string& hash);

// What is found by its hash: artefacts, configs and seed lists, and who uploaded what.
class Content : StorePart {
 public:
  using StorePart::StorePart;

  absl::StatusOr<ArtefactRow> Artefact(const std::string& hash) const;
  bool UploadedArtefact(const std::string& hash, const std::string& who) const;
  // Somebody uploaded it for the team, or the team submitted it.
  bool TeamHoldsArtefact(const std::string& hash, const std::string& team) const;
  // An effective config or the seeds (kConfigs, kSeedLists), as canonical JSON with the given hash.
  absl::StatusOr<std::string> Text(const char* table, const std::string& hash) const;
  // The keys of a table that is keyed by hash: "artefact", kConfigs, kSeedLists.
  std::vector<std::string> Hashes(const std::string& table) const;
  std::vector<ArtefactUse> ArtefactUses() const;
  // Uploads that nobody has submitted, oldest first.
  std::vector<ArtefactUse> Uploads() const;
  // True if it is new.
  absl::StatusOr<bool> AddArtefact(const ArtefactRow& artefact);
  // Records who uploaded an artefact whose files are here or about to be kept, and for which team.
  // Only one that was never submitted counts against the limits. FailedPreconditionError with the
  // code "quota" if over a limit.
  absl::Status AddUpload(const ArtefactRow& artefact, const NewUpload& upload,
                         const UnsubmittedLimits& limits);
  // Adds the row for removing the files of an artefact or a log (`name` is its hash); false, and no
  // row, if they are needed. Of kPracticeLogKind, those of a practice that has not ended are not.
  absl::StatusOr<bool> Remove(const std::string& kind, const std::string& name, int64_t bytes,
                              const std::string& why);
  // Adds it unless it is there. A damaged row (damage.h) if what is there under this hash, the
  // SHA-256 of its text, is not this text.
  absl::Status AddText(const char* table, const std::string& hash, const std::string& json);
};

}  // namespace myograde::server
