#include "server/api/documents.h"

#include <absl/strings/str_cat.h>

#include <filesystem>

#include "protocol/base/file.h"
#include "server/api/entity_tag.h"
#include "server/pictures/packing.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostBytes = size_t{64} << 20;

std::string TypeOf(const std::string& suffix) {
  if (suffix == ".html") return "text/html; charset=utf-8";
  if (suffix == ".css") return "text/css; charset=utf-8";
  if (suffix == ".js") return "text/javascript; charset=utf-8";
  if (suffix == ".json") return "application/json";
  return "";
}

}  // namespace

absl::StatusOr<Documents> LoadDocuments(const std::string& folder) {
  Documents documents;
  std::error_code error;
  if (!fs::is_directory(folder, error)) return documents;
  size_t bytes = 0;
  for (auto it = fs::recursive_directory_iterator(folder, error);
       !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    std::error_code unknown;
    if (it->symlink_status(unknown).type() != fs::file_type::regular) continue;
    Document document{.type = TypeOf(it->path().extension().string()), .text = {}, .packed = {}, .tag = {}, .packed_tag = {}};
    if (document.type.empty()) continue;
    absl::StatusOr<std::string> text = ReadFile(it->path().string(), kMostBytes);
    if (!text.ok()) return absl::InvalidArgumentError(std::string(text.status().message()));
    document.text = *std::move(text);
    bytes += document.text.size();
    if (bytes > kMostBytes) {
      return absl::InvalidArgumentError(absl::StrCat(folder, ": the documents are larger than ",
                                                     kMostBytes,
                                                     " bytes together; remove versions"));
    }
    document.tag = EntityTagOf(document.text);
    document.packed = GzipOf(document.text);
    if (document.packed.size() >= document.text.size()) document.packed.clear();
    document.packed_tag = EntityTagOf(document.packed);
    documents[it->path().lexically_relative(folder).generic_string()] = std::move(document);
  }
  if (error) {
    return absl::InvalidArgumentError(
        absl::StrCat(folder, ": the documents can't be listed: ", error.message()));
  }
  return documents;
}

}  // namespace myograde::server
