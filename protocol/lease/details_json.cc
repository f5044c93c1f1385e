// Details as JSON, by the one list of fields that each track's struct has.
#include <cfloat>
#include <cmath>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"

namespace myograde {
namespace {

using DetailsObject = nlohmann::json;

// No result depends on details, so further digits would only cost space.
constexpr double kPartsOfNumber = 1e6;
constexpr double kPartsOfRadian = 1e4;

double Rounded(double value, double parts = kPartsOfNumber) {
  const double rounded = std::round(value * parts) / parts;
  return std::isfinite(rounded) ? rounded : value;
}

DetailsObject DetailToJson(double value) { return Rounded(value); }
DetailsObject DetailToJson(const std::optional<double>& value) {
  return value ? DetailsObject(Rounded(*value)) : DetailsObject();
}
DetailsObject DetailToJson(const JointRange& range) {
  DetailsObject numbers = DetailsObject::array();
  for (const double value : {range.low, range.high, range.limit_low, range.limit_high}) {
    numbers.push_back(Rounded(value, kPartsOfRadian));
  }
  return numbers;
}
template <typename Values, size_t n>
DetailsObject DetailToJson(const ByName<Values, n>& by_name) {
  DetailsObject object = DetailsObject::object();
  for (size_t i = 0; i < n; ++i) {
    object[std::string(by_name.names[i])] = DetailToJson(by_name.values[i]);
  }
  return object;
}

constexpr NumberRange kAnyNumber = {-DBL_MAX, DBL_MAX};

// Reads one object of details; mistakes in objects inside of it become its own.
struct DetailsReader {
  const DetailsObject& json;
  ConfigReader& reader;
  absl::Status& nested;

  void operator()(std::string_view key, double& value) const {
    value = reader.Number(key, kAnyNumber);
  }
  // The key must be there, and may be null.
  void operator()(std::string_view key, std::optional<double>& value) const {
    const auto it = json.is_object() ? json.find(key) : json.end();
    if (json.is_object() && it != json.end() && it->is_null()) {
      reader.Ignore(key);
      value = std::nullopt;
    } else {
      value = reader.Number(key, kAnyNumber);
    }
  }
  void operator()(std::string_view key, JointRange& range) const {
    const std::vector<double> numbers = reader.Numbers(key, 4, kAnyNumber);
    if (numbers.size() == 4) range = {numbers[0], numbers[1], numbers[2], numbers[3]};
  }
  template <typename Values, size_t n>
  void operator()(std::string_view key, ByName<Values, n> by_name) const {
    const DetailsObject& object = reader.Object(key);
    ConfigReader part(object, absl::StrCat(reader.where(), ": ", std::string(key)));
    const DetailsReader read{object, part, nested};
    for (size_t i = 0; i < n; ++i) read(by_name.names[i], by_name.values[i]);
    nested.Update(part.Finish());
  }
};

template <typename One>
absl::Status ReadDetails(const DetailsObject& json, One& details) {
  ConfigReader reader(json, absl::StrCat(std::string(One::kTrack), ": details"));
  absl::Status nested;
  const DetailsReader read{json, reader, nested};
  One::Visit(details, [&read](const char* key, auto&& value) { read(key, value); });
  absl::Status status = reader.Finish();
  status.Update(nested);
  return status;
}

template <typename... Details>
absl::Status ReadDetailsOf(size_t track, const DetailsObject& json,
                           std::variant<Details...>& details) {
  size_t next = 0;
  absl::Status status;
  const auto read = [&]<typename One>(One one) {
    if (next++ != track) return;
    status = ReadDetails(json, one);
    details = one;
  };
  (read(Details()), ...);
  return status;
}

}  // namespace

nlohmann::json DetailsToJson(const TrackDetails& details) {
  return std::visit(
      [](const auto& measured) {
        DetailsObject json = DetailsObject::object();
        measured.Visit(measured, [&json](const char* key, const auto& value) {
          json[key] = DetailToJson(value);
        });
        return json;
      },
      details);
}

absl::StatusOr<TrackDetails> DetailsFromJson(const TrackFacts& track, const nlohmann::json& json) {
  TrackDetails details;
  RETURN_IF_ERROR(ReadDetailsOf(track.index(), json, details));
  return details;
}

}  // namespace myograde
