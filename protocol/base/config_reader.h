// Strict reading of JSON configuration objects: every key is read once, every number has a range,
// and unknown keys are errors. The first mistake is kept and reported in one sentence with its
// place in the file.
//
//   ConfigReader reader(json, "configs/tracks/demo.json: budgets");
//   budgets.startup_s = reader.Number("startup_s", {.min = 1, .max = 3600});
//   return reader.Finish();   // absl::OkStatus() or the first mistake
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde {

// Inclusive bounds. A value outside them, NaN or infinity is a mistake.
struct NumberRange {
  double min;
  double max;
};

class ConfigReader {
 public:
  // `where` names the object in messages. `object` must outlive the reader; anything but a JSON
  // object is the first mistake.
  ConfigReader(const nlohmann::json& object, std::string where);

  // Required values. After a mistake they return a harmless value of the type.
  double Number(std::string_view key, NumberRange range);
  int64_t Integer(std::string_view key, int64_t min, int64_t max);
  bool Boolean(std::string_view key);
  std::string String(std::string_view key);
  // One of `choices`, exactly.
  std::string Choice(std::string_view key, const std::vector<std::string>& choices);
  // An array of exactly `size` numbers (any size if size < 0).
  std::vector<double> Numbers(std::string_view key, int size, NumberRange range);
  // Two numbers, [low, high], of which the first is not the larger one.
  std::array<double, 2> Range(std::string_view key, NumberRange range);
  std::vector<std::string> Strings(std::string_view key);
  // An object whose values are all strings.
  std::map<std::string, std::string> StringsByName(std::string_view key);
  // The object at `key`; the caller collects the mistakes of its reader.
  const nlohmann::json& Object(std::string_view key);
  const nlohmann::json& Array(std::string_view key);

  // True if the key is present, which marks it as known.
  bool Has(std::string_view key) const;
  // Marks a key as known without reading it. (Comments, keys that begin with "//", are always
  // known.)
  void Ignore(std::string_view key);

  // Records a mistake that the caller found.
  void Fail(std::string_view key, std::string_view problem);

  // The first mistake, or an unknown key, or OkStatus().
  absl::Status Finish();

  // The first mistake so far, for callers that read only a part of the object.
  const absl::Status& mistake() const { return first_mistake_; }

  const std::string& where() const { return where_; }

 private:
  const nlohmann::json* Find(std::string_view key);

  const nlohmann::json& object_;
  std::string where_;
  std::set<std::string, std::less<>> asked_;
  absl::Status first_mistake_;
};

// Reads and parses a JSON file of at most `max_bytes`. Errors name the file,
// and for broken JSON the line and column. Duplicate keys are an error.
absl::StatusOr<nlohmann::json> ReadJsonFile(const std::string& path,
                                            size_t max_bytes = 16u << 20);

// The deepest nesting of objects and arrays that ParseJson and ReadJsonFile accept.
inline constexpr int kMaxJsonDepth = 64;

// Parses JSON text; `where` names it in the error.
absl::StatusOr<nlohmann::json> ParseJson(std::string_view text, std::string_view where);

// Canonical text: sorted keys, no spaces, shortest round-trip numbers. Equal values give equal
// bytes, so it can be hashed.
std::string CanonicalJson(const nlohmann::json& value);

}  // namespace myograde
