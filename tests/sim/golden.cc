#include "tests/sim/golden.h"

#include <zstd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "protocol/base/json_templates.h"  // the files are large, and tests are compiled without optimization

namespace myograde::sim {
namespace {

namespace fs = std::filesystem;

std::string Variable(const char* name, const char* otherwise) {
  const char* value = std::getenv(name);
  return value != nullptr && *value != '\0' ? value : otherwise;
}

std::string Decompress(const std::string& packed, const std::string& path) {
  const auto size = ZSTD_getFrameContentSize(packed.data(), packed.size());
  constexpr unsigned long long kMaxSize = 1ull << 30;
  if (size > kMaxSize) throw std::runtime_error(path + " is not a zstd file of known size");
  std::string text(size, '\0');
  const size_t got = ZSTD_decompress(text.data(), text.size(), packed.data(), packed.size());
  if (ZSTD_isError(got) || got != size) {
    throw std::runtime_error(path + ": " + ZSTD_getErrorName(got));
  }
  return text;
}

GoldenFile Load(const fs::path& path) {
  auto text = ReadFile(path.string());
  if (!text.ok()) throw std::runtime_error(std::string(text.status().message()));
  if (path.extension() == ".zst") *text = Decompress(*text, path.string());
  std::string name = path.filename().string();
  name.erase(name.find(".json"));
  try {
    return {name, nlohmann::json::parse(*text)};
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(path.string() + ": " + error.what());
  }
}

}  // namespace

std::vector<GoldenFile> GoldenFiles() {
  return GoldenFilesIn(Variable("MYOGRADE_GOLDEN", MYOGRADE_SOURCE_DIR "/tests/golden"));
}

std::vector<GoldenFile> GoldenFilesIn(const std::string& folder) {
  if (!fs::is_directory(folder)) {
    throw std::runtime_error("no folder " + folder + " with golden files: set MYOGRADE_GOLDEN");
  }
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.ends_with(".json") || name.ends_with(".json.zst")) paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<GoldenFile> files;
  for (const auto& path : paths) files.push_back(Load(path));
  return files;
}

std::string CacheDir() { return Variable("MYOGRADE_CACHE", MYOGRADE_DEFAULT_CACHE); }

std::string TapesDir() { return Variable("MYOGRADE_TAPES", ""); }

absl::StatusOr<TrackConfig> OfficialConfig(const SimulatedTrack& track) {
  const std::string folder = MYOGRADE_SOURCE_DIR "/configs/tracks";
  const std::string name(track.kind->name);
  auto config = LoadTrackConfig(folder, name, "myosuite");
  return config.ok() ? config : LoadTrackConfig(folder, name, "official");
}

std::optional<std::vector<double>> RecordedAction(const nlohmann::json& file,
                                                  const nlohmann::json& step, int t) {
  if (step.is_object() && step.contains("action")) return Doubles(step["action"]);
  if (!file.contains("actions")) return std::nullopt;
  const nlohmann::json& actions = file["actions"];
  if (t >= std::ssize(actions)) {
    throw std::runtime_error("a golden file has actions for " + std::to_string(actions.size()) +
                             " steps, but step " + std::to_string(t) + " was recorded");
  }
  return Doubles(actions[static_cast<size_t>(t)]);
}

double Number(const nlohmann::json& value) {
  return value.is_boolean() ? value.get<bool>() : value.get<double>();
}

std::vector<double> Doubles(const nlohmann::json& array) {
  std::vector<double> numbers;
  for (const auto& entry : array) {
    if (entry.is_array()) {
      const auto inner = Doubles(entry);
      numbers.insert(numbers.end(), inner.begin(), inner.end());
    } else {
      numbers.push_back(Number(entry));
    }
  }
  return numbers;
}

void GoldenTable::Add(std::string_view quantity, std::span<const double> got,
                      std::span<const double> want, double tolerance, Scale scale,
                      std::string_view where) {
  auto row = std::find_if(rows_.begin(), rows_.end(),
                          [&](const Row& r) { return r.quantity == quantity; });
  if (row == rows_.end()) {
    row = rows_.emplace(row);
    row->quantity = quantity;
  }
  row->numbers += want.size();
  row->tolerance = std::max(row->tolerance, tolerance);
  if (got.size() != want.size()) {
    ADD_FAILURE() << quantity << " at " << where << ": " << got.size() << " numbers, expected "
                  << want.size();
    return;
  }
  double largest_want = 1;
  for (const double x : want) largest_want = std::max(largest_want, std::abs(x));
  for (size_t i = 0; i < want.size(); ++i) {
    double difference = std::abs(got[i] - want[i]);
    if (scale == Scale::kEntry) difference /= std::max(1.0, std::abs(want[i]));
    if (scale == Scale::kVector) difference /= largest_want;
    if (!(difference <= row->largest)) {
      row->largest = difference;
      row->where = std::string(where) + " [" + std::to_string(i) + "]";
    }
    if (!(difference <= tolerance)) {
      ADD_FAILURE() << quantity << "[" << i << "] at " << where << ": got " << got[i]
                    << ", golden " << want[i] << ", difference " << difference << " > "
                    << tolerance;
      return;  // one entry per comparison says enough
    }
  }
}

void GoldenTable::Compare(std::string_view quantity, std::span<const double> got,
                          std::span<const double> want, double tolerance,
                          std::string_view where) {
  Add(quantity, got, want, tolerance, Scale::kAbsolute, where);
}

void GoldenTable::Compare(std::string_view quantity, double got, double want, double tolerance,
                          std::string_view where) {
  Add(quantity, {&got, 1}, {&want, 1}, tolerance, Scale::kAbsolute, where);
}

void GoldenTable::CompareRelative(std::string_view quantity, std::span<const double> got,
                                  std::span<const double> want, double tolerance,
                                  std::string_view where) {
  Add(quantity, got, want, tolerance, Scale::kEntry, where);
}

void GoldenTable::CompareRelative(std::string_view quantity, double got, double want,
                                  double tolerance, std::string_view where) {
  Add(quantity, {&got, 1}, {&want, 1}, tolerance, Scale::kEntry, where);
}

void GoldenTable::CompareScaled(std::string_view quantity, std::span<const double> got,
                                std::span<const double> want, double tolerance,
                                std::string_view where) {
  Add(quantity, got, want, tolerance, Scale::kVector, where);
}

void GoldenTable::CompareExact(std::string_view quantity, double got, double want,
                               std::string_view where) {
  Add(quantity, {&got, 1}, {&want, 1}, 0, Scale::kAbsolute, where);
}

void GoldenTable::CompareExact(std::string_view quantity, std::span<const double> got,
                               std::span<const double> want, std::string_view where) {
  Add(quantity, got, want, 0, Scale::kAbsolute, where);
}

void GoldenTable::Print(std::string_view title) const {
  std::printf("\n%.*s\n%-44s %9s %10s %10s  %s\n", static_cast<int>(title.size()), title.data(),
              "quantity", "numbers", "tolerance", "largest", "where");
  for (const Row& row : rows_) {
    std::printf("%-44s %9zu %10.1e %10.1e  %s\n", row.quantity.c_str(), row.numbers,
                row.tolerance, row.largest, row.where.c_str());
  }
  std::fflush(stdout);
}

}  // namespace myograde::sim
