#include "server/cli/terminal/progress.h"

#include <unistd.h>

#include <algorithm>
#include <iostream>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "protocol/base/clock.h"
#include "server/cli/terminal/screen.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kRedraw = absl::Milliseconds(100);
constexpr absl::Duration kBetweenLines = absl::Seconds(2);
constexpr absl::Duration kBetweenByteLines = absl::Seconds(10);
constexpr absl::Duration kShortBytes = absl::Seconds(1);  // who takes no longer is not shown
constexpr size_t kWidestBar = 30;
constexpr size_t kNarrowestBar = 10;
constexpr size_t kNarrowestNote = 8;

std::string Bytes(int64_t bytes) {
  const auto value = static_cast<double>(bytes);
  if (value >= 1e9) return absl::StrFormat("%.2f GB", value / 1e9);
  if (value >= 1e6) return absl::StrFormat("%.1f MB", value / 1e6);
  return absl::StrFormat("%.0f kB", value / 1e3);
}

}  // namespace

Progress::Progress(std::string what, Unit unit)
    : what_(Harmless(what)),
      unit_(unit),
      terminal_(::isatty(STDERR_FILENO) == 1),
      begun_(SystemClock().Monotonic()) {}

Progress::~Progress() {
  if (!drawn_) return;
  std::cerr << (unit_ == Unit::kBytes ? "\r\033[K" : "\n") << std::flush;
}

std::string Progress::Line(int64_t done, int64_t total, const std::string& note, absl::Duration now,
                           size_t columns) const {
  const bool bytes = unit_ == Unit::kBytes;
  const std::string counts = !bytes      ? absl::StrCat(done, "/", total)
                             : total > 0 ? absl::StrCat(Bytes(done), " of ", Bytes(total))
                                         : Bytes(done);
  // The pace, and "3 min left" as of the last change, less what has gone by; "" if nothing is
  // known.
  std::string rate;
  std::string left;
  const auto fresh = static_cast<double>(risen_done_ - first_done_);
  const double spent = absl::ToDoubleSeconds(risen_ - first_);
  if (fresh > 0 && spent > 0) {
    rate = bytes ? Bytes(static_cast<int64_t>(fresh / spent)) + "/s"
                 : absl::StrFormat("%.2f/min", 60 * fresh / spent);
  }
  if (fresh > 0 && done < total) {
    const double seconds = spent / fresh * static_cast<double>(total - risen_done_) -
                           absl::ToDoubleSeconds(now - risen_);
    // Later than thought: how much, the next one that ends will tell.
    if (seconds >= 1) left = DurationText(seconds) + " left";
  }
  std::string said = Harmless(note);
  std::string bar;
  if (columns > 0) {
    // By importance: what and how many, how long, the note, the bar, the pace.
    const auto taken = [](const std::string& part) {
      return part.empty() ? 0 : TextWidth(part) + 2;
    };
    size_t room = columns - std::min(columns, TextWidth(what_) + taken(counts));
    if (taken(left) > room) left.clear();
    room -= taken(left);
    said = room < kNarrowestNote + 2 ? "" : CutText(said, room - 2);
    room -= taken(said);
    if (total > 0 && room >= kNarrowestBar + 4) {
      const size_t width = std::min(kWidestBar, room - 4);
      const auto filled = static_cast<size_t>(static_cast<int64_t>(width) *
                                              std::clamp<int64_t>(done, 0, total) / total);
      bar = "[" + std::string(filled, '#') + std::string(width - filled, '.') + "]";
    }
    room -= taken(bar);
    if (taken(rate) > room) rate.clear();
  }
  std::string line = what_;
  for (const std::string& part : {bar, counts, rate, left, said}) {
    if (!part.empty()) absl::StrAppend(&line, "  ", part);
  }
  return columns > 0 ? CutText(line, columns) : line;
}

void Progress::Show(int64_t done, int64_t total, const std::string& note, bool waiting) {
  const absl::Duration now = SystemClock().Monotonic();
  if (first_done_ < 0 || waiting) {
    first_ = risen_ = now;
    first_done_ = risen_done_ = done;
  } else if (done > risen_done_) {
    risen_ = now;
    risen_done_ = done;
  }
  if (unit_ == Unit::kBytes && now - begun_ < kShortBytes) return;
  const std::string key = absl::StrCat(done, "/", total, note);
  if (terminal_) {
    if (now - last_ < kRedraw && done < total) return;
    // The last column stays free: a terminal would begin a new line behind it.
    std::cerr << "\r\033[K" << Line(done, total, note, now, TerminalColumns(STDERR_FILENO) - 1)
              << std::flush;
    drawn_ = true;
  } else {
    // Only what changed: a log of an hour's waiting should stay readable.
    const absl::Duration between = unit_ == Unit::kBytes ? kBetweenByteLines : kBetweenLines;
    if (key == last_key_ || (now - last_ < between && done < total)) return;
    if (unit_ == Unit::kBytes && now - begun_ < between) return;
    std::cerr << Line(done, total, note, now, 0) << std::endl;
    last_key_ = key;
  }
  last_ = now;
}

}  // namespace myograde::server
