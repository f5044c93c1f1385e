// Checks a public record as it was exported, without a daemon.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <nlohmann/json.hpp>

#include "server/board/board_state.h"
#include "server/cli/offline/record_boards.h"
#include "server/cli/offline/record_folder.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/receipt.h"
#include "server/proof/record_head.h"

namespace myograde::server {

struct RecordReport {
  // In order; nothing is checked after the first that is not valid.
  std::vector<ReceiptCheck> checks;
  // What could not be checked, one sentence each; not empty: the check is incomplete.
  std::vector<std::string> not_checked;
  int64_t size = 0;
  std::string root;
  int64_t receipts = 0;
  int64_t withheld = 0;
  int64_t boards = 0;  // that were checked

  bool valid() const { return !checks.empty() && checks.back().valid; }
};

class RecordVerifier {
 public:
  // `progress` is called with the receipts checked so far and in total. The arguments must outlive
  // this object.
  RecordVerifier(const RecordFolder& folder, std::string pem, const PublicKey& key,
                 std::function<void(int64_t done, int64_t total)> progress)
      : folder_(folder), pem_(std::move(pem)), key_(key), progress_(std::move(progress)) {}

  // `earlier`: the text of an earlier head that was kept; nullopt: none.
  RecordReport Run(const std::optional<std::string>& earlier);

 private:
  absl::Status CheckKey();
  absl::Status CheckHead();
  absl::Status CheckEntries();
  absl::Status CheckEarlier(const std::string& text);
  absl::Status CheckSecrets();
  absl::Status CheckWithheld();
  absl::Status CheckReceipts();
  absl::Status CheckCommitments();
  // Whether the seeds of a phase were committed to before it took anything.
  absl::Status CheckCommitment(const std::string& name, const PhaseHistory& phase);
  absl::Status CheckHidden(const nlohmann::json& receipt, const std::string& name);
  absl::Status CheckReceiptFile(const std::string& file, int64_t evaluation,
                                const BoardResult& result);
  absl::Status CheckPlace(const nlohmann::json& receipt, const BoardResult& result);
  absl::Status CheckConfigs();
  absl::Status CheckBoards();
  absl::Status CheckBoard(const std::string& hash, const RecordedConfig& config,
                          const std::string& board);

  const RecordFolder& folder_;
  const std::string pem_;
  const PublicKey& key_;
  const std::function<void(int64_t, int64_t)> progress_;
  RecordHead head_;
  MerkleTree tree_;
  BoardState state_;
  std::map<int64_t, std::string> withheld_;          // evaluation and reason
  std::map<int64_t, ReceivedResult> results_;        // by evaluation
  std::map<std::string, std::string> config_texts_;  // hash of the text, by the config's hash
  std::map<std::string, RecordedConfig> configs_;
  std::set<std::string> not_checked_;
  int64_t boards_ = 0;
};

}  // namespace myograde::server
