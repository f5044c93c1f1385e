// What the golden tests of the tracks share: finding and reading the golden
// files, and a table of the largest differences seen.
//
//   for (const GoldenFile& file : GoldenFiles()) {
//     if (file.json.contains("resets")) CheckResets(file, table);
//   }
//   table.Print();
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/track_config.h"
#include "sim/tracks.h"

namespace myograde::sim {

struct GoldenFile {
  std::string name;  // without folder and without .json or .json.zst
  nlohmann::json json;
};

// Every *.json and *.json.zst of the folder MYOGRADE_GOLDEN (default:
// tests/golden of the source tree), sorted by name. Throws std::runtime_error
// with a sentence if the folder or a file can't be read.
std::vector<GoldenFile> GoldenFiles();
std::vector<GoldenFile> GoldenFilesIn(const std::string& folder);

// The unpacked packages: MYOGRADE_CACHE, else what the build was made with.
std::string CacheDir();

// The recorded episodes outside the project: MYOGRADE_TAPES, "" if not set.
std::string TapesDir();

// The profile of a track that follows the official code.
absl::StatusOr<TrackConfig> OfficialConfig(const SimulatedTrack& track);

// What a recording says was done in step t after a reset: the step's own `action`, or entry t of
// the list `actions` at the top of its file (the same after every reset). Without either, what
// is played follows from the file: its formula, or the recorded controls. `step` may be null.
// Throws std::runtime_error if the list is shorter.
std::optional<std::vector<double>> RecordedAction(const nlohmann::json& file,
                                                  const nlohmann::json& step, int t);

// Numbers of a recording; false and true count as 0 and 1, nested arrays are flattened.
double Number(const nlohmann::json& value);
std::vector<double> Doubles(const nlohmann::json& array);

// Largest differences by quantity. A quantity is compared within `tolerance`;
// each comparison that exceeds it fails the running test with its place.
class GoldenTable {
 public:
  // |got - want| per entry. `where` names file and step in a failure.
  void Compare(std::string_view quantity, std::span<const double> got,
               std::span<const double> want, double tolerance, std::string_view where);
  void Compare(std::string_view quantity, double got, double want, double tolerance,
               std::string_view where);
  // |got - want| / max(1, |want|) per entry: for quantities of any size.
  void CompareRelative(std::string_view quantity, std::span<const double> got,
                       std::span<const double> want, double tolerance, std::string_view where);
  void CompareRelative(std::string_view quantity, double got, double want, double tolerance,
                       std::string_view where);
  // |got - want| / max(1, largest |want| of the vector): for results of a solver,
  // whose error is one of the whole vector.
  void CompareScaled(std::string_view quantity, std::span<const double> got,
                     std::span<const double> want, double tolerance, std::string_view where);
  // Equality, for labels, counts and flags.
  void CompareExact(std::string_view quantity, double got, double want, std::string_view where);
  void CompareExact(std::string_view quantity, std::span<const double> got,
                    std::span<const double> want, std::string_view where);

  // Prints one line per quantity: how many numbers, tolerance, largest difference and where.
  void Print(std::string_view title) const;
  bool empty() const { return rows_.empty(); }

 private:
  struct Row {
    std::string quantity;
    size_t numbers = 0;
    double tolerance = 0;
    double largest = 0;
    std::string where;  // of the largest difference
  };
  enum class Scale { kAbsolute, kEntry, kVector };
  void Add(std::string_view quantity, std::span<const double> got, std::span<const double> want,
           double tolerance, Scale scale, std::string_view where);

  std::vector<Row> rows_;
};

}  // namespace myograde::sim
