// How far something is.
#pragma once

#include <absl/time/time.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

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
  void Show(int64_t done, int64_t total, const std::string& note);

  // Calls Show without a note. This object must outlive it.
  std::function<void(int64_t done, int64_t total)> Listener() {
    return [this](int64_t done, int64_t total) { Show(done, total, ""); };
  }

  // The same while nothing can go on (a queue): that time says nothing of the pace.
  void ShowWaiting(int64_t done, int64_t total, const std::string& note);

 private:
  void Pace(int64_t done, absl::Duration now);
  std::string Counts(int64_t done, int64_t total) const;
  std::string Rate() const;
  // "3 min left" as of the last change, less what has gone by; "" if nothing is known.
  std::string Left(int64_t done, int64_t total, absl::Duration now) const;
  std::string Line(int64_t done, int64_t total, const std::string& note, absl::Duration now,
                   size_t columns) const;
  void Print(int64_t done, int64_t total, const std::string& note);

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
