#include "protocol/base/config_reader.h"

#include <cmath>
#include <cstdio>
#include <iterator>
#include <memory>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/file.h"

namespace myograde {
namespace {

absl::string_view View(std::string_view s) { return {s.data(), s.size()}; }

// A key or a text of the file for a message: on one line, and not cut within a character.
std::string Shown(std::string_view text) {
  constexpr size_t kMost = 100;
  const bool cut = text.size() > kMost;
  const std::string json = nlohmann::json(std::string(text)).dump(-1, ' ', /*ensure_ascii=*/cut,
                                                     nlohmann::json::error_handler_t::replace);
  return cut ? json.substr(1, kMost) + "..." : json.substr(1, json.size() - 2);
}

// The beginning of a value for a message.
std::string ShownValue(const nlohmann::json& value) {
  return value.dump(-1, ' ', /*ensure_ascii=*/true).substr(0, 40);
}

const nlohmann::json& EmptyObject() {
  static const nlohmann::json empty = nlohmann::json::object();
  return empty;
}

const nlohmann::json& EmptyArray() {
  static const nlohmann::json empty = nlohmann::json::array();
  return empty;
}

}  // namespace

ConfigReader::ConfigReader(const nlohmann::json& object, std::string where)
    : object_(object), where_(std::move(where)) {
  if (!object_.is_object()) {
    first_mistake_ = absl::InvalidArgumentError(
        absl::StrCat(where_, ": must be an object, is ", object_.type_name()));
  }
}

const nlohmann::json* ConfigReader::Find(std::string_view key) {
  asked_.emplace(key);
  if (!object_.is_object()) return nullptr;
  const auto it = object_.find(std::string(key));
  if (it == object_.end()) {
    Fail(key, "is missing");
    return nullptr;
  }
  return &*it;
}

void ConfigReader::Fail(std::string_view key, std::string_view problem) {
  if (!first_mistake_.ok()) return;
  first_mistake_ = absl::InvalidArgumentError(
      absl::StrCat(where_, ": \"", Shown(key), "\" ", View(problem)));
}

double ConfigReader::Number(std::string_view key, NumberRange range) {
  const nlohmann::json* value = Find(key);
  if (value == nullptr) return range.min;
  if (!value->is_number()) {
    Fail(key, absl::StrCat("must be a number, is ", value->type_name()));
    return range.min;
  }
  const double number = value->get<double>();
  if (!std::isfinite(number) || number < range.min || number > range.max) {
    Fail(key, absl::StrCat("is ", value->dump(), ", must be from ", range.min, " to ", range.max));
    return range.min;
  }
  return number;
}

int64_t ConfigReader::Integer(std::string_view key, int64_t min, int64_t max) {
  const nlohmann::json* value = Find(key);
  if (value == nullptr) return min;
  if (!value->is_number_integer()) {
    Fail(key, absl::StrCat("must be a whole number, is ", ShownValue(*value)));
    return min;
  }
  const bool too_big = value->is_number_unsigned() && value->get<uint64_t>() > INT64_MAX;
  const int64_t number = too_big ? INT64_MAX : value->get<int64_t>();
  if (too_big || number < min || number > max) {
    Fail(key, absl::StrCat("is ", value->dump(), ", must be from ", min, " to ", max));
    return min;
  }
  return number;
}

bool ConfigReader::Boolean(std::string_view key) {
  const nlohmann::json* value = Find(key);
  if (value == nullptr) return false;
  if (!value->is_boolean()) {
    Fail(key, absl::StrCat("must be true or false, is ", ShownValue(*value)));
    return false;
  }
  return value->get<bool>();
}

std::string ConfigReader::String(std::string_view key) {
  const nlohmann::json* value = Find(key);
  if (value == nullptr) return "";
  if (!value->is_string()) {
    Fail(key, absl::StrCat("must be a string, is ", value->type_name()));
    return "";
  }
  return value->get<std::string>();
}

std::string ConfigReader::Choice(std::string_view key, const std::vector<std::string>& choices) {
  const std::string text = String(key);
  if (!first_mistake_.ok()) return choices.front();
  for (const std::string& choice : choices) {
    if (choice == text) return text;
  }
  Fail(key, absl::StrCat("is \"", Shown(text), "\", must be one of: ", absl::StrJoin(choices, ", ")));
  return choices.front();
}

std::vector<double> ConfigReader::Numbers(std::string_view key, int size, NumberRange range) {
  const nlohmann::json& array = Array(key);
  std::vector<double> numbers;
  if (first_mistake_.ok() && size >= 0 && static_cast<int>(array.size()) != size) {
    Fail(key, absl::StrCat("has ", array.size(), " entries, must have ", size));
  }
  for (const nlohmann::json& entry : array) {
    const double number = entry.is_number() ? entry.get<double>() : NAN;
    if (!std::isfinite(number) || number < range.min || number > range.max) {
      Fail(key, absl::StrCat("holds ", ShownValue(entry), ", each must be a number from ",
                             range.min, " to ", range.max));
    }
    numbers.push_back(number);
  }
  if (size >= 0) numbers.resize(static_cast<size_t>(size), range.min);
  return numbers;
}

std::array<double, 2> ConfigReader::Range(std::string_view key, NumberRange range) {
  const std::vector<double> numbers = Numbers(key, 2, range);
  if (numbers[0] > numbers[1]) Fail(key, "must have its smaller number first");
  return {numbers[0], numbers[1]};
}

std::vector<std::string> ConfigReader::Strings(std::string_view key) {
  std::vector<std::string> strings;
  for (const nlohmann::json& entry : Array(key)) {
    if (!entry.is_string()) {
      Fail(key, absl::StrCat("holds ", ShownValue(entry), ", each must be a string"));
      continue;
    }
    strings.push_back(entry.get<std::string>());
  }
  return strings;
}

std::map<std::string, std::string> ConfigReader::StringsByName(std::string_view key) {
  std::map<std::string, std::string> strings;
  for (const auto& [name, value] : Object(key).items()) {
    if (value.is_string()) {
      strings[name] = value.get<std::string>();
    } else {
      Fail(key, absl::StrCat("has ", ShownValue(value), " as the value of \"",
                             Shown(name), "\", which must be a string"));
    }
  }
  return strings;
}

const nlohmann::json& ConfigReader::Object(std::string_view key) {
  const nlohmann::json* value = Find(key);
  if (value == nullptr) return EmptyObject();
  if (!value->is_object()) {
    Fail(key, absl::StrCat("must be an object, is ", value->type_name()));
    return EmptyObject();
  }
  return *value;
}

const nlohmann::json& ConfigReader::Array(std::string_view key) {
  const nlohmann::json* value = Find(key);
  if (value == nullptr) return EmptyArray();
  if (!value->is_array()) {
    Fail(key, absl::StrCat("must be an array, is ", value->type_name()));
    return EmptyArray();
  }
  return *value;
}

bool ConfigReader::Has(std::string_view key) const {
  return object_.is_object() && object_.contains(std::string(key));
}

void ConfigReader::Ignore(std::string_view key) { asked_.emplace(key); }

absl::Status ConfigReader::Finish() {
  if (first_mistake_.ok()) {
    for (const auto& [key, value] : object_.items()) {
      if (key.starts_with("//") || asked_.contains(key)) continue;
      Fail(key, absl::StrCat("is not a known key; known here: ", absl::StrJoin(asked_, ", ")));
      break;
    }
  }
  return first_mistake_;
}

absl::StatusOr<nlohmann::json> ParseJson(std::string_view text, std::string_view where) {
  // nlohmann-json keeps the last of two equal keys. Nobody would notice such a mistake in a config,
  // so it is rejected here.
  std::vector<std::set<std::string>> open_objects;
  std::string duplicate;
  bool too_deep = false;
  const auto watch = [&](int depth, nlohmann::json::parse_event_t event, nlohmann::json& parsed) {
    // Copying or writing a value recurses for each level, so deep ones are dropped while parsing.
    too_deep = too_deep || (depth >= kMaxJsonDepth &&
                            (event == nlohmann::json::parse_event_t::object_start ||
                             event == nlohmann::json::parse_event_t::array_start));
    if (too_deep) return false;
    if (event == nlohmann::json::parse_event_t::object_start) open_objects.emplace_back();
    if (event == nlohmann::json::parse_event_t::object_end) open_objects.pop_back();
    if (event == nlohmann::json::parse_event_t::key && duplicate.empty() &&
        !open_objects.back().insert(parsed.get<std::string>()).second) {
      duplicate = parsed.get<std::string>();
    }
    return true;
  };
  try {
    nlohmann::json value = nlohmann::json::parse(text.begin(), text.end(), watch);
    if (too_deep) {
      return absl::InvalidArgumentError(absl::StrCat(
          View(where), ": is nested more than ", kMaxJsonDepth, " deep; make it flatter"));
    }
    if (!duplicate.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(View(where), ": the key \"", Shown(duplicate), "\" appears twice"));
    }
    return value;
  } catch (const nlohmann::json::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(View(where), ": is not valid JSON: ", error.what()));
  }
}

absl::StatusOr<nlohmann::json> ReadJsonFile(const std::string& path, size_t max_bytes) {
  const absl::StatusOr<std::string> text = ReadFile(path, max_bytes);
  return text.ok() ? ParseJson(*text, path) : text.status();
}

std::string CanonicalJson(const nlohmann::json& value) {
  return value.dump(-1, ' ', /*ensure_ascii=*/false, nlohmann::json::error_handler_t::replace);
}

}  // namespace myograde
