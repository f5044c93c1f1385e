#include "server/cli/offline/verify_record.h"

#include <set>
#include <utility>

#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/string_view.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/counted.h"
#include "server/cli/terminal/terminal.h"
#include "server/proof/record_head.h"
#include "server/proof/seed_list.h"
#include "server/store/journal.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// More than what the daemon writes has of each.
constexpr size_t kMaxEntryBytes = 4 << 20;
constexpr int64_t kMaxReceiptFile = 16 << 20;
constexpr int64_t kMaxConfigFile = 16 << 20;
constexpr int64_t kMaxBoardFile = 256 << 20;
constexpr int64_t kMaxListFile = 256 << 20;

absl::Status Wrong(const std::string& sentence) { return absl::InvalidArgumentError(sentence); }

// The same, about a file of the folder.
absl::Status WrongFile(const std::string& file, absl::string_view what) {
  return Wrong(absl::StrCat(Sanitized(file), ": ", what));
}

// "receipts/7.json" -> "7"; "": it has another form.
std::string Stem(const std::string& file, const std::string& folder, const std::string& end) {
  if (file.size() <= folder.size() + end.size() || !absl::EndsWith(file, end)) return "";
  return file.substr(folder.size(), file.size() - folder.size() - end.size());
}

// The first commitment of a phase; "": it has none.
std::string CommitmentIn(const PhaseHistory& phase) {
  return phase.commitments.empty() ? "" : phase.commitments.front().commitment;
}

}  // namespace

RecordReport RecordVerifier::Run(const std::optional<std::string>& earlier) {
  RecordReport report;
  const auto check = [&](const char* name, auto&& step) {
    if (!report.checks.empty() && !report.valid()) return;
    absl::Status status;
    try {
      status = step();
    } catch (const Json::exception&) {
      status = Wrong("a file has values of types that the export does not write");
    }
    report.checks.push_back({name, status.ok(), std::string(status.message())});
  };
  check("key", [&] { return CheckKey(); });
  check("head", [&] { return CheckHead(); });
  check("entries", [&] { return CheckEntries(); });
  if (earlier.has_value()) check("earlier_head", [&] { return CheckEarlier(*earlier); });
  check("secrets", [&] { return CheckSecrets(); });
  check("withheld", [&] { return CheckWithheld(); });
  check("receipts", [&] { return CheckReceipts(); });
  check("commitments", [&] { return CheckCommitments(); });
  check("configs", [&] { return CheckConfigs(); });
  check("boards", [&] { return CheckBoards(); });
  report.size = tree_.size();
  report.root = ToHex(tree_.Root(tree_.size()));
  report.receipts = std::ssize(results_);
  report.withheld = std::ssize(withheld_);
  report.boards = boards_;
  report.not_checked.assign(not_checked_.begin(), not_checked_.end());
  return report;
}

absl::Status RecordVerifier::CheckKey() {
  ASSIGN_OR_RETURN(const std::string pem, folder_.Read("key.pem", kMaxHeadBytes));
  if (pem == pem_) return absl::OkStatus();
  return Wrong("key.pem differs from the key given with --key, which is the one to trust");
}

absl::Status RecordVerifier::CheckHead() {
  ASSIGN_OR_RETURN(const std::string text, folder_.Read("head.json", kMaxHeadBytes));
  const absl::StatusOr<RecordHead> head = ParseHead(text);
  if (!head.ok()) return WrongFile("head.json", head.status().message());
  head_ = *head;
  if (IsHeadSigned(text, key_)) return absl::OkStatus();
  return Wrong("head.json was not signed with this key, or was altered since");
}

absl::Status RecordVerifier::CheckEntries() {
  std::string chain;
  ASSIGN_OR_RETURN(const Fd file, folder_.OpenFile("record.jsonl"));
  RETURN_IF_ERROR(ForEachLine(
      file.get(), "record.jsonl", kMaxEntryBytes,
      [&](std::string_view line, int64_t) -> absl::Status {
        const int64_t index = tree_.size();
        if (index == head_.size) {
          return Wrong(absl::StrCat("record.jsonl has more entries than the ", head_.size,
                                    " that its signed head counts"));
        }
        const absl::StatusOr<Json> entry = ParseJson(line, "record.jsonl");
        if (!entry.ok() || CanonicalJson(*entry) != line) {
          return Wrong(absl::StrCat("record.jsonl: entry ", index,
                                    " is not JSON in its canonical form"));
        }
        const absl::StatusOr<Act> act = ActOfEntry(index, *entry);
        const absl::Status added = act.ok() ? state_.Add(*act) : act.status();
        if (!added.ok()) return WrongFile("record.jsonl", added.message());
        tree_.Append(line);
        chain = ExtendChain(chain, line);
        return absl::OkStatus();
      }));
  if (tree_.size() < head_.size) {
    return Wrong(absl::StrCat("record.jsonl has ", tree_.size(), " entries, but its signed head "
                              "counts ", head_.size, ": entries were removed"));
  }
  if (tree_.Root(tree_.size()) != head_.root) {
    return Wrong("record.jsonl does not have the root of its signed head: an entry was changed, "
                 "replaced or moved");
  }
  if (chain != head_.chain) {
    return Wrong("the chain of record.jsonl does not end as in its head: an entry was changed in "
                 "the server's store after it was written");
  }
  if (!state_.key().empty() && state_.key() != pem_) {
    return Wrong("the record's latest signing key is not the one of --key");
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckEarlier(const std::string& text) {
  const absl::StatusOr<RecordHead> earlier = ParseHead(text);
  if (!earlier.ok()) return Wrong(absl::StrCat("--head: ", earlier.status().message()));
  if (!IsHeadSigned(text, key_)) return Wrong("the earlier head was not signed with this key");
  if (earlier->size > tree_.size()) {
    return Wrong(absl::StrCat("the earlier head has ", Counted(earlier->size, "entry", "entries"),
                              ", but this record has ", tree_.size(), ": entries were removed"));
  }
  if (tree_.Root(earlier->size) == earlier->root) return absl::OkStatus();
  return Wrong(absl::StrCat("the first ", earlier->size, " entries are not those of the earlier "
                            "head: the record was rewritten in between"));
}

absl::Status RecordVerifier::CheckSecrets() {
  std::set<std::string> expected;
  for (const auto& [name, phase] : state_.phases()) {
    if (phase.secret.empty()) continue;
    const absl::StatusOr<std::string> secret = SecretOfDigits(phase.secret, "the record");
    const bool opens = secret.ok() && CommitmentIn(phase) == SecretCommitment(*secret);
    if (!opens) {
      return Wrong(absl::StrCat("the secret that was revealed for phase ", Sanitized(name),
                                " is not the one committed to"));
    }
    const std::string file = absl::StrCat("secrets/", name, ".txt");
    ASSIGN_OR_RETURN(const std::string text, folder_.Read(file, kMaxHeadBytes));
    if (text != phase.secret + "\n") {
      return WrongFile(file, "is not the secret revealed in the record");
    }
    expected.insert(file);
  }
  for (const std::string& file : folder_.In("secrets/")) {
    if (!expected.contains(file)) {
      return WrongFile(file, "no such secret is revealed in the record");
    }
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckWithheld() {
  ASSIGN_OR_RETURN(const std::string text, folder_.Read("withheld.json", kMaxListFile));
  const absl::StatusOr<Json> list = ParseJson(text, "withheld.json");
  if (!list.ok() || CanonicalJson(*list) + "\n" != text) {
    return WrongFile("withheld.json", "it is not JSON in its canonical form");
  }
  if (!list->is_object() || list->size() != 1 || !list->contains("receipts")) {
    return WrongFile("withheld.json", "it has something other than reasons for missing receipts");
  }
  for (const Json& entry : list->at("receipts")) {
    const absl::StatusOr<WithheldReceipt> told = myograde::server::CheckWithheld(entry, key_, head_);
    if (!told.ok()) return WrongFile("withheld.json", told.status().message());
    const int64_t evaluation = told->evaluation;
    const std::string& reason = told->reason;
    const auto result = state_.results().find(evaluation);
    const bool known = result != state_.results().end() && result->second.graded &&
                       withheld_.emplace(evaluation, reason).second;
    if (!known) {
      return WrongFile("withheld.json",
                       absl::StrCat("the record has no result of evaluation ", evaluation));
    }
    const auto submission = state_.submissions().find(result->second.submission);
    const std::string name =
        submission == state_.submissions().end() ? "" : submission->second.board.phase;
    const PhaseHistory& phase = state_.Phase(name);
    const bool open = name.empty() || phase.Has(kPublishedEvent) || phase.Has(kRevealedEvent);
    const bool may = reason == "unreadable" || (reason == "phase" && !open) ||
                     (reason == "rejudge" && result->second.rejudge != 0 &&
                      !state_.WasApplied(result->second.rejudge));
    if (!may) {
      return WrongFile("withheld.json",
                       absl::StrCat("nothing in the record withholds the receipt of evaluation ",
                                    evaluation));
    }
    // By the record itself, nothing follows from a rejudge that was never applied.
    if (reason == "rejudge") continue;
    not_checked_.insert(absl::StrCat("the receipt of evaluation ", evaluation, " is withheld: ",
                                     reason));
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckReceipts() {
  const std::set<std::string> files = folder_.In("receipts/");
  int64_t done = 0;
  for (const std::string& file : files) {
    int64_t evaluation = 0;
    const std::string stem = Stem(file, "receipts/", ".json");
    const bool number = absl::SimpleAtoi(stem, &evaluation) && absl::StrCat(evaluation) == stem;
    const auto result = state_.results().find(number ? evaluation : 0);
    if (result == state_.results().end() || !result->second.graded ||
        withheld_.contains(evaluation)) {
      return WrongFile(file, "the record has no result for this receipt");
    }
    if (absl::Status status = CheckReceiptFile(file, evaluation, result->second); !status.ok()) {
      return WrongFile(file, status.message());
    }
    progress_(++done, std::ssize(files));
  }
  for (const auto& [evaluation, result] : state_.results()) {
    if (!result.graded || results_.contains(evaluation) || withheld_.contains(evaluation)) continue;
    return Wrong(absl::StrCat("evaluation ", evaluation, " has a result in entry ", result.entry,
                              " of the record, but neither a receipt nor a line in withheld.json"));
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckReceiptFile(const std::string& file, int64_t evaluation,
                                              const BoardResult& result) {
  const absl::StatusOr<std::string> text = folder_.Read(file, kMaxReceiptFile);
  if (!text.ok()) return Wrong("it can't be read");
  ASSIGN_OR_RETURN(const Json receipt, ParseReceipt(*text));
  const auto submission = state_.submissions().find(result.submission);
  if (submission == state_.submissions().end()) {
    return Wrong("the record has no entry for the acceptance of its submission");
  }
  const std::string& phase_name = submission->second.board.phase;
  const PhaseHistory& phase = state_.Phase(phase_name);
  std::string secret;
  if (HidesSeeds(receipt) && !phase.secret.empty()) {
    secret = SecretOfDigits(phase.secret, "the record").value_or("");
  }
  for (const ReceiptCheck& check : CheckReceipt(*text, key_, secret)) {
    if (!check.valid) return Wrong(absl::StrCat(check.name, ": ", check.detail));
  }
  if (receipt.value("evaluation", Json()) != evaluation) {
    return Wrong("it is the receipt of a different evaluation");
  }
  RETURN_IF_ERROR(CheckPlace(receipt, result));
  if (receipt.at("artefact").get<std::string>() != submission->second.artefact) {
    return Wrong("its artefact is not the one that was accepted");
  }
  if (!HidesSeeds(receipt) && result.rejudge == 0 && !phase.commitments.empty() &&
      !phase.commitments.front().further &&
      phase.commitments.front().entry < submission->second.entry) {
    not_checked_.insert(absl::StrCat("phase ", Sanitized(phase_name), " had committed to hidden seeds, and submission ",
                                     result.submission, " to it played others"));
  }
  if (HidesSeeds(receipt)) {
    RETURN_IF_ERROR(CheckHidden(receipt, phase_name));
    if (secret.empty()) {
      not_checked_.insert(absl::StrCat("the seeds of phase ", Sanitized(phase_name),
                                       " are not revealed in the record"));
    }
  }
  ASSIGN_OR_RETURN(ReceivedResult received, ResultOfReceipt(receipt));
  results_[evaluation] = std::move(received);
  const std::string config = Sha256Hex(CanonicalJson(receipt.at("track_config")));
  const auto [known, added] = config_texts_.emplace(result.config, config);
  if (known->second == config) return absl::OkStatus();
  return Wrong("other receipts have a different config under the same hash");
}

// What a receipt with hidden seeds says that they follow from is what the record has committed to.
absl::Status RecordVerifier::CheckHidden(const Json& receipt, const std::string& name) {
  const Json said = receipt.at("hidden").value("commitment", Json());
  const std::string recorded = CommitmentIn(state_.Phase(name));
  if (said.is_string() && said.get<std::string>() != recorded) {
    return Wrong(recorded.empty() ? "its seeds are hidden, and the record never committed to them"
                                  : "its seeds follow from a secret other than the one committed "
                                    "to");
  }
  if (!said.is_string() || recorded.empty()) {
    not_checked_.insert(absl::StrCat("the server did not have the secret of phase ", Sanitized(name),
                                     ", as after an import, so the commitment of its receipts is "
                                     "unknown"));
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckCommitments() {
  for (const auto& [name, phase] : state_.phases()) {
    if (phase.commitments.empty()) continue;
    RETURN_IF_ERROR(CheckCommitment(name, phase));
  }
  return absl::OkStatus();
}

// A phase with public seeds may commit to a secret later, for further episodes.
absl::Status RecordVerifier::CheckCommitment(const std::string& name, const PhaseHistory& phase) {
  const PhaseCommitment& commitment = phase.commitments.front();
  bool any_public = false;
  std::map<int64_t, const AcceptedSubmission*> early;
  for (const auto& [id, submission] : state_.submissions()) {
    if (submission.board.phase == name && submission.entry < commitment.entry) {
      early.emplace(id, &submission);
    }
  }
  for (const auto& [evaluation, result] : state_.results()) {
    const auto found = early.find(result.submission);
    const auto receipt = results_.find(evaluation);
    if (found == early.end() || result.rejudge != 0 || receipt == results_.end()) continue;
    if (receipt->second.hides_seeds) {
      return Wrong(absl::StrCat("the seeds of phase ", Sanitized(name), " were committed to in entry ",
                                commitment.entry, ", after submission ", result.submission,
                                " to it was accepted in entry ", found->second->entry));
    }
    any_public = true;
    early.erase(found);
  }
  if (early.empty() || any_public) return absl::OkStatus();
  const auto& rejudges = state_.rejudges();
  const bool later_rejudge = !rejudges.empty() && !rejudges.rbegin()->second.events.empty() &&
                             rejudges.rbegin()->second.events.front().id > commitment.entry;
  if (!commitment.further && !later_rejudge) {
    return Wrong(absl::StrCat("phase ", Sanitized(name), " committed to a secret in entry ",
                              commitment.entry, ", after submission ", early.begin()->first,
                              " to it was accepted in entry ", early.begin()->second->entry));
  }
  not_checked_.insert(absl::StrCat("whether the seeds of the submissions that phase ", Sanitized(name),
                                   " took before it committed to a secret were public"));
  return absl::OkStatus();
}

// The receipt is of the very entry that the record has of this evaluation.
absl::Status RecordVerifier::CheckPlace(const Json& receipt, const BoardResult& result) {
  if (!receipt.contains("record")) {
    return Wrong("it does not name its entry of the record");
  }
  ASSIGN_OR_RETURN(const EntryProof proof, CheckEntryProof(receipt["record"]));
  if (proof.index == result.entry && proof.size <= tree_.size() &&
      LeafHash(CanonicalJson(proof.content)) == tree_.Leaf(result.entry) &&
      proof.root == tree_.Root(proof.size)) {
    return absl::OkStatus();
  }
  return Wrong(absl::StrCat(
      "its proof is of a different record; this one has the result in entry ", result.entry));
}

absl::Status RecordVerifier::CheckConfigs() {
  for (const std::string& file : folder_.In("configs/")) {
    if (!config_texts_.contains(Stem(file, "configs/", ".json"))) {
      return WrongFile(file, "no receipt has this config");
    }
  }
  for (const auto& [hash, digest] : config_texts_) {
    const std::string file = absl::StrCat("configs/", hash, ".json");
    ASSIGN_OR_RETURN(const std::string text, folder_.Read(file, kMaxConfigFile));
    if (!text.ends_with('\n') ||
        Sha256Hex(std::string_view(text).substr(0, text.size() - 1)) != digest) {
      return WrongFile(file, "it is not the config of the receipts");
    }
    absl::StatusOr<RecordedConfig> config = ReadRecordedConfig(Json::parse(text));
    if (!config.ok()) return WrongFile(file, config.status().message());
    configs_.emplace(hash, *std::move(config));
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckBoards() {
  std::set<std::string> expected;
  for (const auto& [hash, config] : configs_) {
    for (const auto& [board, spec] : config.scoring.boards) {
      expected.insert(absl::StrCat("boards/", hash, ".", board, ".json"));
    }
  }
  for (const std::string& file : folder_.In("boards/")) {
    if (!expected.contains(file)) return WrongFile(file, "no receipt is for such a board");
  }
  for (const auto& [hash, config] : configs_) {
    for (const auto& [board, spec] : config.scoring.boards) {
      RETURN_IF_ERROR(CheckBoard(hash, config, board));
    }
  }
  return absl::OkStatus();
}

absl::Status RecordVerifier::CheckBoard(const std::string& hash, const RecordedConfig& config,
                                        const std::string& board) {
  const std::string file = absl::StrCat("boards/", hash, ".", board, ".json");
  ASSIGN_OR_RETURN(const std::string text, folder_.Read(file, kMaxBoardFile));
  const absl::StatusOr<std::string> made = BoardText(state_, results_, hash, config, board);
  if (absl::IsUnavailable(made.status())) {
    not_checked_.insert(absl::StrCat(file, ": ", made.status().message()));
    return absl::OkStatus();
  }
  if (!made.ok()) return WrongFile(file, made.status().message());
  if (text != *made) return WrongFile(file, FirstDifference(text, *made));
  ++boards_;
  return absl::OkStatus();
}

}  // namespace myograde::server
