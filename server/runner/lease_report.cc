#include "server/runner/lease_report.h"

#include <sys/wait.h>

#include <variant>

#include <absl/strings/str_cat.h>

#include "server/base/child_process.h"

namespace myograde::server {

LeaseReport::LeaseReport(const std::vector<EpisodeOrder>& episodes, Limits limits,
                         absl::Duration now)
    : limits_(limits), heard_(now) {
  for (const EpisodeOrder& episode : episodes) ordered_[episode.index] = episode.seed;
}

void LeaseReport::Fail(const std::string& why) {
  if (fault_.empty()) fault_ = why;
}

void LeaseReport::TakeEpisode(int64_t index, std::optional<uint64_t> seed) {
  const auto ordered = ordered_.find(index);
  const bool asked = ordered != ordered_.end() && (!seed || *seed == ordered->second);
  if (asked && reported_.insert(index).second) return;
  // Without the seed: participants may read this, and must not know each seed yet.
  const bool wrong_seed = ordered != ordered_.end() && !asked;
  Fail(absl::StrCat("the runner reported episode ", index,
                    wrong_seed ? " with another seed" : "",
                    asked ? " twice" : ", which the lease did not ask for"));
}

LeaseReport::News LeaseReport::Take(const std::vector<LeaseRecord>& records, absl::Duration now) {
  News news;
  for (const LeaseRecord& record : records) {
    if (faulty()) break;
    heard_ = now;
    if (const auto* progress = std::get_if<ProgressRecord>(&record)) {
      news.progress = *progress;
    } else if (const auto* facts = std::get_if<EpisodeFacts>(&record)) {
      TakeEpisode(facts->index, facts->seed);
      if (!faulty()) news.episodes.push_back(*facts);
    } else if (const auto* replay = std::get_if<ReplayRecord>(&record)) {
      TakeEpisode(replay->episode, std::nullopt);
      if (!faulty()) news.replays.push_back(*replay);
    } else {
      end_ = std::get<LeaseEndRecord>(record);
    }
  }
  return news;
}

void LeaseReport::Tick(absl::Duration now) {
  if (end_.has_value()) return;
  if (now > limits_.deadline) {
    Fail("the runner did not end in its time");
  } else if (now - heard_ > limits_.silence) {
    Fail(absl::StrCat("the runner was silent for ", absl::FormatDuration(limits_.silence)));
  }
}

void LeaseReport::Conclude(int wait_status, const std::string& last_words) {
  if (faulty()) return;
  if (!end_.has_value()) {
    const std::string words = LastLineOf(last_words);  // the whole is in the log
    Fail(absl::StrCat("the runner ended (",
                      WIFSIGNALED(wait_status)
                          ? absl::StrCat("signal ", WTERMSIG(wait_status))
                          : absl::StrCat("exit status ", WEXITSTATUS(wait_status)),
                      ") without its last record; ",
                      words.empty() ? "it printed nothing" : "its last words: " + words));
  } else if (!end_->ok) {
    Fail(end_->detail.empty() ? "the runner ended with a fault and reported no reason" : end_->detail);
  } else if (reported_.size() != ordered_.size()) {
    Fail(absl::StrCat("the runner said done after ", reported_.size(), " of ", ordered_.size(),
                      " episodes"));
  }
}

}  // namespace myograde::server
