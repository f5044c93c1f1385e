#include "server/store/stored_row.h"

#include <algorithm>

#include <absl/strings/escaping.h>

#include "protocol/base/sha256.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr int64_t kYear9999Ms = 253'402'300'799'999;
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

StoredRow::StoredRow(SQLite::Statement& select, std::string table, std::string key)
    : select_(select), table_(std::move(table)), key_(std::move(key)) {}

StoredRow::StoredRow(SQLite::Statement& select, std::string table)
    : StoredRow(select, std::move(table), Shown(select.getColumn(0))) {}

void StoredRow::Joined(std::string table, int key_column) {
  table_ = std::move(table);
  key_ = Shown(select_.getColumn(key_column));
  joined_ = true;
}

void StoredRow::Fail(int column, std::string_view problem) {
  const SQLite::Column value = select_.getColumn(column);
  Fail(joined_ && value.isNull()
           ? "it is missing, or a part of it"
           : absl::StrCat("its \"", value.getName(), "\" is ", Shown(value), ": ",
                          std::string(problem)));
}

void StoredRow::Fail(std::string what) {
  if (!damage_) damage_ = Damage{table_, key_, std::move(what)};
}

absl::Status StoredRow::status() const {
  return damage_ ? DamagedRow(*damage_) : absl::OkStatus();
}

std::string StoredRow::OneOf(int column, std::initializer_list<std::string_view> names) {
  std::string name = Text(column);
  if (!ok() || std::find(names.begin(), names.end(), name) != names.end()) return name;
  Fail(column, "no such name is known");
  return "";
}

int64_t StoredRow::Number(int column, int64_t min, int64_t max) {
  const SQLite::Column value = select_.getColumn(column);
  const bool good = value.isInteger() && value.getInt64() >= min && value.getInt64() <= max;
  if (good) return value.getInt64();
  Fail(column, absl::StrCat("a whole number from ", min, " to ", max, " belongs there"));
  return std::max<int64_t>(min, 0);
}

int64_t StoredRow::NumberOr(int column, int64_t min, int64_t max, int64_t if_null) {
  return select_.isColumnNull(column) ? if_null : Number(column, min, max);
}

int64_t StoredRow::Time(int column) { return Number(column, -kYear9999Ms, kYear9999Ms); }

int64_t StoredRow::TimeOr0(int column) {
  return NumberOr(column, -kYear9999Ms, kYear9999Ms, 0);
}

std::string StoredRow::Text(int column) {
  const SQLite::Column value = select_.getColumn(column);
  if (value.isText()) {
    std::string text = value.getString();
    if (IsUtf8(text)) return text;
  }
  Fail(column, "text belongs there");
  return "";
}

std::string StoredRow::Blob(int column) {
  const SQLite::Column value = select_.getColumn(column);
  if (value.isBlob()) {
    return std::string(static_cast<const char*>(value.getBlob()),
                       static_cast<size_t>(value.getBytes()));
  }
  Fail(column, "bytes belong there");
  return "";
}

std::string StoredRow::TextOr(int column) {
  return select_.isColumnNull(column) ? "" : Text(column);
}

void StoredRow::TextsInto(int first_column, std::initializer_list<std::string*> texts) {
  for (std::string* text : texts) *text = Text(first_column++);
}

std::string StoredRow::Hash(int column) {
  std::string text = Text(column);
  if (!IsSha256Hex(text)) Fail(column, "64 lower-case hexadecimal digits belong there");
  return text;
}

std::string StoredRow::Object(int column) {
  std::string text = Text(column);
  if (ok() && !nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false).is_object()) {
    Fail(column, "a JSON object belongs there");
  }
  return text;
}

}  // namespace myograde::server
