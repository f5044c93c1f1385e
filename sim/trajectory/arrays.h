// The arrays of a trajectory file (README.md): numbers, quantised and stored so that they compress.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

namespace myograde::sim {

// How an array's numbers are stored.
enum class NumberType { kU8, kU16 };

// The interval that a channel's whole numbers, from 0 to 255 or 65535, stand for.
struct ChannelRange {
  double low = 0;
  double high = 0;
};

// The smallest interval with all finite values; [0, 0] if there are none.
ChannelRange RangeOf(std::span<const float> values);

// Collects the arrays of one file.
class ArrayBlock {
 public:
  // Adds an array. `values` are `ranges.size()` channels of `length` numbers each, one channel after
  // the other; with one range for all, `channels` says how many there are. Numbers out of range take
  // its end, and those that are not finite are the one before. REQUIRES: the sizes fit, and no array
  // of the name was added before.
  void Add(std::string_view name, NumberType type, std::span<const float> values, size_t channels,
           std::span<const ChannelRange> ranges);

  // The object "arrays" of the head.
  const nlohmann::json& head() const { return head_; }
  const std::string& bytes() const { return bytes_; }

 private:
  nlohmann::json head_ = nlohmann::json::object();
  std::string bytes_;
};

}  // namespace myograde::sim
