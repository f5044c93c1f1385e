#include "server/cli/client/export_csv.h"

#include <filesystem>
#include <map>
#include <memory>
#include <string_view>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/cli/base/new_file.h"
#include "server/store/transfer.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

// Spreadsheets take the wide forms of the signs for the signs, and ignore a line break before them.
bool BeginsAsFormula(std::string_view text) {
  for (const std::string_view sign : {"=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠"}) {
    if (text.starts_with(sign)) return true;
  }
  return false;
}

// A cell by RFC 4180. Participants choose some of the texts, and spreadsheets run what looks like
// a formula: those get the apostrophe that makes it text there.
std::string CsvCell(const Json& value) {
  if (value.is_null()) return "";
  if (value.is_number()) return value.dump();
  std::string text = value.is_string() ? value.get<std::string>() : value.dump();
  if (BeginsAsFormula(text)) text.insert(0, "'");
  if (!text.empty() && text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string cell = "\"";  // empty text is quoted, so that it is not taken for nothing
  for (const char c : text) cell += c == '"' ? "\"\"" : std::string(1, c);
  return cell + "\"";
}

}  // namespace

absl::Status WriteCsv(const std::string& from, const std::string& folder, bool mark) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return absl::InvalidArgumentError(absl::StrCat(folder, ": can't be made: ", error.message()));
  }
  std::map<std::string, std::unique_ptr<NewFile>> files;
  const absl::Status status =
      ForEachRow(from, [&](const std::string& table, const Json& row) -> absl::Status {
        auto& file = files[table];
        std::string text;
        const auto line = [&](const auto& cell_of) {
          bool first = true;
          for (const auto& [key, value] : row.items()) {
            absl::StrAppend(&text, first ? "" : ",", cell_of(key, value));
            first = false;
          }
          text += "\r\n";
        };
        if (file == nullptr) {
          file = std::make_unique<NewFile>(absl::StrCat(folder, "/", table, ".csv"));
          if (!file->opened()) return CantWrite(folder);
          if (mark) text += "\xef\xbb\xbf";
          line([](const std::string& key, const Json&) { return key; });
        }
        line([](const std::string&, const Json& value) { return CsvCell(value); });
        return file->Write(text) ? absl::OkStatus() : CantWrite(folder);
      });
  if (!status.ok()) return status;
  NewFile sums(folder + "/SHA256SUMS");
  if (!sums.opened()) return CantWrite(folder);
  for (const auto& [table, file] : files) {
    ASSIGN_OR_RETURN(const std::string digest, file->Keep());
    if (!sums.Write(absl::StrCat(digest, "  ", table, ".csv\n"))) return CantWrite(folder);
  }
  return sums.Keep().status();
}

}  // namespace myograde::server
