// Episode logs, which anybody may pass to `log`, `replay` and `verify`. The input is a file as it
// is, or a recipe for one with a valid checksum, so that the code behind the checksum is reached
// too.
#include <cmath>
#include <cstring>

#include "protocol/base/config_reader.h"
#include "protocol/log/episode_log.h"
#include "protocol/log/event_log.h"
#include "protocol/policy/channels.h"
#include "protocol/policy/layout.h"
#include "server/proof/logs.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

namespace {

// What a step of the recipe does.
enum Op : uint8_t { kStep, kStart, kText, kBytes, kTimes, kOps };

TrackConfig ShippedTrack(const char* name) {
  auto track = LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", name, "");
  Require(track.ok(), "a shipped config loads");
  return *std::move(track);
}

const TrackConfig& Track(bool locomotion) {
  static const TrackConfig tracks[] = {ShippedTrack("manipulation"), ShippedTrack("locomotion")};
  return tracks[locomotion ? 1 : 0];
}

ShortDigest TakeDigest(fuzz::Input& input) {
  ShortDigest digest = {};
  const auto bytes = input.Bytes(2);
  std::memcpy(digest.data(), bytes.data(), bytes.size());
  return digest;
}

// Encoded as log_text_t, with the fingerprint of a real event.
std::string TextMessage(const std::string& fingerprint, const std::string& text, int lie) {
  std::string message = fingerprint;
  const auto length = static_cast<uint32_t>(static_cast<int64_t>(text.size()) + 1 + lie);
  for (int shift = 24; shift >= 0; shift -= 8) message += static_cast<char>(length >> shift & 0xff);
  return message + text + '\0';
}

// A log with a valid start, then what the recipe says, then an end that fits or doesn't.
std::string Cook(fuzz::Input& input) {
  const bool locomotion = (input.Byte() & 1) != 0;
  LogHeader header{.track = Track(locomotion), .config = "c", .episode = input.Byte(),
                   .first = true, .seed = 7, .begun = (input.Byte() & 1) == 0};
  const double period = header.track.kind->control_period_s;
  EpisodeLogEncoder encoder(period);
  std::string log;
  encoder.Header(header, log);
  const std::string fingerprint = log.substr(kEventHeadBytes + kLogHeaderChannel.size(), 8);
  const int size = ActionOf(*header.track.kind).size();
  int64_t steps = 0;
  int64_t events = 1;
  const size_t seal = input.Byte();
  while (!input.empty()) {
    switch (input.Byte() % kOps) {
      case kStep: {
        std::vector<double> action(static_cast<size_t>(size), 0.5);
        const uint8_t special = input.Byte();
        const auto bytes = input.Bytes(special % 17);
        std::memcpy(action.data(), bytes.data(), bytes.size());
        if (special > 250) action.pop_back();
        encoder.Step(action, TakeDigest(input), TakeDigest(input), log);
        ++steps;
        events += 2;
        break;
      }
      case kStart:
        encoder.Start({.convention = ActionConvention::kDirect, .parameters = {}}, log);
        ++events;
        break;
      case kText:
      case kBytes: {
        static constexpr std::string_view kOfEvents[] = {
            kLogHeaderChannel, kLogStartChannel, kActionChannel, kLogDigestChannel, kLogEndChannel};
        const uint8_t choice = input.Byte();
        const std::string text = input.Text(input.Byte());
        const std::string message =
            choice < 128 ? TextMessage(fingerprint, text, choice / 64 * (choice % 7 - 3)) : text;
        AppendEvent(events++, steps * 1000, kOfEvents[choice % std::size(kOfEvents)],
                    std::as_bytes(std::span(message)), log);
        encoder.Resume(events, steps);
        break;
      }
      default:
        encoder.Resume(events += input.Byte() % 3, steps += input.Byte() % 3);
        break;
    }
  }
  LogEnd end{.steps = steps, .logged = steps, .end = "time", .digest = "d"};
  if (seal % 8 == 1) ++end.steps;
  if (seal % 8 == 2) ++end.logged;
  encoder.End(end, Sha256Hex(log), log);
  if (seal % 8 == 3) log[log.size() * seal / 256] ^= 1;
  if (seal % 8 == 4) log.resize(log.size() * seal / 256);
  return log;
}

std::string Encode(const EpisodeLog& log) {
  std::string bytes;
  EpisodeLogEncoder encoder(log.header.track.kind->control_period_s);
  encoder.Header(log.header, bytes);
  if (log.start.has_value()) encoder.Start(*log.start, bytes);
  for (int64_t step = 0; step < log.steps(); ++step) {
    const auto i = static_cast<size_t>(step);
    encoder.Step(log.action(step), log.observations[i], log.states[i], bytes);
  }
  encoder.End(log.end, Sha256Hex(bytes), bytes);
  return bytes;
}

void CheckLog(std::string_view bytes) {
  const absl::StatusOr<EpisodeLog> log = ParseEpisodeLog(bytes);
  if (!log.ok()) {
    Require(!log.status().message().empty(), "a refusal says why");
    return;
  }
  Require(log->action_size == ActionOf(*log->header.track.kind).size(), "actions have the track's size");
  Require(log->observations.size() == log->states.size() &&
              log->actions.size() == log->states.size() * static_cast<size_t>(log->action_size),
          "every step is whole");
  Require(log->end.logged == log->steps() && log->end.steps >= log->steps(), "steps are counted");
  for (const double value : log->actions) Require(std::isfinite(value), "actions are numbers");
  const std::string again = Encode(*log);
  const absl::StatusOr<EpisodeLog> reread = ParseEpisodeLog(again);
  Require(reread.ok() && Encode(*reread) == again, "what was read can be written and read again");
  Require(server::CompareLogs(*log, *reread).cause == server::Cause::kNone,
          "a log differs from itself in nothing");
}

}  // namespace

// The first byte: whether the rest is a file or a recipe.
MYOGRADE_FUZZ_TARGET(episode_log)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const uint8_t choice = input.Byte();
  if ((choice & 1) != 0) {
    CheckLog(Cook(input));
    return 0;
  }
  const absl::StatusOr<std::string> log = UnpackLog(input.RestText());
  if (log.ok()) CheckLog(*log);
  return 0;
}
