// The documents' site (server/docs), read once from its folder.
#pragma once

#include <map>
#include <string>

#include <absl/status/statusor.h>

namespace myograde::server {

struct Document {
  std::string type;  // of its content
  std::string text;
  std::string packed;      // compressed by gzip; "": that is not smaller
  std::string tag;         // its entity tag
  std::string packed_tag;  // that of `packed`
};

Document MakeDocument(std::string type, std::string text, std::string packed);

// By path from the folder, such as "1.0/index.html".
using Documents = std::map<std::string, Document>;

// All files of the folder whose type is known; links are not followed. Empty if there is no such
// folder. InvalidArgumentError: one can't be read, or together they are too large.
absl::StatusOr<Documents> LoadDocuments(const std::string& folder);

}  // namespace myograde::server
