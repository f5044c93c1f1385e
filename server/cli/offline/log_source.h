// Where the logs that a receipt names come from.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/cli/client/client.h"
#include "server/proof/receipt.h"

namespace myograde::server {

// Finds logs by the hash of their content: in the files and folders `given`, or at the daemon if
// none are. What is found is checked against the hash, so it need not be trusted.
class LogSource {
 public:
  LogSource(const std::vector<std::string>& given, Client client);

  // One check for each file that was given: files that can't be read, and those that the receipt
  // does not name because they were altered or belong to another evaluation, are not valid.
  std::vector<ReceiptCheck> Check(const nlohmann::json& receipt) const;

  // The log of that SHA-256. NotFoundError if it is not among those given, DataLossError if it was
  // altered, or the daemon's error.
  absl::StatusOr<std::string> Find(const std::string& hash) const;

 private:
  const Client client_;
  std::vector<std::string> folders_;
  std::map<std::string, std::string> files_;  // paths, by the hash of what is in them
  std::vector<ReceiptCheck> unreadable_;
  const bool given_;
};

}  // namespace myograde::server
