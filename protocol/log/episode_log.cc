#include "protocol/log/episode_log.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <utility>

#include <absl/strings/str_cat.h>

#include "myograde/action_t.hpp"
#include "myograde/log_text_t.hpp"
#include "myograde/step_digest_t.hpp"
#include "protocol/base/status_macros.h"
#include "protocol/policy/channels.h"
#include "protocol/base/config_reader.h"
#include "protocol/log/event_log.h"
#include "protocol/policy/layout.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

constexpr int64_t kFormat = 1;

Json HeaderToJson(const LogHeader& header) {
  return {{"format", kFormat},          {"track", header.track.effective},
          {"config", header.config},    {"episode", header.episode},
          {"first", header.first},      {"seed", header.seed},
          {"begun", header.begun}};
}

absl::StatusOr<LogHeader> HeaderFromJson(const Json& json) {
  ConfigReader reader(json, "the log's header");
  LogHeader header;
  if (reader.Integer("format", 1, INT64_MAX) != kFormat) {
    reader.Fail("format", absl::StrCat("is not ", kFormat, ", the one that is known here"));
  }
  const Json& track = reader.Object("track");
  header.config = reader.String("config");
  header.episode = reader.Integer("episode", 0, INT64_MAX);
  header.first = reader.Boolean("first");
  header.begun = reader.Boolean("begun");
  header.seed = static_cast<uint64_t>(reader.Integer("seed", 0, INT64_MAX));
  RETURN_IF_ERROR(reader.Finish());
  ASSIGN_OR_RETURN(header.track, ParseTrackConfig(track, "the log's header: track"));
  return header;
}

absl::StatusOr<LogStart> StartFromJson(const Json& json) {
  ConfigReader reader(json, "the log's start");
  LogStart start;
  start.convention =
      reader.Boolean("direct") ? ActionConvention::kDirect : ActionConvention::kNormalized;
  // The only parameters that there were when logs got their form.
  start.parameters = reader.Object("leg_sets");
  RETURN_IF_ERROR(reader.Finish());
  return start;
}

// The checksum at the end of a log covers the bytes before its last event, by their SHA-256, and
// that event's content.
std::string ComputeChecksum(const std::string& before, const LogEnd& end) {
  return Sha256Hex(before + CanonicalJson({{"steps", end.steps},
                                           {"logged", end.logged},
                                           {"end", end.end},
                                           {"digest", end.digest}}));
}

Json EndToJson(const LogEnd& end, const std::string& before) {
  return {{"steps", end.steps},
          {"logged", end.logged},
          {"end", end.end},
          {"digest", end.digest},
          {"checksum", ComputeChecksum(before, end)}};
}

int64_t MicrosecondsOf(int64_t step, double period) {
  return std::llround(static_cast<double>(step) * period * 1e6);
}

absl::StatusOr<LogEnd> EndFromJson(const Json& json, std::string& checksum) {
  ConfigReader reader(json, "the log's end");
  LogEnd end;
  end.steps = reader.Integer("steps", 0, INT64_MAX);
  end.logged = reader.Integer("logged", 0, INT64_MAX);
  end.end = reader.String("end");
  end.digest = reader.String("digest");
  checksum = reader.String("checksum");
  RETURN_IF_ERROR(reader.Finish());
  return end;
}

// The JSON inside a log_text_t. Lengths are checked before LCM's decoder, which would trust them.
absl::StatusOr<Json> TextOf(const LogEvent& event) {
  const absl::Status bad = absl::DataLossError(
      absl::StrCat("the log's event ", event.number, " can't be decoded"));
  constexpr size_t kHead = 12;  // fingerprint and length
  if (event.message.size() <= kHead) return bad;
  uint32_t length = 0;
  for (size_t i = 8; i < kHead; ++i) {
    length = length << 8 | std::to_integer<uint32_t>(event.message[i]);
  }
  if (length == 0 || length != event.message.size() - kHead) return bad;
  log_text_t text;
  if (text.decode(event.message.data(), 0, static_cast<int>(event.message.size())) !=
      static_cast<int>(event.message.size())) {
    return bad;
  }
  return ParseJson(text.json, absl::StrCat("the log's event ", event.number));
}

// The largest text in a log, in bytes: a track's config is the longest.
constexpr size_t kMaxTextBytes = 1 << 20;

// Accumulates a log from its events, one after the other.
class Parser {
 public:
  explicit Parser(std::string_view bytes) : bytes_(bytes) {}

  absl::StatusOr<EpisodeLog> Parse() {
    EventLogReader reader(bytes_);
    while (true) {
      ASSIGN_OR_RETURN(std::optional<LogEvent> event, reader.Next());
      if (!event.has_value()) break;
      RETURN_IF_ERROR(Take(*event));
    }
    if (!ended_) return absl::DataLossError("the log is cut: its last event is missing");
    return std::move(log_);
  }

 private:
  absl::Status Take(const LogEvent& event) {
    if (event.number != number_++ || ended_) return OutOfTurn(event);
    if (event.channel == kActionChannel) return TakeAction(event);
    if (event.channel == kLogDigestChannel) return TakeDigest(event);
    ASSIGN_OR_RETURN(Json json, TextOf(event));
    if (event.channel == kLogHeaderChannel && event.number == 0) {
      ASSIGN_OR_RETURN(log_.header, HeaderFromJson(json));
      log_.action_size = ActionOf(*log_.header.track.kind).size();
      return absl::OkStatus();
    }
    if (event.channel == kLogStartChannel && event.number == 1) {
      ASSIGN_OR_RETURN(log_.start, StartFromJson(json));
      return absl::OkStatus();
    }
    if (event.channel == kLogEndChannel && event.number > 0) return TakeEnd(event, json);
    return OutOfTurn(event);
  }

  absl::Status TakeAction(const LogEvent& event) {
    if (!log_.start.has_value() || half_) return OutOfTurn(event);
    const auto size = static_cast<size_t>(log_.action_size);
    // Fingerprint, episode, step, size, values: the length must fit before LCM's decoder allocates
    // what the message claims.
    const size_t expected = 8 + 8 + 8 + 4 + 8 * size;
    action_t action;
    if (event.message.size() != expected || event.message[24] != std::byte{0} ||
        event.message[25] != std::byte{0} || event.message[26] != std::byte{0} ||
        event.message[27] != static_cast<std::byte>(size) ||
        action.decode(event.message.data(), 0, static_cast<int>(expected)) !=
            static_cast<int>(expected) ||
        action.episode != log_.header.episode || action.step != log_.steps()) {
      return OutOfTurn(event);
    }
    for (const double value : action.values) {
      if (!std::isfinite(value)) return OutOfTurn(event);
    }
    log_.actions.insert(log_.actions.end(), action.values.begin(), action.values.end());
    half_ = true;
    return absl::OkStatus();
  }

  absl::Status TakeDigest(const LogEvent& event) {
    step_digest_t digest;
    const int size = static_cast<int>(event.message.size());
    if (!half_ || size != digest.getEncodedSize() ||
        digest.decode(event.message.data(), 0, size) != size || digest.step != log_.steps() ||
        digest.episode != log_.header.episode) {
      return OutOfTurn(event);
    }
    std::memcpy(log_.observations.emplace_back().data(), digest.observation, sizeof(ShortDigest));
    std::memcpy(log_.states.emplace_back().data(), digest.state, sizeof(ShortDigest));
    half_ = false;
    return absl::OkStatus();
  }

  absl::Status TakeEnd(const LogEvent& event, const Json& json) {
    std::string checksum;
    ASSIGN_OR_RETURN(LogEnd end, EndFromJson(json, checksum));
    const std::string before = Sha256Hex(bytes_.substr(0, event.offset));
    // The last event must be, byte for byte, the one that such a log ends with.
    EpisodeLogEncoder encoder(log_.header.track.kind->control_period_s);
    std::string seal;
    encoder.Resume(event.number, log_.steps());
    encoder.End(end, before, seal);
    if (checksum != ComputeChecksum(before, end) || seal != bytes_.substr(event.offset)) {
      return absl::DataLossError(
          "the log was altered or damaged: its bytes do not fit the checksum at its end");
    }
    if (half_ || end.logged != log_.steps() || end.logged > end.steps) return OutOfTurn(event);
    log_.end = std::move(end);
    ended_ = true;
    return absl::OkStatus();
  }

  static absl::Status OutOfTurn(const LogEvent& event) {
    return absl::DataLossError(absl::StrCat(
        "the event at byte ", event.offset, " does not belong there; this is not a log of an "
        "episode, or it was altered"));
  }

  const std::string_view bytes_;
  EpisodeLog log_;
  int64_t number_ = 0;
  bool half_ = false;  // an action has arrived, its digest has not
  bool ended_ = false;
};

}  // namespace

ShortDigest Shorten(const Sha256Digest& digest) {
  ShortDigest first;
  std::memcpy(first.data(), digest.data(), first.size());
  return first;
}

struct EpisodeLogEncoder::Messages {
  action_t action;
  step_digest_t digest;
  log_text_t text;
};

EpisodeLogEncoder::EpisodeLogEncoder(double period)
    : period_(period), messages_(std::make_unique<Messages>()) {}
EpisodeLogEncoder::~EpisodeLogEncoder() = default;

template <typename Message>
void EpisodeLogEncoder::Append(std::string_view channel, int64_t time_us, const Message& message,
                               std::string& out) {
  const int size = message.getEncodedSize();
  if (buffer_.size() < static_cast<size_t>(size)) buffer_.resize(static_cast<size_t>(size));
  message.encode(buffer_.data(), 0, size);
  AppendEvent(number_++, time_us, channel, std::span(buffer_).first(static_cast<size_t>(size)),
              out);
}

void EpisodeLogEncoder::AppendText(std::string_view channel, const Json& json, std::string& out) {
  messages_->text.json = CanonicalJson(json);
  Append(channel, MicrosecondsOf(step_, period_), messages_->text, out);
}

void EpisodeLogEncoder::Header(const LogHeader& header, std::string& out) {
  number_ = 0;
  step_ = 0;
  episode_ = header.episode;
  AppendText(kLogHeaderChannel, HeaderToJson(header), out);
}

void EpisodeLogEncoder::Start(const LogStart& start, std::string& out) {
  AppendText(kLogStartChannel,
             {{"direct", start.convention == ActionConvention::kDirect},
              {"leg_sets", start.parameters}},
             out);
}

void EpisodeLogEncoder::Step(std::span<const double> action, const ShortDigest& observation,
                             const ShortDigest& state, std::string& out) {
  action_t& values = messages_->action;
  values.episode = episode_;
  values.step = step_;
  values.size = static_cast<int32_t>(action.size());
  values.values.assign(action.begin(), action.end());
  Append(kActionChannel, MicrosecondsOf(step_, period_), values, out);
  step_digest_t& digest = messages_->digest;
  digest.episode = episode_;
  digest.step = step_++;
  std::memcpy(digest.observation, observation.data(), observation.size());
  std::memcpy(digest.state, state.data(), state.size());
  Append(kLogDigestChannel, MicrosecondsOf(step_, period_), digest, out);
}

void EpisodeLogEncoder::Resume(int64_t number, int64_t step) {
  number_ = number;
  step_ = step;
}

void EpisodeLogEncoder::End(const LogEnd& end, const std::string& before, std::string& out) {
  AppendText(kLogEndChannel, EndToJson(end, before), out);
}

absl::StatusOr<std::optional<int64_t>> LogBytesLimit(std::string_view begin) {
  ASSIGN_OR_RETURN(const std::optional<size_t> size, EventBytes(begin));
  if (!size.has_value()) return std::nullopt;
  if (*size > kMaxTextBytes) {
    return absl::DataLossError("the file's first event is too long for the header of a log");
  }
  if (begin.size() < *size) return std::nullopt;
  EventLogReader reader(begin.substr(0, *size));
  ASSIGN_OR_RETURN(std::optional<LogEvent> event, reader.Next());
  if (event->channel != kLogHeaderChannel) {
    return absl::DataLossError("the file does not begin with the header of an episode's log");
  }
  absl::StatusOr<Json> json = TextOf(*event);
  if (!json.ok()) return absl::DataLossError(json.status().message());
  absl::StatusOr<LogHeader> header = HeaderFromJson(*json);
  if (!header.ok()) return absl::DataLossError(header.status().message());
  const absl::StatusOr<int64_t> steps = header->track.kind->max_steps(header->track.rules);
  if (!steps.ok()) return absl::DataLossError(steps.status().message());
  const auto texts = static_cast<int64_t>(*size + 2 * kMaxTextBytes);  // start and end
  // An action's fingerprint, episode, step, size and values; a digest's message.
  const size_t action = 28 + 8 * static_cast<size_t>(ActionOf(*header->track.kind).size());
  const auto digest = static_cast<size_t>(step_digest_t().getEncodedSize());
  const size_t step = 2 * kEventHeadBytes + kActionChannel.size() + action +
                      kLogDigestChannel.size() + digest;
  return texts + (*steps + 1) * static_cast<int64_t>(step);
}

absl::StatusOr<EpisodeLog> ParseEpisodeLog(std::string_view bytes) { return Parser(bytes).Parse(); }

}  // namespace myograde
