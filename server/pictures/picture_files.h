// The folder of what was made of episodes' logs: trajectories, small pictures, and the tracks' model
// files. Everything in it can be made again, so it is kept within a size.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include <absl/status/status.h>

namespace myograde::server {

enum class PictureKind { kTrajectory, kPicture, kModel };

// What is to be made: of a log by its hash, or of a track by its name.
struct PictureKey {
  PictureKind kind = PictureKind::kTrajectory;
  std::string of;

  auto operator<=>(const PictureKey&) const = default;
};

// How a file's bytes are packed. Pictures are packed already, and have kPlain alone; the others have
// the other two.
enum class Packing { kPlain, kZstd, kGzip };

// Safe from any thread, but files are added by one alone.
class PictureFiles {
 public:
  // `build`: identifies the programs that make them (asked once, when it is first needed, as it reads
  // them); files of another build are not found.
  PictureFiles(std::string folder, std::function<std::string()> build, int64_t most_bytes);

  // Removes drafts of an earlier daemon.
  void RemoveDrafts() const;

  // The path of a file, and a strong entity tag for it; nullopt if it is not there. It counts as used.
  struct Found {
    std::string path;
    std::string tag;  // quotes included
  };
  std::optional<Found> Find(const PictureKey& key, Packing packing) const;
  bool Has(const PictureKey& key) const;

  // Keeps the file in the packings of its kind; then removes others, those unused for the longest
  // first, until all together are within the size. InternalError: it can't be written.
  absl::Status Keep(const PictureKey& key, std::string_view bytes) const;

 private:
  const std::string& Build() const;
  std::string PathOf(const PictureKey& key, Packing packing) const;
  void Trim() const;

  const std::string folder_;
  const std::function<std::string()> ask_build_;
  const int64_t most_bytes_;
  mutable std::once_flag asked_;
  mutable std::string build_;
};

}  // namespace myograde::server
