#include "server/api/documents.h"

#include <filesystem>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "server/api/negotiation.h"
#include "server/pictures/packing.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostBytes = size_t{64} << 20;

// By the ending of a file's name.
const std::map<std::string, std::string> kTypes = {{".html", "text/html; charset=utf-8"},
                                                   {".css", "text/css; charset=utf-8"},
                                                   {".js", "text/javascript; charset=utf-8"},
                                                   {".json", "application/json"}};

}  // namespace

Document MakeDocument(std::string type, std::string text, std::string packed) {
  std::string tag = ComputeEntityTag(text);
  std::string packed_tag = ComputeEntityTag(packed);
  return {std::move(type), std::move(text), std::move(packed), std::move(tag),
          std::move(packed_tag)};
}

absl::StatusOr<Documents> LoadDocuments(const std::string& folder) {
  Documents documents;
  std::error_code error;
  if (!fs::is_directory(folder, error)) return documents;
  size_t bytes = 0;
  for (auto it = fs::recursive_directory_iterator(folder, error);
       !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    std::error_code unknown;
    if (it->symlink_status(unknown).type() != fs::file_type::regular) continue;
    const auto type = kTypes.find(it->path().extension().string());
    if (type == kTypes.end()) continue;
    absl::StatusOr<std::string> text = ReadFile(it->path().string(), kMostBytes);
    if (!text.ok()) return absl::InvalidArgumentError(std::string(text.status().message()));
    bytes += text->size();
    if (bytes > kMostBytes) {
      return absl::InvalidArgumentError(absl::StrCat(folder, ": the documents exceed ",
                                                     kMostBytes,
                                                     " bytes in total; remove some versions"));
    }
    std::string packed = CompressGzip(*text);
    if (packed.size() >= text->size()) packed.clear();
    documents[it->path().lexically_relative(folder).generic_string()] =
        MakeDocument(type->second, *std::move(text), std::move(packed));
  }
  if (error) {
    return absl::InvalidArgumentError(
        absl::StrCat(folder, ": can't list the documents: ", error.message()));
  }
  return documents;
}

}  // namespace myograde::server
