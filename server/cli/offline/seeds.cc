// myograde seeds: commit, reveal, check, export, import
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <iostream>
#include <memory>

#include <absl/strings/ascii.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/base/http_client.h"
#include "server/base/secret.h"
#include "server/cli/base/exit_status.h"
#include "server/cli/base/new_file.h"
#include "server/cli/base/options.h"
#include "server/cli/base/places.h"
#include "server/cli/base/print_json.h"
#include "server/cli/base/seed_file.h"
#include "server/cli/client/daemon_options.h"
#include "server/cli/offline/secret_source.h"
#include "server/cli/offline/verbs.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"
#include "server/proof/seed_list.h"
#include "server/store/data_folder.h"
#include "server/store/reader.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

struct SeedOptions {
  std::string secret;      // a file; for check, a file or the digits
  std::string phase;
  std::string output;      // of the list; "": none
  std::string seeds;       // check: a file of seeds
  std::string commitment;  // check: published hash of the secret
  std::string list_hash;   // check: published hash of the list
  int64_t count = 100;
  std::string reason;      // reveal: for the daemon's history
  DaemonOptions daemon;    // reveal, without a file of the secret
  bool json = false;
};

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

absl::StatusOr<std::string> MakeSecret(const std::string& path) {
  absl::StatusOr<std::string> secret = RandomBytes(kSeedSecretBytes);
  if (!secret.ok()) return secret;
  RETURN_IF_ERROR(WriteSecret(path, *secret));
  return secret;
}

// The list is as secret as what it follows from until the phase closes.
absl::Status WriteSeeds(const std::string& path, const std::vector<uint64_t>& seeds) {
  NewFile file(path);
  if (!file.opened() || !file.Write(Json(seeds).dump() + "\n")) return CantWrite(path);
  return file.Keep().status();
}

int PrintList(const SeedOptions& options, const std::string& secret, bool reveal) {
  const std::vector<uint64_t> seeds = DeriveSeeds(secret, options.phase, options.count);
  if (!options.output.empty()) {
    if (absl::Status status = WriteSeeds(options.output, seeds); !status.ok()) {
      return ReportError(status);
    }
  }
  Json json = {{"phase", options.phase},
               {"count", options.count},
               {"commitment", SecretCommitment(secret)},
               {"seeds_sha256", SeedListHash(seeds)}};
  if (reveal) {
    json["secret"] = absl::BytesToHexString(secret);
    json["seeds"] = seeds;
  }
  if (options.json) {
    PrintJson(json);
    return kDone;
  }
  // Whole, so that the lines can be copied.
  std::ostream& out = PlainOutput();
  out << "phase         " << Harmless(options.phase) << ", " << Counted(options.count, "seed")
      << '\n'
      << "commitment    " << json["commitment"].get<std::string>() << '\n'
      << "seeds SHA-256 " << json["seeds_sha256"].get<std::string>() << '\n';
  if (reveal) {
    out << "secret        " << json["secret"].get<std::string>() << std::endl;
  } else {
    std::cout << "Publish these lines when the phase opens, and keep " << Harmless(options.secret)
              << (options.output.empty() ? "" : " and " + Harmless(options.output))
              << " to yourself until it closes." << std::endl;
  }
  return kDone;
}

int CommitSeeds(const SeedOptions& options) {
  const bool there = ::access(options.secret.c_str(), F_OK) == 0;
  const absl::StatusOr<std::string> secret =
      there ? ReadPhaseSecret(options.secret) : MakeSecret(options.secret);
  if (!secret.ok()) return ReportError(secret.status());
  return PrintList(options, *secret, /*reveal=*/false);
}

// The daemon's phase: from now on everybody may know its seeds.
int RevealPhase(const SeedOptions& options) {
  const absl::StatusOr<Json> answer = options.daemon.client().Post(
      absl::StrCat("/v1/phases/", QueryValue(options.phase), "/reveal"),
      {{"reason", options.reason}});
  if (!answer.ok()) return ReportError(answer.status());
  const absl::StatusOr<std::string> secret =
      SecretOfDigits(answer->value("secret", ""), "the daemon's answer");
  if (!secret.ok()) return ReportError(absl::InternalError(secret.status().message()));
  SeedOptions revealed = options;
  revealed.count = std::ssize(answer->value("seeds", Json::array()));
  return PrintList(revealed, *secret, /*reveal=*/true);
}

int RevealSeeds(const SeedOptions& options) {
  if (options.secret.empty()) return RevealPhase(options);
  const absl::StatusOr<std::string> secret = ReadPhaseSecret(options.secret);
  if (!secret.ok()) return ReportError(secret.status());
  return PrintList(options, *secret, /*reveal=*/true);
}

int CheckSeeds(const SeedOptions& options) {
  const absl::StatusOr<std::string> secret = GivenSecret(options.secret);
  if (!secret.ok()) return ReportError(secret.status());
  if (options.commitment.empty() && options.list_hash.empty() && options.seeds.empty()) {
    return ReportError(absl::InvalidArgumentError(
        "give what was published: --commitment, --seeds-sha256, or --seeds with the list"));
  }
  const std::vector<uint64_t> seeds = DeriveSeeds(*secret, options.phase, options.count);
  std::vector<std::string> wrong;
  const auto hold = [&](const std::string& published, const std::string& found, const char* what) {
    if (!published.empty() && absl::AsciiStrToLower(published) != found) {
      wrong.push_back(absl::StrCat(what, " is ", found, ", published was ", published));
    }
  };
  hold(options.commitment, SecretCommitment(*secret), "the secret's SHA-256");
  hold(options.list_hash, SeedListHash(seeds), "the SHA-256 of the list that the secret gives");
  if (!options.seeds.empty()) {
    const absl::StatusOr<std::vector<uint64_t>> played = ReadSeeds(options.seeds);
    if (!played.ok()) return ReportError(played.status());
    if (*played != seeds) wrong.push_back("the list of " + options.seeds + " is another one");
  }
  if (options.json) {
    PrintJson({{"phase", options.phase},
               {"count", options.count},
               {"commitment", SecretCommitment(*secret)},
               {"seeds_sha256", SeedListHash(seeds)},
               {"valid", wrong.empty()},
               {"wrong", wrong}});
  } else if (wrong.empty()) {
    std::cout << "The secret and its list of " << Counted(options.count, "seed")
              << " are those that were published." << std::endl;
  } else {
    for (const std::string& line : wrong) std::cout << Harmless(line) << std::endl;
  }
  return wrong.empty() ? kDone : kNoScore;
}

int ReportMoved(const SeedOptions& options, const std::string& secret, bool changed) {
  const std::string commitment = SecretCommitment(secret);
  if (options.json) {
    PrintJson({{"phase", options.phase}, {"commitment", commitment}, {"changed", changed}});
  } else {
    PlainOutput() << "phase         " << Harmless(options.phase) << '\n'
                  << "commitment    " << commitment << std::endl;
  }
  return kDone;
}

// The store of a folder of data, which exists.
absl::StatusOr<std::string> StoreIn(const SeedOptions& options) {
  std::string data = DataDir(options.daemon.data);
  std::string path = data + "/store.db";
  if (::access(path.c_str(), F_OK) == 0) return path;
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": can't be opened: ", std::strerror(errno), "; name the daemon's folder with --data"));
}

// For a move of the store: an export of it has no secrets.
int ExportSecret(const SeedOptions& options) {
  const absl::StatusOr<std::string> path = StoreIn(options);
  if (!path.ok()) return ReportError(path.status());
  ReaderPool readers(*path);
  const absl::StatusOr<std::string> secret = readers.Read<std::string>(
      [&](Reader& reader) { return reader.PhaseSecret(options.phase); });
  if (!secret.ok()) return ReportError(HostStatus("seeds export", secret.status()));
  if (absl::Status written = WriteSecret(options.output, *secret); !written.ok()) {
    return ReportError(written);
  }
  return ReportMoved(options, *secret, /*changed=*/true);
}

int ImportSecret(const SeedOptions& options) {
  const absl::StatusOr<std::string> secret = ReadPhaseSecret(options.secret);
  if (!secret.ok()) return ReportError(secret.status());
  const absl::StatusOr<std::string> path = StoreIn(options);
  if (!path.ok()) return ReportError(path.status());
  absl::StatusOr<DataLock> lock = DataLock::Take(DataDir(options.daemon.data));
  if (!lock.ok()) return ReportError(HostStatus("seeds import", lock.status()));
  absl::StatusOr<std::unique_ptr<Store>> store = Store::Open(*path, SystemClock());
  if (!store.ok()) return ReportError(HostStatus("seeds import", store.status()));
  bool changed = false;
  const absl::Status written = (*store)->Write([&](Writer& writer) {
    const absl::StatusOr<bool> taken = writer.TakeSecret(options.phase, *secret);
    changed = taken.ok() && *taken;
    return taken.status();
  });
  if (!written.ok()) return ReportError(HostStatus("seeds import", written));
  return ReportMoved(options, *secret, changed);
}

CLI::App* AddPart(CLI::App& verb, const char* name, const char* does, const char* example,
                  SeedOptions& options) {
  CLI::App* part = verb.add_subcommand(name, does);
  part->footer(std::string("Example:\n  ") + example);
  part->add_option("--phase", options.phase,
                   "Name of the phase, part of what the seeds follow from")
      ->default_val("final")
      ->check([](const std::string& text) {
        return text.empty() || text.size() > 64 ? std::string("must have 1 to 64 bytes")
                                                : std::string();
      });
  part->add_option("--count", options.count, "Seeds in the list")
      ->default_val(100)
      ->check(CLI::Range(1, 10'000));
  AddJson(*part, "seeds", options.json);
  return part;
}

// What moves a secret is about one phase of one store.
CLI::App* AddMove(CLI::App& verb, const char* name, const char* does, const char* example,
                  SeedOptions& options) {
  CLI::App* part = verb.add_subcommand(name, does);
  part->footer(std::string("Example:\n  ") + example);
  part->add_option("--phase", options.phase, "Name of the phase")->required();
  part->add_option("--data", options.daemon.data, "The daemon's folder of data");
  AddJson(*part, "seeds-move", options.json);
  return part;
}

}  // namespace

Action AddSeeds(CLI::App& verb) {
  auto options = std::make_shared<SeedOptions>();
  auto chosen = std::make_shared<Action>();
  verb.require_subcommand(1);
  CLI::App* commit = AddPart(verb, "commit",
                             "Make a secret, or use an existing one, and print what to publish "
                             "when the phase opens",
                             "myograde seeds commit --phase final --secret final.secret "
                             "-o final-seeds.json", *options);
  commit->add_option("--secret", options->secret, "File of the secret; made if missing")
      ->required();
  commit->add_option("-o,--output", options->output,
                     "File for the list, as \"seeds\" of a track config and --seeds take it; its "
                     "owner alone can read it");
  commit->callback([=] { *chosen = [=] { return CommitSeeds(*options); }; });

  CLI::App* reveal = AddPart(verb, "reveal",
                             "After the close: reveal the seeds of a phase of the daemon to "
                             "everybody, or with --secret print a secret and its list",
                             "myograde seeds reveal --phase final", *options);
  reveal->add_option("--secret", options->secret,
                     "File of the secret; without it, the daemon reveals the phase");
  reveal->add_option("--reason", options->reason, "For the daemon's history")
      ->default_val("the phase is over");
  reveal->add_option("-o,--output", options->output, "File for the list");
  AddPlaces(*reveal, options->daemon);
  reveal->callback([=] { *chosen = [=] { return RevealSeeds(*options); }; });

  CLI::App* check = AddPart(verb, "check",
                            "For participants: check a revealed secret against what was published",
                            "myograde seeds check --phase final --secret 5c0f... "
                            "--commitment 91ab... --seeds played.json", *options);
  check->add_option("--secret", options->secret, "The secret's digits, or a file of them")
      ->required();
  check->add_option("--commitment", options->commitment, "Published SHA-256 of the secret");
  check->add_option("--seeds-sha256", options->list_hash, "Published SHA-256 of the list");
  check->add_option("--seeds", options->seeds, "File of the seeds that were played");
  check->callback([=] { *chosen = [=] { return CheckSeeds(*options); }; });
  CLI::App* take_out = AddMove(verb, "export",
                               "For a move to another host: write the secret of a phase, which no "
                               "export of the store holds, to a file that its owner alone can read",
                               "myograde seeds export --phase final -o final.secret --data old",
                               *options);
  take_out->add_option("-o,--output", options->output, "New file for the secret")->required();
  take_out->callback([=] { *chosen = [=] { return ExportSecret(*options); }; });

  CLI::App* bring = AddMove(verb, "import",
                            "Bring the secret of a phase to an imported store, whose record must hold "
                            "its commitment; no daemon may run on it",
                            "myograde seeds import --phase final --secret final.secret --data new",
                            *options);
  bring->add_option("--secret", options->secret, "File of the secret")->required();
  bring->callback([=] { *chosen = [=] { return ImportSecret(*options); }; });
  return [chosen] { return (*chosen)(); };
}

}  // namespace myograde::server
