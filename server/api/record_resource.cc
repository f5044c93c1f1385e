#include "server/api/record_resource.h"

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/record_log.h"
#include "server/api/requests.h"
#include "server/api/views.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kMaxIndex = int64_t{1} << 40;
constexpr int64_t kMostEntries = 1000;

// The reader has checked that an entry is a JSON object. To parse and write each again would be most of
// an answer's time, and anybody may ask for a thousand.
std::string PageText(const Listed<RecordRow>& listed, int64_t size, const Json& next_from) {
  std::vector<std::string> entries;
  for (const RecordRow& row : listed.rows) {
    entries.push_back(absl::StrCat(R"({"chain":")", row.chain, R"(","entry":)", row.entry_json,
                                   R"(,"index":)", row.index, "}"));
  }
  return absl::StrCat(R"({"entries":[)", absl::StrJoin(entries, ","), R"(],"next_from":)", next_from.dump(),
                      R"(,"size":)", size, R"(,"unreadable":)",
                      CanonicalJson(DamagedToJson(listed.damaged)), "}\n");
}

// Oldest first, as the record is read from its beginning and only grows at its end.
std::string NextPage(const Request& request, int64_t next) {
  std::string address = absl::StrCat(request.path, "?from=", next);
  if (request.HasParam("limit")) {
    absl::StrAppend(&address, "&limit=", request.Param("limit"));
  }
  return address;
}

}  // namespace

void RecordResource::Install(Routes& routes) {
  using Self = RecordResource;
  routes.Get("/v1/record", Action::kReadRecord, std::bind_front(&Self::List, this));
  routes.Get("/v1/record/head", Action::kReadRecord, std::bind_front(&Self::GetHead, this));
  routes.Get("/v1/record/proof", Action::kReadRecord, std::bind_front(&Self::Prove, this));
  routes.Get("/v1/record/consistency", Action::kReadRecord,
             std::bind_front(&Self::Compare, this));
}

ApiResult RecordResource::List(const Request& request) const {
  int64_t from = 0;
  int64_t limit = 100;
  absl::Status status = CheckParameters(request, {"from", "limit"});
  status.Update(ReadNumber(request, "from", kMaxIndex, from, /*min=*/0));
  status.Update(ReadNumber(request, "limit", kMostEntries, limit));
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    const int64_t size = reader.RecordSize();
    const Listed<RecordRow> listed = reader.Record(from, limit);
    const int64_t next = std::max(listed.last_id + 1, from + limit);
    if (next < size) answer.next = NextPage(request, next);
    answer.text = std::make_shared<const std::string>(
        PageText(listed, size, next < size ? Json(next) : Json()));
    return absl::OkStatus();
  }));
  return answer;
}

ApiResult RecordResource::GetHead(const Request& request) const {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  ASSIGN_OR_RETURN(RecordHead head, context_.readers.Read<RecordHead>([&](Reader& reader) {
    return context_.record.Head(reader);
  }));
  ASSIGN_OR_RETURN(const std::shared_ptr<const SigningKey> key, context_.receipts_key.Get());
  ASSIGN_OR_RETURN(std::string text, SignHead(head, *key));
  ApiAnswer answer{.tagged = true};
  answer.text = std::make_shared<const std::string>(std::move(text));
  return answer;
}

ApiResult RecordResource::Prove(const Request& request) const {
  int64_t entry = -1;
  int64_t size = 0;
  absl::Status status = CheckParameters(request, {"entry", "size"});
  status.Update(ReadNumber(request, "entry", kMaxIndex, entry, /*min=*/0));
  status.Update(ReadNumber(request, "size", kMaxIndex, size));
  if (status.ok() && entry < 0) {
    status = absl::InvalidArgumentError("\"entry\" is missing: the index of the entry to prove");
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    const absl::StatusOr<EntryProof> proof = context_.record.Prove(reader, entry, size);
    if (proof.ok()) answer.body = EntryProofToJson(*proof);
    return proof.status();
  }));
  return answer;
}

ApiResult RecordResource::Compare(const Request& request) const {
  int64_t from = -1;
  int64_t to = 0;
  absl::Status status = CheckParameters(request, {"from", "to"});
  status.Update(ReadNumber(request, "from", kMaxIndex, from, /*min=*/0));
  status.Update(ReadNumber(request, "to", kMaxIndex, to, /*min=*/0));
  if (status.ok() && from < 0) {
    status = absl::InvalidArgumentError("\"from\" is missing: the size of the earlier record");
  }
  RETURN_IF_ERROR(status);
  ApiAnswer answer{.tagged = true};
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) {
    ASSIGN_OR_RETURN(const auto compared, context_.record.Compare(reader, from, to));
    answer.body = {{"from", from},
                   {"to", to == 0 ? reader.RecordSize() : to},
                   {"from_root", HexOf(compared.from_root)},
                   {"to_root", HexOf(compared.to_root)},
                   {"proof", ProofToJson(compared.proof)}};
    return absl::OkStatus();
  }));
  return answer;
}

}  // namespace myograde::server
