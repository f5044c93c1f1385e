// What is published so that others can check it: myograde seeds: commit, reveal, check, export,
// import; release: key, sign, verify
#include "server/cli/offline/seeds.h"

#include <absl/strings/ascii.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <iostream>
#include <memory>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/data_folder.h"
#include "server/base/http_client.h"
#include "server/base/secret.h"
#include "server/cli/base/files.h"
#include "server/cli/base/verbs.h"
#include "server/cli/client/client.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/release.h"
#include "server/proof/seed_list.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

struct SeedOptions : DaemonOptions {  // of reveal, without a file of the secret
  std::string secret;      // a file; for check, a file or the digits
  std::string phase;
  std::string output;      // of the list; "": none
  std::string seeds;       // check: a file of seeds
  std::string commitment;  // check: published hash of the secret
  std::string list_hash;   // check: published hash of the list
  int64_t count = 100;
  std::string reason;  // reveal: for the daemon's history
};

// The secret in a file of its digits.
absl::StatusOr<std::string> ReadPhaseSecret(const std::string& path) {
  const absl::StatusOr<std::string> text = ReadFile(path, /*max_bytes=*/4096);
  return text.ok() ? SecretOfDigits(*text, path) : text;
}

// In a new file that only its owner may read; never over an old one.
absl::Status WriteSecret(const std::string& path, const std::string& secret) {
  const Fd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  const std::string text = absl::BytesToHexString(secret) + "\n";
  if (file.valid() && ::write(file.get(), text.data(), text.size()) == std::ssize(text) &&
      ::fsync(file.get()) == 0) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": the secret can't be written: ", std::strerror(errno)));
}

absl::StatusOr<int> PrintList(const SeedOptions& options, const std::string& secret, bool reveal) {
  const std::vector<uint64_t> seeds = DeriveSeeds(secret, options.phase, options.count);
  if (!options.output.empty()) {
    // As secret as what it follows from, until the phase closes.
    RETURN_IF_ERROR(WriteNewFile(options.output, Json(seeds).dump() + "\n").status());
  }
  Json json = {{"phase", options.phase},
               {"count", options.count},
               {"commitment", SecretCommitment(secret)},
               {"seeds_sha256", SeedListHash(seeds)}};
  if (reveal) {
    json["secret"] = absl::BytesToHexString(secret);
    json["seeds"] = seeds;
  }
  return PrintAnswer(json, options.json, [&](const Json&) {
    // Whole, so that the lines can be copied.
    std::ostream& out = PlainOutput();
    out << Filled(json, "phase         {phase}, {count:seed}\ncommitment    {commitment}\n"
                        "seeds SHA-256 {seeds_sha256}\n");
    if (reveal) {
      out << Filled(json, "secret        {secret}") << std::endl;
      return;
    }
    std::cout << "Publish these lines when the phase opens, and keep " << Sanitized(options.secret)
              << (options.output.empty() ? "" : " and " + Sanitized(options.output))
              << " secret until it closes." << std::endl;
  });
}

absl::StatusOr<int> CommitSeeds(const SeedOptions& options) {
  const bool there = ::access(options.secret.c_str(), F_OK) == 0;
  ASSIGN_OR_RETURN(const std::string secret,
                   there ? ReadPhaseSecret(options.secret) : RandomBytes(kSeedSecretBytes));
  if (!there) RETURN_IF_ERROR(WriteSecret(options.secret, secret));
  return PrintList(options, secret, /*reveal=*/false);
}

absl::StatusOr<int> RevealSeeds(SeedOptions options) {
  if (!options.secret.empty()) {
    ASSIGN_OR_RETURN(const std::string secret, ReadPhaseSecret(options.secret));
    return PrintList(options, secret, /*reveal=*/true);
  }
  // The daemon's phase: from now on everybody may know its seeds.
  ASSIGN_OR_RETURN(
      const Json answer,
      options.client().Post(absl::StrCat("/v1/phases/", QueryValue(options.phase), "/reveal"),
                            {{"reason", options.reason}}));
  const absl::StatusOr<std::string> secret =
      SecretOfDigits(answer.value("secret", ""), "the daemon's answer");
  if (!secret.ok()) return absl::InternalError(secret.status().message());
  options.count = std::ssize(answer.value("seeds", Json::array()));
  return PrintList(options, *secret, /*reveal=*/true);
}

// Of a check: what is wrong, a line each, or the sentence `good` about the report.
absl::StatusOr<int> ReportChecked(Json report, bool json, const std::string& good,
                                  const std::vector<std::string>& wrong) {
  report["valid"] = wrong.empty();
  report["wrong"] = wrong;
  const auto print = [&](const Json&) {
    if (wrong.empty()) std::cout << Filled(report, good) << '\n';
    for (const std::string& line : wrong) std::cout << Sanitized(line) << '\n';
  };
  return PrintAnswer(report, json, print, wrong.empty() ? kDone : kNoScore);
}

absl::StatusOr<int> CheckSeeds(const SeedOptions& options) {
  ASSIGN_OR_RETURN(const std::string secret, GivenSecret(options.secret));
  RETURN_IF_ERROR(RefuseIf(
      {{options.commitment.empty() && options.list_hash.empty() && options.seeds.empty(),
        "give what was published: --commitment, --seeds-sha256, or --seeds with the list"}}));
  const std::vector<uint64_t> seeds = DeriveSeeds(secret, options.phase, options.count);
  std::vector<std::string> wrong;
  const auto hold = [&](const std::string& published, const std::string& found, const char* what) {
    if (!published.empty() && absl::AsciiStrToLower(published) != found) {
      wrong.push_back(absl::StrCat(what, " is ", found, "; published was ", published));
    }
  };
  hold(options.commitment, SecretCommitment(secret), "the secret's SHA-256");
  hold(options.list_hash, SeedListHash(seeds), "the SHA-256 of the secret's list");
  if (!options.seeds.empty()) {
    ASSIGN_OR_RETURN(const std::vector<uint64_t> played, ReadSeeds(options.seeds));
    if (played != seeds) wrong.push_back("the list of " + options.seeds + " differs");
  }
  return ReportChecked({{"phase", options.phase},
                        {"count", options.count},
                        {"commitment", SecretCommitment(secret)},
                        {"seeds_sha256", SeedListHash(seeds)}},
                       options.json,
                       "The secret and its list of {count:seed} are those that were published.",
                       wrong);
}

absl::StatusOr<int> ReportMoved(const SeedOptions& options, const std::string& secret,
                                bool changed) {
  return PrintAnswer(
      Json{
          {"phase", options.phase}, {"commitment", SecretCommitment(secret)}, {"changed", changed}},
      options.json, [](const Json& moved) {
        PlainOutput() << Filled(moved, "phase         {phase}\ncommitment    {commitment}")
                      << std::endl;
      });
}

// The store of a folder of data, which exists.
absl::StatusOr<std::string> StoreIn(const SeedOptions& options) {
  std::string path = DataDir(options.data) + "/store.db";
  if (::access(path.c_str(), F_OK) == 0) return path;
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": can't be opened: ", std::strerror(errno), "; name the daemon's folder with --data"));
}

// For a move of the store: an export of it has no secrets.
absl::StatusOr<int> ExportSecret(const SeedOptions& options) {
  ASSIGN_OR_RETURN(const std::string path, StoreIn(options));
  ReaderPool readers(path);
  ASSIGN_OR_RETURN(
      const std::string secret,
      HostStatus("seeds export", readers.Read<std::string>([&](const Transaction& reader) {
        return reader.phases.Secret(options.phase);
      })));
  RETURN_IF_ERROR(WriteSecret(options.output, secret));
  return ReportMoved(options, secret, /*changed=*/true);
}

absl::StatusOr<int> ImportSecret(const SeedOptions& options) {
  ASSIGN_OR_RETURN(const std::string secret, ReadPhaseSecret(options.secret));
  ASSIGN_OR_RETURN(const std::string path, StoreIn(options));
  ASSIGN_OR_RETURN(const DataLock lock,
                   HostStatus("seeds import", DataLock::Take(DataDir(options.data))));
  ASSIGN_OR_RETURN(const std::unique_ptr<Store> store,
                   HostStatus("seeds import", Store::Open(path, SystemClock())));
  bool changed = false;
  RETURN_IF_ERROR(HostStatus("seeds import", store->Write([&](Transaction& writer) -> absl::Status {
    ASSIGN_OR_RETURN(changed, writer.phases.ImportSecret(options.phase, secret));
    return absl::OkStatus();
  })));
  return ReportMoved(options, secret, changed);
}

// Of what is about a list of seeds.
void AddListOptions(CLI::App* part, SeedOptions& options) {
  part->add_option("--phase", options.phase,
                   "Name of the phase; the seeds depend on it")
      ->default_val("final")
      ->check([](const std::string& text) -> std::string {
        return text.empty() || text.size() > 64 ? "must have 1 to 64 bytes" : "";
      });
  part->add_option("--count", options.count, "Seeds in the list")
      ->default_val(100)
      ->check(CLI::Range(1, 10'000));
  AddJson(*part, "seeds", options.json);
}

// Of what moves the secret of one phase of one store.
void AddMoveOptions(CLI::App* part, SeedOptions& options) {
  part->add_option("--phase", options.phase, "Name of the phase")->required();
  part->add_option("--data", options.data, "The daemon's data folder");
  AddJson(*part, "seeds-move", options.json);
}

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
                       std::cout << Sanitized(options.output) << ": the key to publish; keep "
                                 << Sanitized(options.key)
                                 << " secret: anybody who has it can sign releases.\n";
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
  return ReportChecked({{"folder", options.folder},
                        {"name", TextOrNull(check.name)},
                        {"files", check.files}},
                       options.json,
                       "Release {name}: its signature is valid, and its {files:file} are "
                       "unchanged, with none missing or added.",
                       check.wrong);
}

}  // namespace

absl::StatusOr<std::string> GivenSecret(const std::string& digits_or_path) {
  const bool file = ::access(digits_or_path.c_str(), R_OK) == 0;
  return file ? ReadPhaseSecret(digits_or_path) : SecretOfDigits(digits_or_path, "--secret");
}

Command AddSeeds(CLI::App& verb) {
  Parts<SeedOptions> parts(verb);
  SeedOptions& options = parts.options();
  CLI::App* commit =
      parts.Add("commit",
                "Create a secret, or use an existing one, and print what to publish when the "
                "phase opens",
                "commit --phase final --secret final.secret -o final-seeds.json", CommitSeeds);
  AddListOptions(commit, options);
  commit->add_option("--secret", options.secret, "File of the secret; created if missing")
      ->required();
  commit->add_option("-o,--output", options.output,
                     "File for the list, in the form that \"seeds\" of a track config and --seeds "
                     "take; only its owner can read it");

  CLI::App* reveal =
      parts.Add("reveal",
                "After the close: reveal the seeds of one of the daemon's phases to everybody, or "
                "with --secret print a secret and its list",
                "reveal --phase final", RevealSeeds);
  AddListOptions(reveal, options);
  reveal->add_option("--secret", options.secret,
                     "File of the secret; without it, the daemon reveals the phase");
  reveal->add_option("--reason", options.reason, "Reason, for the daemon's history")
      ->default_val("the phase is over");
  reveal->add_option("-o,--output", options.output, "File for the list");
  AddPlaces(*reveal, options);

  CLI::App* check = parts.Add(
      "check", "For participants: check a revealed secret against what was published",
      "check --phase final --secret 5c0f... --commitment 91ab... --seeds played.json", CheckSeeds);
  AddListOptions(check, options);
  check->add_option("--secret", options.secret, "The secret in hexadecimal, or a file with it")
      ->required();
  check->add_option("--commitment", options.commitment, "Published SHA-256 of the secret");
  check->add_option("--seeds-sha256", options.list_hash, "Published SHA-256 of the list");
  check->add_option("--seeds", options.seeds, "File of the seeds that were played");

  CLI::App* take_out =
      parts.Add("export",
                "To move to another host: write a phase's secret, which exports of the store "
                "leave out, to a file that only its owner can read",
                "export --phase final -o final.secret --data old", ExportSecret);
  AddMoveOptions(take_out, options);
  take_out->add_option("-o,--output", options.output, "New file for the secret")->required();

  CLI::App* bring =
      parts.Add("import",
                "Add a phase's secret to an imported store whose record has its commitment; stop "
                "the daemon first",
                "import --phase final --secret final.secret --data new", ImportSecret);
  AddMoveOptions(bring, options);
  bring->add_option("--secret", options.secret, "File of the secret")->required();
  return {};
}

Command AddRelease(CLI::App& verb) {
  Parts<ReleaseOptions> parts(verb);
  ReleaseOptions& options = parts.options();
  CLI::App* key = parts.Add(
      "key", "Create a key for releases, or use an existing one, and write the public key to "
             "publish",
      "key release.key -o release.pem", MakeKey);
  AddJson(*key, "release-key", options.json);
  key->add_option("KEY", options.key, "File of the private key; created if missing")->required();
  key->add_option("-o,--output", options.output, "File for the public key")->required();

  CLI::App* sign = parts.Add("sign",
                             "Write SHA256SUMS, of all files in and below a folder, and its "
                             "signature into the folder",
                             "sign ./myograde-1.0.0 --key release.key --name 1.0.0", Sign);
  AddJson(*sign, "release-sign", options.json);
  sign->add_option("FOLDER", options.folder, "The folder of the release")->required();
  sign->add_option("--key", options.key, "File of the private key")->required();
  sign->add_option("--name", options.name, "Name of the release, part of what is signed")
      ->default_val(MYOGRADE_VERSION);

  CLI::App* verify = parts.Add("verify",
                               "Check the signature, each file that it covers, and that there are "
                               "no others",
                               "verify ./myograde-1.0.0 --key release.pem", VerifyRelease);
  AddJson(*verify, "release-verify", options.json);
  verify->add_option("FOLDER", options.folder, "The folder of the release")->required();
  verify
      ->add_option("--key", options.key,
                   "File of the public key, obtained from its owner")
      ->required();
  return {};
}

}  // namespace myograde::server
