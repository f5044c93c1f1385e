// How far something is.
#pragma once

#include <absl/time/time.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

namespace myograde::server {

// A line on standard error: drawn over on a terminal, in which it always fits; elsewhere lines
// of their own, one each 2 s at most.
class Progress {
 public:
  enum class Unit {
    kEpisodes,  // the last line stays
    kBytes,     // shown only if it takes a while, and gone in the end
  };
  explicit Progress(std::string what, Unit unit = Unit::kEpisodes);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `note` stands behind the counts: what is going on, in a few words. `total` 0: not known.
  // `waiting`: nothing can go on (a queue), and the time until the next call says nothing of the
  // pace.
  void Show(int64_t done, int64_t total, const std::string& note, bool waiting = false);

  // Calls Show, with the note `at_end` once all is done. This object must outlive it.
  std::function<void(int64_t done, int64_t total)> Listener(std::string at_end = "") {
    return [this, at_end = std::move(at_end)](int64_t done, int64_t total) {
      Show(done, total, done < total ? "" : at_end);
    };
  }

 private:
  std::string Line(int64_t done, int64_t total, const std::string& note, absl::Duration now,
                   size_t columns) const;

  const std::string what_;
  const Unit unit_;
  const bool terminal_;
  // Moments of the monotonic clock.
  const absl::Duration begun_;
  bool drawn_ = false;
  absl::Duration last_ = -absl::InfiniteDuration();  // something was printed
  std::string last_key_;
  // The pace: since first_ at first_done_, measured when the count last rose.
  absl::Duration first_;
  absl::Duration risen_;
  int64_t first_done_ = -1;
  int64_t risen_done_ = -1;
};

}  // namespace myograde::server
