#include "server/executor/spool/forms.h"

#include <algorithm>
#include <cfloat>
#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kForm = 1;
constexpr size_t kMostWordBytes = 255;
constexpr size_t kMostProblems = 64;
constexpr size_t kMostRuntimes = 256;

bool IsHex(std::string_view text, size_t size) {
  return text.size() == size &&
         text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool IsNumber(std::string_view text) {
  return !text.empty() && text.size() <= 19 &&
         text.find_first_not_of("0123456789") == std::string_view::npos;
}

std::string ReadWord(ConfigReader& reader, std::string_view key, size_t most, bool may_be_empty) {
  std::string text = reader.String(key);
  if (text.empty() ? !may_be_empty : !IsPlainText(text, most)) {
    reader.Fail(key, absl::StrCat("must be ", may_be_empty ? 0 : 1, " to ", most,
                                  " bytes of plain text"));
  }
  return text;
}

std::string ReadDigest(ConfigReader& reader, std::string_view key) {
  std::string text = reader.String(key);
  if (!IsDigest(text)) reader.Fail(key, "must be 64 hexadecimal digits");
  return text;
}

std::string ReadNode(ConfigReader& reader, std::string_view key) {
  std::string text = reader.String(key);
  if (!IsNodeName(text)) reader.Fail(key, "must be a node's name");
  return text;
}

// What a program said: any text, of bounded length.
std::string ReadSaid(ConfigReader& reader, std::string_view key) {
  std::string text = reader.String(key);
  if (text.size() > kMostWhyBytes) {
    reader.Fail(key, absl::StrCat("has more than ", kMostWhyBytes, " bytes"));
  }
  return text;
}

void ReadForm(ConfigReader& reader) { reader.Integer("form", kForm, kForm); }

absl::StatusOr<Json> Parse(std::string_view text, const std::string& where, size_t most) {
  if (text.size() > most) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": is larger than ", most, " bytes"));
  }
  return ParseJson(text, where);
}

absl::StatusOr<NodeArtefact> ReadArtefact(const Json& json, const std::string& where) {
  ConfigReader reader(json, where + ": artefact");
  NodeArtefact artefact;
  artefact.digest = ReadDigest(reader, "digest");
  artefact.archive_sha256 = ReadDigest(reader, "archive_sha256");
  artefact.archive_bytes = reader.Integer("archive_bytes", 1, INT64_MAX);
  RETURN_IF_ERROR(reader.Finish());
  return artefact;
}

absl::StatusOr<std::vector<NodeRuntime>> ReadRuntimes(const Json& array, const std::string& where) {
  std::vector<NodeRuntime> runtimes;
  for (const Json& entry : array) {
    ConfigReader reader(entry, absl::StrCat(where, ": runtimes[", runtimes.size(), "]"));
    NodeRuntime runtime;
    runtime.name = ReadWord(reader, "name", kMostWordBytes, false);
    runtime.digest = reader.String("digest");
    runtime.path = reader.String("path");
    if (!runtime.digest.empty() && !IsDigest(runtime.digest)) {
      reader.Fail("digest", "must be 64 hexadecimal digits, or nothing");
    }
    if (!runtime.path.starts_with('/')) reader.Fail("path", "must be absolute");
    RETURN_IF_ERROR(reader.Finish());
    if (runtimes.size() == kMostRuntimes) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": names more than ", kMostRuntimes, " runtimes"));
    }
    runtimes.push_back(std::move(runtime));
  }
  return runtimes;
}

Json RuntimesToJson(const std::vector<NodeRuntime>& runtimes) {
  Json array = Json::array();
  for (const NodeRuntime& runtime : runtimes) {
    array.push_back(
        {{"name", runtime.name}, {"digest", runtime.digest}, {"path", runtime.path}});
  }
  return array;
}

// A grader build that this program made is an object; what is none stands as it is, and its reader
// refuses it.
Json GraderToJson(const std::string& text) {
  absl::StatusOr<Json> json = ParseJson(text, "grader");
  return json.ok() ? *std::move(json) : Json(text);
}

}  // namespace

bool IsLeaseName(std::string_view name) {
  const size_t first = name.find('-');
  if (first == std::string_view::npos) return false;
  const size_t second = name.find('-', first + 1);
  if (second == std::string_view::npos) return false;
  return IsNumber(name.substr(0, first)) && IsNumber(name.substr(first + 1, second - first - 1)) &&
         IsHex(name.substr(second + 1), 16);
}

bool IsNodeName(std::string_view name) {
  return !name.empty() && name.size() <= kMostWordBytes && name != "." && name != ".." &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '-' || c == '_';
         });
}

bool IsDigest(std::string_view text) { return IsHex(text, 64); }

bool IsLogName(std::string_view name) {
  return name.size() > 64 && IsDigest(name.substr(0, 64)) && name.substr(64) == ".lcmlog.zst";
}

std::string NodeOrderToText(const NodeOrder& order) {
  Json json = {{"form", kForm},
               {"name", order.name},
               {"epoch", order.epoch},
               {"order", LeaseOrderToJson(order.order)},
               {"artefact", nullptr},
               {"runtimes", RuntimesToJson(order.runtimes)},
               {"grader", GraderToJson(order.grader)},
               {"wall_s", order.wall_s},
               {"uid_base", order.uid_base},
               {"self_test", order.self_test},
               {"logs", order.logs},
               {"prove_again", order.prove_again}};
  if (order.artefact.has_value()) {
    json["artefact"] = {{"digest", order.artefact->digest},
                        {"archive_sha256", order.artefact->archive_sha256},
                        {"archive_bytes", order.artefact->archive_bytes}};
  }
  return CanonicalJson(json);
}

absl::StatusOr<NodeOrder> NodeOrderFromText(std::string_view text, const std::string& where) {
  ASSIGN_OR_RETURN(const Json json, Parse(text, where, kMostOrderBytes));
  ConfigReader reader(json, where);
  NodeOrder order;
  ReadForm(reader);
  order.name = reader.String("name");
  if (!IsLeaseName(order.name)) reader.Fail("name", "must be LEASE-ATTEMPT-NONCE");
  order.epoch = ReadWord(reader, "epoch", kMostWordBytes, false);
  const Json& lease = reader.Object("order");
  const Json& runtimes = reader.Array("runtimes");
  reader.Ignore("artefact");
  order.grader = CanonicalJson(reader.Object("grader"));
  order.wall_s = reader.Number("wall_s", {0, DBL_MAX});
  order.uid_base = reader.Integer("uid_base", -1, INT32_MAX);
  order.self_test = reader.Boolean("self_test");
  order.logs = reader.Boolean("logs");
  order.prove_again = reader.Strings("prove_again");
  RETURN_IF_ERROR(reader.Finish());
  if (!json.contains("artefact")) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": \"artefact\" is missing"));
  }
  if (const Json& artefact = json.at("artefact"); !artefact.is_null()) {
    ASSIGN_OR_RETURN(order.artefact, ReadArtefact(artefact, where));
  }
  ASSIGN_OR_RETURN(order.runtimes, ReadRuntimes(runtimes, where));
  ASSIGN_OR_RETURN(order.order, LeaseOrderFromJson(lease, where + ": order"));
  return order;
}

std::string NodeClaimToText(const NodeClaim& claim) {
  return CanonicalJson({{"form", kForm},
                        {"node", claim.node},
                        {"job", claim.job},
                        {"restart", claim.restart},
                        {"nonce", claim.nonce}});
}

absl::StatusOr<NodeClaim> NodeClaimFromText(std::string_view text, const std::string& where) {
  ASSIGN_OR_RETURN(const Json json, Parse(text, where, kMostFormBytes));
  ConfigReader reader(json, where);
  NodeClaim claim;
  ReadForm(reader);
  claim.node = ReadNode(reader, "node");
  claim.job = ReadWord(reader, "job", kMostWordBytes, true);
  claim.restart = reader.Integer("restart", 0, INT32_MAX);
  claim.nonce = reader.String("nonce");
  if (!IsHex(claim.nonce, 16)) reader.Fail("nonce", "must be 16 hexadecimal digits");
  RETURN_IF_ERROR(reader.Finish());
  return claim;
}

std::string NodeProofToText(const NodeProof& proof) {
  return CanonicalJson({{"form", kForm},
                        {"node", proof.node},
                        {"processor", proof.processor},
                        {"kernel", proof.kernel},
                        {"version", proof.version},
                        {"grader", GraderToJson(proof.grader)},
                        {"reference", proof.reference},
                        {"doctor", proof.doctor}});
}

absl::StatusOr<NodeProof> NodeProofFromText(std::string_view text, const std::string& where) {
  ASSIGN_OR_RETURN(const Json json, Parse(text, where, kMostFormBytes));
  ConfigReader reader(json, where);
  NodeProof proof;
  ReadForm(reader);
  proof.node = ReadNode(reader, "node");
  proof.processor = ReadWord(reader, "processor", kMostWordBytes, true);
  proof.kernel = ReadWord(reader, "kernel", kMostWordBytes, true);
  proof.version = ReadWord(reader, "version", kMostWordBytes, false);
  proof.grader = CanonicalJson(reader.Object("grader"));
  proof.reference = ReadSaid(reader, "reference");
  proof.doctor = reader.Strings("doctor");
  if (proof.doctor.size() > kMostProblems) {
    reader.Fail("doctor", absl::StrCat("names more than ", kMostProblems, " problems"));
  }
  RETURN_IF_ERROR(reader.Finish());
  return proof;
}

std::string NodeEndToText(const NodeEnd& end) {
  Json json = {{"form", kForm},
               {"wait_status", end.wait_status},
               {"stderr_tail", end.stderr_tail},
               {"records_bytes", end.records_bytes},
               {"records_sha256", end.records_sha256},
               {"cpu_s", end.cpu_s},
               {"energy_j", nullptr},
               {"why", end.why}};
  if (end.energy_j.has_value()) json["energy_j"] = *end.energy_j;
  return CanonicalJson(json);
}

absl::StatusOr<NodeEnd> NodeEndFromText(std::string_view text, const std::string& where) {
  ASSIGN_OR_RETURN(const Json json, Parse(text, where, kMostFormBytes));
  ConfigReader reader(json, where);
  NodeEnd end;
  ReadForm(reader);
  end.wait_status = static_cast<int>(reader.Integer("wait_status", 0, 0xffff));
  end.stderr_tail = ReadSaid(reader, "stderr_tail");
  end.records_bytes = reader.Integer("records_bytes", 0, kMostRecordBytes);
  end.records_sha256 = ReadDigest(reader, "records_sha256");
  end.cpu_s = reader.Number("cpu_s", {0, DBL_MAX});
  end.why = ReadSaid(reader, "why");
  const bool measured = json.is_object() && json.contains("energy_j") &&
                        !json.at("energy_j").is_null();
  reader.Ignore("energy_j");
  if (measured) end.energy_j = reader.Number("energy_j", {0, DBL_MAX});
  RETURN_IF_ERROR(reader.Finish());
  return end;
}

}  // namespace myograde::server
