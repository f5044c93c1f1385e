// Phases of challenges in the store.
#pragma once

#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/rows.h"

namespace myograde::server {

// Acts on phases, and their secrets.
class PhaseActs : StorePart {
 public:
  using StorePart::StorePart;

  // NotFoundError: it has none; otherwise as PhaseActs::EnsureSecret.
  absl::StatusOr<std::string> Secret(const std::string& phase) const;
  // Why PhaseActs::EnsureSecret would refuse.
  absl::Status CheckSecret(const std::string& phase, const std::string& challenge,
                           bool further = false) const;
  // Phases with submissions, by name.
  std::vector<PhaseUse> InUse() const;
  // Adds an act on a phase, or on all submissions (`phase` ""); true if that changed anything: what
  // is paused is not paused again for the same reason, nor published or revealed twice.
  absl::StatusOr<bool> AddEvent(const std::string& phase, const std::string& event,
                                const std::string& who, const std::string& why);
  // The secret of a challenge's phase with hidden seeds, 32 bytes, drawn when it is first asked for
  // and committed to in the record. A damaged row (damage.h) if it is not that long.
  // FailedPreconditionError with the code "no_secret": it belongs to another challenge, or there is
  // none although the store has a commitment, submissions or events of the phase; "phase_revealed":
  // another challenge's, which was revealed. `challenge` "": whichever it is. `further`: it is for
  // further episodes of a phase, which may have been played with public seeds before.
  absl::StatusOr<std::string> EnsureSecret(const std::string& phase,
                                           const std::string& challenge = "", bool further = false);
  // Keeps the secret of a phase that was held elsewhere, and whose record was imported; true if it
  // is new here. FailedPreconditionError: it is not the one that the record has committed to first.
  absl::StatusOr<bool> ImportSecret(const std::string& phase, const std::string& secret);
  // FailedPreconditionError with the code "paused" or "phase_revealed".
  absl::Status CheckTakesSubmissions(const std::string& phase);
};

}  // namespace myograde::server
