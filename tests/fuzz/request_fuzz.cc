// API requests: JSON bodies and URL parameters.
#include "protocol/base/config_reader.h"
#include "protocol/lease/track_config.h"
#include "server/api/requests.h"
#include "server/base/names.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

void CheckText(const std::string& text, size_t max) {
  Require(!text.empty() && text.size() <= max, "a text has its length");
  for (const char c : text) {
    Require(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f, "a text can be shown");
  }
}

void CheckName(const std::string& name) {
  Require(!ConfusableSkeletons(name).empty(), "a name looks like something");
  const absl::StatusOr<std::string> clean = CleanName(name, "name");
  if (!clean.ok()) return;
  CheckText(*clean, kMaxNameBytes);
  Require(CleanName(*clean, "name").value_or("") == *clean, "a clean name stays as it is");
  const std::set<std::string> looks = ConfusableSkeletons(name);
  Require(ConfusableSkeletons(*clean) == looks, "a clean name looks like what it was made of");
}

void CheckSubmit(const nlohmann::json& body) {
  const absl::StatusOr<SubmitRequest> request = ParseSubmit(body);
  if (!request.ok()) return;
  CheckText(request->team, 64);
  CheckName(request->team);
  Require(request->artefact.size() == 64, "an artefact's id is a hash");
  Require(!request->episodes || (*request->episodes >= 1 && *request->episodes <= kMaxEpisodes),
          "episodes are in range");
  Require(!request->seeds || (!request->seeds->empty() &&
                              static_cast<int64_t>(request->seeds->size()) <= kMaxEpisodes),
          "seeds are in range");
}

void CheckRerun(const nlohmann::json& body) {
  const absl::StatusOr<RerunRequest> request = ParseRerun(body);
  if (!request.ok()) return;
  Require(request->first.has_value() == request->last.has_value(), "both ends or none");
  if (!request->first) return;
  Require(*request->first >= 0 && *request->first <= *request->last &&
              *request->last < kMaxEpisodes, "a range is one");
}

void CheckFilter(const std::string& query) {
  Request request;
  request.params = ParseQuery(query);
  const absl::StatusOr<SubmissionFilter> filter = ParseFilter(request);
  if (!filter.ok()) return;
  Require(filter->limit >= 1 && filter->limit <= 1000 && filter->before >= 1,
          "a page is bounded");
}

}  // namespace

// The first byte chooses the kind of request.
MYOGRADE_FUZZ_TARGET(request)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const uint8_t kind = input.Byte();
  const std::string text = input.RestText();
  if (kind % 4 == 3) {
    CheckFilter(text);
    return 0;
  }
  const absl::StatusOr<nlohmann::json> body = ParseJson(text, "request");
  if (!body.ok()) return 0;
  switch (kind % 4) {
    case 0:
      CheckSubmit(*body);
      break;
    case 1:
      CheckRerun(*body);
      break;
    default:
      if (const absl::StatusOr<std::string> reason = ParseCancel(*body); reason.ok()) {
        CheckText(*reason, 200);
      }
      break;
  }
  return 0;
}
