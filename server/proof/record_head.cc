#include "server/proof/record_head.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/json_value.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kMaxEntries = int64_t{1} << 40;

Json HeadToJson(const RecordHead& head) {
  return {{"size", head.size}, {"root", ToHex(head.root)}, {"chain", head.chain}};
}

// -1: it is no such number.
int64_t CountIn(const Json& json, const char* key) {
  const Json& value = At(json, key);
  if (!value.is_number_integer() || value < 0 || value > kMaxEntries) return -1;
  return value.get<int64_t>();
}

// The keys of `object` that are listed.
Json Only(const Json& object, std::initializer_list<const char*> keys) {
  Json some = Json::object();
  for (const char* key : keys) some[key] = At(object, key);
  return some;
}

absl::StatusOr<RecordHead> HeadOfJson(const Json& json) {
  RecordHead head;
  head.size = CountIn(json, "size");
  head.chain = TextAt(json, "chain");
  const absl::StatusOr<Sha256Digest> root = DigestOfHex(TextAt(json, "root"));
  const bool chain = head.size == 0 ? head.chain.empty() : DigestOfHex(head.chain).ok();
  if (!json.is_object() || json.size() != 3 || head.size < 0 || !chain || !root.ok()) {
    return absl::DataLossError("this is not a head of a record");
  }
  head.root = *root;
  return head;
}

}  // namespace

absl::StatusOr<std::string> SignHead(const RecordHead& head, const SigningKey& key) {
  ASSIGN_OR_RETURN(const Json json, key.SignJson("head", HeadToJson(head)));
  return CanonicalJson(json) + "\n";
}

absl::StatusOr<RecordHead> ParseHead(std::string_view text) {
  if (text.size() > kMaxHeadBytes) {
    return absl::DataLossError("this is not a head of a record: it is too long");
  }
  const absl::StatusOr<Json> json = ParseJson(text, "head");
  if (!json.ok()) return absl::DataLossError(json.status().message());
  absl::StatusOr<RecordHead> head = HeadOfJson(At(*json, "head"));
  if (!head.ok()) return head;
  if (json->size() != 2 || !At(*json, "signature").is_object()) {
    return absl::DataLossError("this is not a head of a record: its signature is missing");
  }
  if (CanonicalJson(*json) + "\n" != text) {
    return absl::DataLossError("the head was altered: it is not in its canonical form");
  }
  return head;
}

bool IsHeadSigned(std::string_view text, const PublicKey& key) {
  return key.IsSigned("head", ParsedText(text));
}

absl::StatusOr<Json> SignWithheld(const WithheldReceipt& withheld, const SigningKey& key) {
  return key.SignJson("withheld", {{"evaluation", withheld.evaluation},
                                   {"reason", withheld.reason},
                                   {"head", HeadToJson(withheld.head)}});
}

absl::StatusOr<WithheldReceipt> CheckWithheld(const Json& json, const PublicKey& key,
                                              const RecordHead& head) {
  const Json& content = At(json, "withheld");
  if (!key.IsSigned("withheld", json)) {
    return absl::PermissionDeniedError(
        "a reason why a receipt is missing was not signed with this key, or was altered "
        "since; export the record again");
  }
  WithheldReceipt read{CountIn(content, "evaluation"), TextAt(content, "reason"), head};
  if (content.size() != 3 || read.evaluation < 0) {
    return absl::DataLossError("this is no reason why a receipt is missing");
  }
  if (At(content, "head") != HeadToJson(head)) {
    return absl::DataLossError(absl::StrCat("the reason why the receipt of evaluation ",
                                            read.evaluation,
                                            " is missing was signed for a different record"));
  }
  return read;
}

Json RecordedBoard(const Json& answer) {
  Json kept =
      Only(answer, {"board", "config", "phase", "track", "profile", "rules", "official_figures"});
  kept["rows"] = kept["disqualified"] = Json::array();
  for (const Json& row : At(answer, "rows")) {
    kept["rows"].push_back(Only(
        row, {"baseline", "team", "submission", "evaluation", "name", "qualified", "aggregate"}));
    // Ranks of groups don't follow from the record.
    kept["rows"].back()["rank"] = At(row, "rank_by_rules");
  }
  for (const Json& row : At(answer, "disqualified")) {
    kept["disqualified"].push_back(Only(
        row, {"team", "submission", "evaluation", "name", "reason", "at", "aggregate"}));
  }
  return kept;
}

nlohmann::json EntryProofToJson(const EntryProof& proof) {
  return {{"entry", proof.index},
          {"content", proof.content},
          {"size", proof.size},
          {"root", ToHex(proof.root)},
          {"proof", ProofToJson(proof.proof)}};
}

absl::StatusOr<EntryProof> CheckEntryProof(const Json& json) {
  EntryProof read;
  read.index = CountIn(json, "entry");
  read.size = CountIn(json, "size");
  read.content = At(json, "content");
  const absl::StatusOr<Sha256Digest> root = DigestOfHex(TextAt(json, "root"));
  if (!json.is_object() || json.size() != 5 || read.index < 0 || !read.content.is_object() ||
      !root.ok()) {
    return absl::InvalidArgumentError("it is not a proof of an entry");
  }
  ASSIGN_OR_RETURN(MerkleProof proof, ProofOfJson(At(json, "proof")));
  read.root = *root;
  read.proof = std::move(proof);
  if (!ProvesInclusion(LeafHash(CanonicalJson(read.content)), read.index, read.size, read.proof,
                       read.root)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "its proof does not show that the entry is number ", read.index, " of a record of ",
        read.size, " entries with this root"));
  }
  return read;
}

}  // namespace myograde::server
