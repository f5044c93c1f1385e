#include "server/proof/receipt.h"

#include <algorithm>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/track_config.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/receipt_seeds.h"
#include "server/proof/record_head.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kMaxReceiptValues = 50 * kMaxEpisodes;

// The canonical results of the episodes: the leaves of the Merkle tree.
std::vector<std::string> ComputeLeaves(const Json& episodes) {
  std::vector<std::string> leaves;
  for (Json entry : episodes) {
    entry.erase("actions_digest");
    entry.erase("log");
    leaves.push_back(CanonicalJson(entry));
  }
  return leaves;
}

bool HasShape(const Json& json) {
  if (!json.is_object() || json.size() != 2 || !json.contains("receipt") ||
      !json.contains("signature") || !json["signature"].is_object()) {
    return false;
  }
  const Json& receipt = json["receipt"];
  if (!receipt.is_object() || !receipt.value("episodes", Json()).is_array() ||
      !receipt.value("grader", Json()).is_object()) {
    return false;
  }
  const Json format = receipt.value("format", Json());
  for (const Json& entry : receipt["episodes"]) {
    if (!entry.is_object() || !entry.value("index", Json()).is_number_unsigned() ||
        entry["index"] >= kMaxEpisodes ||
        (format == 1 && !entry.value("seed", Json()).is_number_unsigned())) {
      return false;
    }
  }
  return format == 1 || (format == 2 && HasHiddenShape(receipt));
}

// What the entry in the public record says of the result, in the receipt's terms.
ReceiptCheck CheckRecord(const Json& receipt) {
  const absl::StatusOr<EntryProof> proof = CheckEntryProof(receipt["record"]);
  if (!proof.ok()) return {"record", false, std::string(proof.status().message())};
  const Json& entry = proof->content;
  if (entry.value("kind", Json()) != "graded") {
    return {"record", false, "its entry in the record is not that of a result"};
  }
  for (const char* key : {"submission", "evaluation", "results", "config", "seeds"}) {
    if (entry.value(key, Json()) == receipt.value(key, Json())) continue;
    return {"record", false,
            absl::StrCat("its entry in the record has another \"", key, "\" than the receipt")};
  }
  if (TextOf(entry, "grader") != Sha256Hex(CanonicalJson(receipt["grader"]))) {
    return {"record", false, "its entry in the record names another build of the grader"};
  }
  return {"record", true, absl::StrCat("entry ", proof->index)};
}

}  // namespace

absl::StatusOr<std::string> SignReceipt(const Json& receipt, const SigningKey& key) {
  ASSIGN_OR_RETURN(const Json json, key.SignJson("receipt", receipt));
  return CanonicalJson(json) + "\n";
}

absl::StatusOr<Json> ParseReceipt(std::string_view text) {
  // Each value takes more memory than its text: a row has about twenty, the config one per seed.
  if (std::count(text.begin(), text.end(), ',') > kMaxReceiptValues) {
    return absl::DataLossError("this is not a receipt: it holds more than any evaluation has");
  }
  absl::StatusOr<Json> json = ParseJson(text, "receipt");
  if (!json.ok()) return absl::DataLossError(json.status().message());
  if (!HasShape(*json)) {
    return absl::DataLossError("this is not a receipt, or one of a format that is not known to "
                               "this program");
  }
  if (CanonicalJson(*json) + "\n" != text) {
    return absl::DataLossError("the receipt was altered: it is not in its canonical form");
  }
  return (*json)["receipt"];
}

std::vector<ReceiptCheck> CheckReceipt(std::string_view text, const PublicKey& key,
                                       const std::string& secret) {
  const Json json = Json::parse(text);
  const Json& receipt = json["receipt"];
  std::vector<ReceiptCheck> checks;
  const bool good = key.IsSigned("receipt", json);
  checks.push_back({"signature", good,
                    good ? "" : "the receipt was not signed with this key, or was altered since"});
  const std::vector<std::string> leaves = ComputeLeaves(receipt["episodes"]);
  checks.push_back(
      CompareTexts("merkle_root", TextOf(receipt, "merkle_root"), MerkleRoot(leaves)));
  std::string rows;
  for (const std::string& leaf : leaves) rows += leaf + "\n";
  checks.push_back(CompareTexts("results", TextOf(receipt, "results"), Sha256Hex(rows)));
  if (receipt.contains("record")) checks.push_back(CheckRecord(receipt));
  std::vector<ReceiptCheck> more =
      HidesSeeds(receipt) ? CheckHiddenSeeds(receipt, secret) : CheckPublicSeeds(receipt);
  checks.insert(checks.end(), more.begin(), more.end());
  return checks;
}

std::vector<ReceiptCheck> CompareGraders(const Json& receipt, const Json& grader) {
  const Json& theirs = receipt["grader"];
  std::vector<ReceiptCheck> checks;
  const auto compare = [&](const std::string& name, const Json& said, const Json& here,
                           bool must_equal) {
    ReceiptCheck check = {name, true, ""};
    if (said != here) {
      check.valid = !must_equal;
      check.detail = absl::StrCat("the ", name, " of this host has the SHA-256 ", here.dump(),
                                  ", the receipt names ", said.dump());
    }
    checks.push_back(std::move(check));
  };
  // Another build may well compute the same results; a replay of the episodes tells.
  for (const char* part : {"simulator", "mujoco"}) {
    compare(part, theirs.value(part, Json()), grader.value(part, Json()), /*must_equal=*/false);
  }
  const Json their_adapters = theirs.value("adapters", Json::object());
  const Json adapters = grader.value("adapters", Json::object());
  for (const auto& [name, hash] : their_adapters.items()) {
    compare(absl::StrCat("adapter ", name), hash, adapters.value(name, Json()),
            /*must_equal=*/false);
  }
  // A compiled model's name contains everything that it depends on, so equal names mean equal
  // content. A model that is not compiled here yet will be, from verified sources.
  const Json models = theirs.value("models", Json::object());
  const Json here = grader.value("models", Json::object());
  const std::string kind = TextOf(receipt, "track_kind");
  for (const auto& [name, hash] : models.items()) {
    if (!name.starts_with(kind + "-") || !here.contains(name)) continue;
    compare("model " + name, hash, here[name], /*must_equal=*/true);
  }
  return checks;
}

}  // namespace myograde::server
