// Receipts: what an evaluation was made of and what came of it, signed. A file of
// canonical JSON and a newline:
//
//   {"receipt": {...}, "signature": {"algorithm": "ed25519", "value": HEX}}
//
// The signature is over the canonical JSON of "receipt". The key to check it
// against comes from elsewhere, as a forger could put one of his own inside.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/proof/signing_key.h"

namespace myograde::server {

// One thing that was checked.
struct ReceiptCheck {
  std::string name;    // "signature", "merkle_root", "results", "config", "seeds", ...
  bool valid = false;
  std::string detail;  // if not valid: one sentence; else "", or what is worth knowing
};

// The text of the receipt's file.
absl::StatusOr<std::string> SignReceipt(const nlohmann::json& receipt, const SigningKey& key);

// The part "receipt" of a file's text. DataLossError if it is no receipt, or not
// in its canonical form, byte by byte.
absl::StatusOr<nlohmann::json> ParseReceipt(std::string_view text);

// Checks the signature, and every hash inside against what it was taken of. Needs
// neither a daemon nor the simulator. REQUIRES: ParseReceipt(text) is good.
std::vector<ReceiptCheck> CheckReceipt(std::string_view text, const PublicKey& key);

// Holds the grader of this host (GraderBuild) against the one of a receipt. Another simulator or
// library is told, another content of the same compiled model is not valid.
std::vector<ReceiptCheck> CompareGraders(const nlohmann::json& receipt,
                                         const nlohmann::json& grader);

}  // namespace myograde::server
