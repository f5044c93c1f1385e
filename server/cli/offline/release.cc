// myograde release: key, sign, verify
#include "server/proof/release.h"

#include <iostream>
#include <memory>

#include <absl/strings/str_cat.h>

#include "server/base/counted.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr mode_t kPublic = 0644;

struct ReleaseOptions {
  std::string folder;
  std::string key;     // of sign and key the private one, of verify the public one
  std::string name;    // of the release
  std::string output;  // of key: file for the public key
  bool json = false;
};

absl::Status WritePublic(const std::string& path, const std::string& content) {
  NewFile file(path, kPublic);
  if (!file.opened() || !file.Write(content)) return CantWrite(path);
  return file.Keep().status();
}

int MakeKey(const ReleaseOptions& options) {
  const absl::StatusOr<SigningKey> key = SigningKey::LoadOrMake(options.key);
  if (!key.ok()) return ReportError(HostStatus("", key.status()));
  const std::string pem = key->PublicPem();
  if (const absl::Status status = WritePublic(options.output, pem); !status.ok()) {
    return ReportError(status);
  }
  if (options.json) {
    PrintJson({{"algorithm", "ed25519"}, {"key", pem}, {"file", options.output}});
  } else {
    std::cout << Harmless(options.output) << ": the key to publish; keep " << Harmless(options.key)
              << " to yourself, as whoever has it can sign releases." << std::endl;
  }
  return kDone;
}

int Sign(const ReleaseOptions& options) {
  const absl::StatusOr<SigningKey> key = SigningKey::Read(options.key);
  if (!key.ok()) return ReportError(key.status());
  const absl::StatusOr<SignedRelease> release = SignRelease(options.folder, options.name, *key);
  if (!release.ok()) return ReportError(HostStatus("", release.status()));
  const std::string sums = absl::StrCat(options.folder, "/", kReleaseSums);
  const std::string signature = absl::StrCat(options.folder, "/", kReleaseSignature);
  absl::Status status = WritePublic(sums, release->sums);
  if (status.ok()) status = WritePublic(signature, release->signature);
  if (!status.ok()) return ReportError(status);
  if (options.json) {
    PrintJson({{"folder", options.folder},
               {"name", options.name},
               {"files", release->files},
               {"sums", sums},
               {"signature", signature}});
  } else {
    std::cout << Harmless(options.folder) << ": " << Counted(release->files, "file")
              << " signed as release " << Harmless(options.name) << std::endl;
  }
  return kDone;
}

int Verify(const ReleaseOptions& options) {
  const absl::StatusOr<PublicKey> key = PublicKey::Read(options.key);
  if (!key.ok()) return ReportError(key.status());
  const absl::StatusOr<ReleaseCheck> check = CheckRelease(options.folder, *key);
  if (!check.ok()) return ReportError(HostStatus("", check.status()));
  const bool valid = check->wrong.empty();
  if (options.json) {
    PrintJson({{"folder", options.folder},
               {"valid", valid},
               {"name", check->name.empty() ? Json() : Json(check->name)},
               {"files", check->files},
               {"wrong", check->wrong}});
  } else if (valid) {
    std::cout << "Release " << Harmless(check->name) << ": its signature is valid, and "
              << Counted(check->files, "file") << " and no other are there, as they were signed."
              << std::endl;
  } else {
    for (const std::string& line : check->wrong) std::cout << Harmless(line) << std::endl;
  }
  return valid ? kDone : kNoScore;
}

CLI::App* AddPart(CLI::App& verb, const std::string& name, const char* does, const char* example,
                  bool& json) {
  CLI::App* part = verb.add_subcommand(name, does);
  part->footer(std::string("Example:\n  ") + example);
  AddJson(*part, "release-" + name, json);
  return part;
}

}  // namespace

Action AddRelease(CLI::App& verb) {
  auto options = std::make_shared<ReleaseOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  CLI::App* key = AddPart(verb, "key", "Make a key for releases, or use an existing one, and "
                          "write the public key to publish",
                          "myograde release key release.key -o release.pem", options->json);
  key->add_option("KEY", options->key, "File of the private key; made if missing")
      ->required();
  key->add_option("-o,--output", options->output, "File for the public key")->required();
  key->callback([=] { *chosen = [=] { return MakeKey(*options); }; });

  CLI::App* sign = AddPart(verb, "sign", "Write SHA256SUMS and its signature into a folder, for all "
                           "other files in and below it",
                           "myograde release sign ./myograde-1.0.0 --key release.key --name 1.0.0",
                           options->json);
  sign->add_option("FOLDER", options->folder, "The folder of the release")->required();
  sign->add_option("--key", options->key, "File of the private key")->required();
  sign->add_option("--name", options->name, "Name of the release, which is signed too")
      ->default_val(MYOGRADE_VERSION);
  sign->callback([=] { *chosen = [=] { return Sign(*options); }; });

  CLI::App* verify = AddPart(verb, "verify", "Check the signature, every file that it covers, and "
                             "that there is no other",
                             "myograde release verify ./myograde-1.0.0 --key release.pem",
                             options->json);
  verify->add_option("FOLDER", options->folder, "The folder of the release")->required();
  verify->add_option("--key", options->key,
                     "File of the public key, from a place that its owner controls")
      ->required();
  verify->callback([=] { *chosen = [=] { return Verify(*options); }; });
  return [chosen] { return (*chosen)(); };
}

}  // namespace myograde::server
