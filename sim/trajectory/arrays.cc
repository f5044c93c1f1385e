#include "sim/trajectory/arrays.h"

#include <algorithm>
#include <cmath>

namespace myograde::sim {
namespace {

// Whole numbers for a channel's values.
void Quantise(std::span<const float> values, const ChannelRange& range, double most,
              std::vector<uint16_t>& out) {
  const double width = range.high - range.low;
  uint16_t last = 0;
  for (const float value : values) {
    if (std::isfinite(value) && width > 0) {
      const double share = std::clamp((value - range.low) / width, 0.0, 1.0);
      last = static_cast<uint16_t>(std::lround(share * most));
    }
    out.push_back(last);
  }
}

// A difference modulo 2^bits as a number that is small if it is near 0 from either side.
uint16_t Zigzag(int difference, int bits) {
  const int whole = 1 << bits;
  const int wrapped = ((difference % whole) + whole + whole / 2) % whole - whole / 2;
  return static_cast<uint16_t>(wrapped >= 0 ? 2 * wrapped : -2 * wrapped - 1);
}

// Replaces each number by its difference from the one before in its channel.
void Differentiate(std::vector<uint16_t>& numbers, size_t length, int bits) {
  for (size_t begin = 0; begin < numbers.size(); begin += length) {
    int before = 0;
    for (size_t i = begin; i < begin + length; ++i) {
      const int number = numbers[i];
      numbers[i] = Zigzag(number - before, bits);
      before = number;
    }
  }
}

nlohmann::json Bounds(std::span<const ChannelRange> ranges, double ChannelRange::*which) {
  if (ranges.size() == 1) return ranges.front().*which;
  nlohmann::json list = nlohmann::json::array();
  for (const ChannelRange& range : ranges) list.push_back(range.*which);
  return list;
}

}  // namespace

ChannelRange RangeOf(std::span<const float> values) {
  ChannelRange range;
  bool any = false;
  for (const float value : values) {
    if (!std::isfinite(value)) continue;
    range.low = any ? std::min<double>(range.low, value) : value;
    range.high = any ? std::max<double>(range.high, value) : value;
    any = true;
  }
  return range;
}

void ArrayBlock::Add(std::string_view name, NumberType type, std::span<const float> values,
                     size_t channels, std::span<const ChannelRange> ranges) {
  const bool wide = type == NumberType::kU16;
  const size_t length = channels == 0 ? 0 : values.size() / channels;
  std::vector<uint16_t> numbers;
  numbers.reserve(values.size());
  for (size_t c = 0; c < channels; ++c) {
    Quantise(values.subspan(c * length, length), ranges.size() == 1 ? ranges[0] : ranges[c],
             wide ? 65535 : 255, numbers);
  }
  if (length > 0) Differentiate(numbers, length, wide ? 16 : 8);
  const size_t offset = bytes_.size();
  for (const uint16_t number : numbers) bytes_.push_back(static_cast<char>(number & 0xFF));
  if (wide) {
    for (const uint16_t number : numbers) bytes_.push_back(static_cast<char>(number >> 8));
  }
  head_[std::string(name)] = {{"offset", offset},
                              {"bytes", bytes_.size() - offset},
                              {"type", wide ? "u16" : "u8"},
                              {"channels", channels},
                              {"length", length},
                              {"low", Bounds(ranges, &ChannelRange::low)},
                              {"high", Bounds(ranges, &ChannelRange::high)}};
}

}  // namespace myograde::sim
