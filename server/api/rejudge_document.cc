#include "server/api/rejudge_document.h"

#include <string>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/views.h"
#include "server/proof/signing_key.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// The item of a submission whose result is on the board: the first repetition.
Json ResultsOf(const std::vector<RejudgeItemRow>& items) {
  Json results = Json::array();
  for (const RejudgeItemRow& item : items) {
    if (item.repetition != 1) continue;
    results.push_back({{"submission", item.submission},
                       {"evaluation", item.evaluation},
                       {"state", EvaluationStateName(item.state)},
                       {"results", TextOrNull(item.results_hash)}});
  }
  return results;
}

// The document is made of what was written before the act. A result that is written along with the
// act would be missing from it.
absl::Status CheckComplete(Reader& reader, const RejudgeRow& rejudge) {
  ASSIGN_OR_RETURN(const RejudgeProgress progress, reader.ProgressOf(rejudge));
  if (progress.complete) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      "rejudge ", rejudge.id, " got another result just now; look at it, and try again"));
}

}  // namespace

Json RejudgeDocument(const RejudgeRow& rejudge, const RejudgeEventRow& event,
                     const std::vector<RejudgeItemRow>& items) {
  Json document = {{"format", 1},
                   {"document", "rejudge"},
                   {"rejudge", rejudge.id},
                   {"event", RejudgeEventName(event.event)},
                   {"at", TimeToJson(event.at)},
                   {"who", event.who},
                   {"reason", event.why},
                   {"purpose", RejudgePurposeName(rejudge.purpose)},
                   {"phase", TextOrNull(rejudge.phase)},
                   {"track", rejudge.track},
                   {"profile", rejudge.profile},
                   {"from_config", rejudge.from_config},
                   {"to_config", rejudge.to_config},
                   {"seeds", rejudge.seeds},
                   {"method", RejudgeMethodName(rejudge.method)},
                   {"repeats", rejudge.repeats}};
  if (event.event == RejudgeEvent::kApplied) document["results"] = ResultsOf(items);
  return document;
}

absl::StatusOr<SignRejudge> RejudgeSigner(const ApiContext& context) {
  absl::StatusOr<std::shared_ptr<const SigningKey>> key = context.receipts_key.Get();
  if (!key.ok()) return key.status();
  // Called on the engine's thread, which may be after the request has been answered.
  return [&readers = context.readers, key = *std::move(key)](
             const RejudgeRow& rejudge,
             const RejudgeEventRow& event) -> absl::StatusOr<SignedDocument> {
    std::vector<RejudgeItemRow> items;
    if (event.event == RejudgeEvent::kApplied) {
      RETURN_IF_ERROR(readers.Read([&](Reader& reader) -> absl::Status {
        ASSIGN_OR_RETURN(items, reader.RejudgeItems(rejudge.id));
        return CheckComplete(reader, rejudge);
      }));
    }
    SignedDocument signed_document = {CanonicalJson(RejudgeDocument(rejudge, event, items)), ""};
    ASSIGN_OR_RETURN(signed_document.signature, key->Sign(signed_document.json));
    return signed_document;
  };
}

}  // namespace myograde::server
