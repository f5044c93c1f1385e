// The digests that identify how an episode was played: wherever an episode is played, equal states
// and actions give equal digests.
#pragma once

#include <span>
#include <string>

#include "protocol/base/sha256.h"

namespace myograde::sim {

class EpisodeDigests {
 public:
  // After each step: the action as received, and the resulting state (Environment::state()).
  void Step(std::span<const double> action, std::span<const double> state) {
    states_.Update(std::as_bytes(state));
    actions_.Update(std::as_bytes(action));
  }

  // Of all states since the start.
  Sha256Digest PeekStates() const { return states_.Peek(); }
  Sha256Digest PeekActions() const { return actions_.Peek(); }

  // EpisodeFacts::digest and EpisodeFacts::actions_digest. Each starts over.
  std::string FinishStates() { return states_.FinishHex(); }
  std::string FinishActions() { return actions_.FinishHex(); }

 private:
  Sha256 states_;
  Sha256 actions_;
};

}  // namespace myograde::sim
