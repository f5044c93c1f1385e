// myograde receipt, myograde key
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/client/verbs.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct ReceiptOptions : SubmissionOptions {
  std::string file;
  int64_t evaluation = 0;  // 0: the original
};

int Receipt(const ReceiptOptions& options) {
  const std::string part = options.evaluation == 0
                               ? "/receipt"
                               : absl::StrCat("/receipt?evaluation=", options.evaluation);
  const absl::StatusOr<Json> receipt = options.client().Get(options.Resource(part));
  if (!receipt.ok()) return ReportError(receipt.status());
  // The file is canonical JSON whichever way the daemon had sent it.
  const std::string text = CanonicalJson(*receipt) + "\n";
  if (absl::Status status = WriteFile(options.file, text); !status.ok()) return ReportError(status);
  const Json& body = (*receipt)["receipt"];
  if (options.json) {
    PrintJson({{"submission", options.id},
               {"evaluation", body["evaluation"]},
               {"file", options.file},
               {"merkle_root", body["merkle_root"]},
               {"signature", (*receipt)["signature"]["value"]}});
  } else {
    std::cout << Harmless(options.file) << ": receipt of submission " << options.id << ", Merkle root "
              << body["merkle_root"].get<std::string>() << std::endl;
  }
  return kDone;
}

struct KeyOptions : DaemonOptions {
  std::string file;  // "": print it
};

int Key(const KeyOptions& options) {
  const absl::StatusOr<Json> key = options.client().Get("/v1/key");
  if (!key.ok()) return ReportError(key.status());
  const std::string pem = key->value("key", "");
  if (!options.file.empty()) {
    const absl::Status status = WriteFile(options.file, pem);
    if (!status.ok()) return ReportError(status);
  }
  if (options.json) {
    PrintJson({{"algorithm", (*key)["algorithm"]},
               {"key", pem},
               {"file", options.file.empty() ? Json() : Json(options.file)}});
  } else if (options.file.empty()) {
    PlainOutput() << pem << std::flush;
  } else {
    std::cout << Harmless(options.file) << ": the key to publish" << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddReceipt(CLI::App& verb) {
  auto options = std::make_shared<ReceiptOptions>();
  AddSubmissionId(verb, *options);
  verb.add_option("-o,--output", options->file, "The file to write")->required();
  verb.add_option("--evaluation", options->evaluation,
                  "Its evaluation by a rejudge, as \"myograde show\" lists them (default: the "
                  "original)")
      ->check(WholeNumber(1, "no evaluation's number"));
  AddDaemonOptions(verb, "receipt", *options);
  return [options] { return Receipt(*options); };
}

Action AddKey(CLI::App& verb) {
  auto options = std::make_shared<KeyOptions>();
  verb.add_option("-o,--output", options->file, "File for the key (default: print it)");
  AddDaemonOptions(verb, "key", *options);
  return [options] { return Key(*options); };
}

}  // namespace myograde::server
