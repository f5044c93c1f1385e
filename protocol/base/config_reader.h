// Strict reading of JSON configuration objects: every key is asked for once,
// every number has a range, and a key that nobody asked for is an error. The
// first mistake is kept and told in one sentence with its place in the file.
//
//   ConfigReader reader(json, "configs/tracks/demo.json: budgets");
//   budgets.startup_s = reader.Number("startup_s", {.min = 1, .max = 3600});
//   return reader.Finish();   // absl::OkStatus() or the first mistake
#pragma once

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
  // `where` names the object in messages. `object` must outlive the reader;
  // anything but a JSON object is the first mistake.
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
  std::vector<std::string> Strings(std::string_view key);
  // An object whose values are all strings.
  std::map<std::string, std::string> StringsByName(std::string_view key);
  // The object at `key`; its reader's mistakes are the caller's to collect.
  const nlohmann::json& Object(std::string_view key);
  const nlohmann::json& Array(std::string_view key);

  // True if the key is there (and marks it as asked for only if it is).
  bool Has(std::string_view key) const;
  // Marks a key as known without reading it (comments: keys that begin with
  // "//" are always known).
  void Ignore(std::string_view key);

  // Records a mistake of the caller's own finding.
  void Fail(std::string_view key, std::string_view problem);

  // The first mistake, or an unknown key, or OkStatus().
  absl::Status Finish();

  // The first mistake so far; who calls it reads only a part of the object.
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

// Objects and arrays inside each other in what ParseJson and ReadJsonFile take.
inline constexpr int kMaxJsonDepth = 64;

// Parses JSON text; `where` names it in the error.
absl::StatusOr<nlohmann::json> ParseJson(std::string_view text, std::string_view where);

// Gives the key at a JSON pointer a value, where there is an object to hold it. Where there is none
// the config is broken, and its parser says so.
void GiveKey(nlohmann::json& config, const char* pointer, const nlohmann::json& value);

// Canonical text: sorted keys, no spaces, shortest round-trip numbers. Equal
// values give equal bytes, so hashes can be taken of it.
std::string CanonicalJson(const nlohmann::json& value);

}  // namespace myograde
