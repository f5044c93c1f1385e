// Receipts: an evaluation's inputs and results, signed. A file of canonical JSON and a newline:
//
//   {"receipt": {...}, "signature": {"algorithm": "ed25519", "value": HEX}}
//
// The signature covers the canonical JSON of "receipt". The key to verify it must come from
// elsewhere, as a forger could put his own inside.
//
// Format 2 is that of evaluations with hidden seeds (TrackConfig::seed_salt): "seed_commitment"
// takes the place of each "seed", "policy_seeds" is null, and "track_config" lacks "seeds",
// "policy_seed_secret" and "seed_salt". In their place "hidden" has the "commitment" to the phase's
// secret (null: the daemon did not have it) and the "count" of its seeds. The secret opens all of
// it.
//
// "artefact" commits to the artefact's hash without telling it (ArtefactCommitment of
// server/board/acts.h), so that whoever reads a receipt can't name the artefact of another team.
//
// "record", if there is one, is the entry of the public record (server/board/acts.h) with this
// result, and the proof that the tree with "root" holds it (record_head.h).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/proof/signing_key.h"

namespace myograde::server {

// The result of one check.
struct ReceiptCheck {
  std::string name;    // "signature", "merkle_root", "results", "config", "seeds", ...
  bool valid = false;
  std::string detail;  // one sentence if not valid; else "" or a remark
};

// The text of the receipt file.
absl::StatusOr<std::string> SignReceipt(const nlohmann::json& receipt, const SigningKey& key);

// The part "receipt" of a file's text. DataLossError if it is not a receipt, or not byte for byte
// in canonical form.
absl::StatusOr<nlohmann::json> ParseReceipt(std::string_view text);

// Whether a receipt needs its phase's secret for a full check.
bool HidesSeeds(const nlohmann::json& receipt);

// Checks the signature, and every hash in the receipt against its content. Needs neither a daemon
// nor the simulator. `secret` is that of the phase (seed_list.h), "" as long as it is not known:
// what only it could show is then a remark. REQUIRES: ParseReceipt(text) succeeded.
std::vector<ReceiptCheck> CheckReceipt(std::string_view text, const PublicKey& key,
                                       const std::string& secret = "");

// A receipt with its whole "track_config" and "policy_seeds": what `secret` adds to one that hides
// its seeds. InvalidArgumentError: its config can't be read.
absl::StatusOr<nlohmann::json> OpenedReceipt(const nlohmann::json& receipt,
                                             const std::string& secret);

// Compares this host's grader (GraderBuild) with a receipt's. A different simulator or library is
// reported; different content of the same compiled model is not valid.
std::vector<ReceiptCheck> CompareGraders(const nlohmann::json& receipt,
                                         const nlohmann::json& grader);

}  // namespace myograde::server
