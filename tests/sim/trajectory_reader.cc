#include "tests/sim/trajectory_reader.h"

#include <cstdint>
#include <map>

namespace myograde::sim {
namespace {

using Json = nlohmann::json;

double BoundOf(const Json& bound, size_t channel) {
  return (bound.is_array() ? bound.at(channel) : bound).get<double>();
}

size_t BytesOf(const Json& array) {
  return array["channels"].get<size_t>() * array["length"].get<size_t>() *
         (array["type"] == "u16" ? 2 : 1);
}

}  // namespace

absl::StatusOr<ReadTrajectory> ParseTrajectory(std::string_view file) {
  if (file.size() < 12 || file.substr(0, 8) != "MYOTRAJ1") {
    return absl::InvalidArgumentError("no magic");
  }
  size_t length = 0;
  for (size_t i = 0; i < 4; ++i) length |= static_cast<size_t>(static_cast<uint8_t>(file[8 + i])) << (8 * i);
  if (length > (1 << 20) || length > file.size() - 12) {
    return absl::InvalidArgumentError("no room for the head");
  }
  ReadTrajectory read;
  read.head = Json::parse(file.substr(12, length), nullptr, /*allow_exceptions=*/false);
  if (!read.head.is_object()) return absl::InvalidArgumentError("the head is no JSON object");
  read.arrays = file.substr(12 + length);
  std::map<size_t, size_t> sizes;  // by offset, of those that have any
  size_t total = 0;
  for (const Json& array : read.head["arrays"]) {
    if (array["bytes"] != BytesOf(array)) return absl::InvalidArgumentError("wrong bytes");
    if (array["bytes"] == 0) continue;
    sizes[array["offset"].get<size_t>()] = array["bytes"].get<size_t>();
  }
  for (const auto& [offset, bytes] : sizes) {
    if (offset != total) return absl::InvalidArgumentError("a gap between arrays");
    total += bytes;
  }
  if (total != read.arrays.size()) return absl::InvalidArgumentError("wrong length");
  return read;
}

std::vector<int> ReadTrajectory::Numbers(const std::string& array, size_t channel) const {
  const Json& entry = head.at("arrays").at(array);
  const auto length = entry["length"].get<size_t>();
  const size_t all = entry["channels"].get<size_t>() * length;
  const bool wide = entry["type"] == "u16";
  std::vector<int> numbers;
  int number = 0;
  for (size_t i = channel * length; i < (channel + 1) * length; ++i) {
    const size_t at = entry["offset"].get<size_t>() + i;
    int stored = static_cast<uint8_t>(arrays.at(at));
    if (wide) stored |= static_cast<uint8_t>(arrays.at(at + all)) << 8;
    const int difference = stored % 2 == 0 ? stored / 2 : -(stored + 1) / 2;
    number = (number + difference) & (wide ? 0xFFFF : 0xFF);
    numbers.push_back(number);
  }
  return numbers;
}

std::vector<double> ReadTrajectory::Values(const std::string& array, size_t channel) const {
  const Json& entry = head.at("arrays").at(array);
  const double low = BoundOf(entry["low"], channel);
  const double high = BoundOf(entry["high"], channel);
  std::vector<double> values;
  for (const int number : Numbers(array, channel)) {
    values.push_back(low + number * (high - low) / (entry["type"] == "u16" ? 65535 : 255));
  }
  return values;
}

}  // namespace myograde::sim
