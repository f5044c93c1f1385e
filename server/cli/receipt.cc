// myograde receipt, myograde key
#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/config_reader.h"
#include "server/cli/client.h"
#include "server/cli/common.h"
#include "server/cli/screen.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct ReceiptOptions {
  ApiOptions daemon;
  int64_t id = 0;
  std::string file;
  bool json = false;
};

int Receipt(const ReceiptOptions& options) {
  const Client client(options.daemon.path());
  const absl::StatusOr<Json> receipt =
      client.Get(absl::StrCat("/v1/submissions/", options.id, "/receipt"));
  if (!receipt.ok()) return Complain(receipt.status());
  // The file is canonical JSON whichever way the daemon had sent it.
  const std::string text = CanonicalJson(*receipt) + "\n";
  if (absl::Status status = WriteFile(options.file, text); !status.ok()) return Complain(status);
  const Json& body = (*receipt)["receipt"];
  if (options.json) {
    PrintJson({{"submission", options.id},
               {"evaluation", body["evaluation"]},
               {"file", options.file},
               {"merkle_root", body["merkle_root"]},
               {"signature", (*receipt)["signature"]["value"]}});
  } else {
    std::cout << options.file << ": receipt of submission " << options.id << ", Merkle root "
              << body["merkle_root"].get<std::string>() << std::endl;
  }
  return kDone;
}

int Key(const ReceiptOptions& options) {
  const Client client(options.daemon.path());
  const absl::StatusOr<Json> key = client.Get("/v1/key");
  if (!key.ok()) return Complain(key.status());
  const std::string pem = key->value("key", "");
  if (!options.file.empty()) {
    if (absl::Status status = WriteFile(options.file, pem); !status.ok()) return Complain(status);
  }
  if (options.json) {
    PrintJson({{"algorithm", (*key)["algorithm"]},
               {"key", pem},
               {"file", options.file.empty() ? Json() : Json(options.file)}});
  } else if (options.file.empty()) {
    PlainOutput() << pem << std::flush;
  } else {
    std::cout << options.file << ": the key to publish" << std::endl;
  }
  return kDone;
}

}  // namespace

Action AddReceipt(CLI::App& verb) {
  auto options = std::make_shared<ReceiptOptions>();
  AddSubmissionId(verb, options->id);
  verb.add_option("-o,--output", options->file, "The file to write")->required();
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/receipt.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Receipt(*options); };
}

Action AddKey(CLI::App& verb) {
  auto options = std::make_shared<ReceiptOptions>();
  verb.add_option("-o,--output", options->file, "File for the key (default: print it)");
  verb.add_flag("--json", options->json, "Print JSON (configs/schema/key.json)");
  AddDaemonOptions(verb, options->daemon);
  return [options] { return Key(*options); };
}

}  // namespace myograde::server
