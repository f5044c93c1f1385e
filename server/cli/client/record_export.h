// Writes the public record and all that it is checked with to a folder
// (server/cli/offline/record_folder.h says what is in it).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/cli/client/client.h"

namespace myograde::server {

struct RecordExport {
  int64_t size = 0;
  std::string root;
  int64_t receipts = 0;
  int64_t withheld = 0;
  int64_t boards = 0;
};

class RecordExporter {
 public:
  // `progress` hears how many receipts of all are there. `client` must outlive it.
  RecordExporter(const Client& client, std::string folder,
                 std::function<void(int64_t done, int64_t total)> progress)
      : client_(client), folder_(std::move(folder)), progress_(std::move(progress)) {}

  // Writes everything. While results keep ending, it begins again a few times; UnavailableError if
  // they still do. InvalidArgumentError: the folder has files already, or can't be written.
  absl::StatusOr<RecordExport> Run();

 private:
  absl::Status MakeFolders() const;
  absl::Status Write(const std::string& name, const std::string& text) const;
  absl::Status ReadEntries(int64_t size);
  absl::Status WriteReceipts();
  absl::Status WriteReceipt(const nlohmann::json& entry);
  absl::Status WriteBoards();
  absl::Status WriteBoard(const std::string& hash, const nlohmann::json& config,
                          const std::string& board);
  absl::Status WriteSecrets();

  const Client& client_;
  const std::string folder_;
  const std::function<void(int64_t, int64_t)> progress_;
  std::string lines_;                               // of record.jsonl
  std::map<int64_t, nlohmann::json> graded_;        // entries with results, by evaluation
  std::map<std::string, std::string> secrets_;      // digits, by phase
  std::map<std::string, nlohmann::json> configs_;   // as receipts show them, by hash
  std::map<int64_t, bool> receipts_;                // evaluations that have one here
  nlohmann::json withheld_ = nlohmann::json::array();
  int64_t boards_ = 0;
};

}  // namespace myograde::server
