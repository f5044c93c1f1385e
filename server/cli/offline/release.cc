// myograde release: key, sign, verify
#include "server/proof/release.h"

#include <absl/strings/str_cat.h>

#include <iostream>

#include "protocol/base/status_macros.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/files.h"
#include "server/cli/base/options.h"
#include "server/cli/base/print_json.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr mode_t kPublic = 0644;

struct ReleaseOptions {
  std::string folder;
  std::string key;     // of sign and key the private one, of verify the public one
  std::string name;    // of the release
  std::string output;  // of key: file for the public key
  bool json = false;
};

absl::StatusOr<int> MakeKey(const ReleaseOptions& options) {
  ASSIGN_OR_RETURN(const SigningKey key, HostStatus("", SigningKey::LoadOrMake(options.key)));
  const std::string pem = key.PublicPem();
  RETURN_IF_ERROR(WriteNewFile(options.output, pem, kPublic).status());
  return PrintAnswer(Json{{"algorithm", "ed25519"}, {"key", pem}, {"file", options.output}},
                     options.json, [&](const Json&) {
                       std::cout << Harmless(options.output) << ": the key to publish; keep "
                                 << Harmless(options.key)
                                 << " to yourself, as whoever has it can sign releases.\n";
                     });
}

absl::StatusOr<int> Sign(const ReleaseOptions& options) {
  ASSIGN_OR_RETURN(const SigningKey key, SigningKey::Read(options.key));
  ASSIGN_OR_RETURN(const SignedRelease release,
                   HostStatus("", SignRelease(options.folder, options.name, key)));
  const std::string sums = absl::StrCat(options.folder, "/", kReleaseSums);
  const std::string signature = absl::StrCat(options.folder, "/", kReleaseSignature);
  RETURN_IF_ERROR(WriteNewFile(sums, release.sums, kPublic).status());
  RETURN_IF_ERROR(WriteNewFile(signature, release.signature, kPublic).status());
  return PrintAnswer(Json{{"folder", options.folder},
                          {"name", options.name},
                          {"files", release.files},
                          {"sums", sums},
                          {"signature", signature}},
                     options.json, Sentence("{folder}: {files:file} signed as release {name}"));
}

absl::StatusOr<int> VerifyRelease(const ReleaseOptions& options) {
  ASSIGN_OR_RETURN(const PublicKey key, PublicKey::Read(options.key));
  ASSIGN_OR_RETURN(const ReleaseCheck check, HostStatus("", CheckRelease(options.folder, key)));
  const bool valid = check.wrong.empty();
  return PrintAnswer(
      Json{{"folder", options.folder},
           {"valid", valid},
           {"name", TextOrNull(check.name)},
           {"files", check.files},
           {"wrong", check.wrong}},
      options.json,
      [&](const Json& answer) {
        if (valid) {
          std::cout << Filled(answer, "Release {name}: its signature is valid, and {files:file} and no "
                                      "other are there, as they were signed.\n");
        }
        for (const std::string& line : check.wrong) std::cout << Harmless(line) << '\n';
      },
      valid ? kDone : kNoScore);
}

}  // namespace

Action AddRelease(CLI::App& verb) {
  Parts<ReleaseOptions> parts(verb);
  ReleaseOptions& options = parts.options();
  CLI::App* key = parts.Add(
      "key", "Make a key for releases, or use an existing one, and write the public key to publish",
      "key release.key -o release.pem", MakeKey);
  AddJson(*key, "release-key", options.json);
  key->add_option("KEY", options.key, "File of the private key; made if missing")->required();
  key->add_option("-o,--output", options.output, "File for the public key")->required();

  CLI::App* sign = parts.Add("sign",
                             "Write SHA256SUMS and its signature into a folder, for all "
                             "other files in and below it",
                             "sign ./myograde-1.0.0 --key release.key --name 1.0.0", Sign);
  AddJson(*sign, "release-sign", options.json);
  sign->add_option("FOLDER", options.folder, "The folder of the release")->required();
  sign->add_option("--key", options.key, "File of the private key")->required();
  sign->add_option("--name", options.name, "Name of the release, which is signed too")
      ->default_val(MYOGRADE_VERSION);

  CLI::App* verify = parts.Add("verify",
                               "Check the signature, every file that it covers, and that "
                               "there is no other",
                               "verify ./myograde-1.0.0 --key release.pem", VerifyRelease);
  AddJson(*verify, "release-verify", options.json);
  verify->add_option("FOLDER", options.folder, "The folder of the release")->required();
  verify
      ->add_option("--key", options.key,
                   "File of the public key, from a place that its owner controls")
      ->required();
  return parts.Chosen();
}

}  // namespace myograde::server
