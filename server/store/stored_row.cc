#include "server/store/stored_row.h"

#include <algorithm>

#include <absl/strings/escaping.h>
#include <absl/strings/match.h>
#include <nlohmann/json.hpp>

#include "server/base/json_value.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int64_t kMaxNumber = int64_t{1} << 53;
constexpr size_t kShownBytes = 40;

}  // namespace

std::string Shown(const SQLite::Column& column) {
  if (column.isNull()) return "NULL";
  if (column.isInteger() || column.isFloat()) return column.getString();
  const std::string bytes = column.getString();
  return absl::StrCat(column.isBlob() ? "the bytes '" : "'",
                      absl::CHexEscape(bytes.substr(0, kShownBytes)),
                      bytes.size() > kShownBytes ? "'..." : "'");
}

void StoredColumn::Fail(std::string_view problem) const {
  throw BadColumn{
      absl::StrCat("its \"", value_.getName(), "\" is ", Shown(value_), ": ", std::string(problem))};
}

int64_t StoredColumn::NumberTo(int64_t max) const {
  const int64_t number = value_.isInteger() ? value_.getInt64() : -1;
  if (number < 0 || number > max) Fail(absl::StrCat("a whole number from 0 to ", max, " belongs there"));
  return number;
}

StoredColumn::operator int64_t() const { return NumberTo(kMaxNumber); }
StoredColumn::operator uint64_t() const { return static_cast<uint64_t>(NumberTo(INT64_MAX)); }
StoredColumn::operator bool() const { return NumberTo(1) != 0; }
StoredColumn::operator double() const { return static_cast<double>(NumberTo(kMaxNumber)) / 1000; }
StoredColumn::operator std::optional<double>() && {
  return value_.isNull() ? std::nullopt : std::optional(double{*this});
}

std::string StoredColumn::Text() const {
  std::string text = value_.getString();
  if (!value_.isText() || !IsUtf8(text)) Fail("text belongs there");
  return text;
}

StoredColumn::operator std::string() const {
  std::string text = Text();
  if (absl::EndsWith(value_.getName(), "_json") && !ParsedText(text).is_object()) {
    Fail("a JSON object belongs there");
  }
  return text;
}

StoredColumn::operator std::vector<std::string>() const {
  const Json json = ParsedText(Text());
  if (!json.is_array() || !std::ranges::all_of(json, &Json::is_string)) {
    Fail("a JSON array of strings belongs there");
  }
  return json;
}

StoredColumn::operator PolicyManifest() const {
  absl::StatusOr<PolicyManifest> manifest =
      ManifestFromJson(ParsedText(Text()), absl::StrCat("its \"", value_.getName(), "\""));
  if (!manifest.ok()) throw BadColumn{std::string(manifest.status().message())};
  return *std::move(manifest);
}

StoredColumn::operator Outcome() const { return Named(ParseOutcome); }
StoredColumn::operator FailureReason() const { return Named(ParseFailureReason); }

}  // namespace myograde::server
