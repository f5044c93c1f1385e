// Facts and evidence as JSON. Each struct has one list of its fields that both directions use, so
// writing and reading cannot drift apart.
#include <cfloat>
#include <string>
#include <string_view>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/lease.h"
#include "protocol/lease/sim_channel.h"
#include "protocol/tracks/registry.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

template <typename Facts, typename Visitor>
void VisitCommon(Facts& facts, Visitor&& visit) {
  visit("index", facts.index);
  visit("steps", facts.steps);
  visit("sim_time", facts.sim_time);
  visit("clipped", facts.clipped);
  visit("digest", facts.digest);
  visit("wall_s", facts.wall_s);
  visit("policy_cpu_s", facts.policy_cpu_s);
}

template <typename Evidence, typename Visitor>
void VisitEvidence(Evidence& evidence, Visitor&& visit) {
  visit("limit", evidence.limit);
  visit("limit_value", evidence.limit_value);
  visit("value", evidence.value);
  visit("step", evidence.step);
  visit("detail", evidence.detail);
}

struct Writer {
  Json& json;
  template <typename T>
  void operator()(const char* key, const T& value) const {
    json[key] = value;
  }
};

struct Reader {
  ConfigReader& reader;
  void operator()(const char* key, int64_t& value) const {
    value = reader.Integer(key, INT64_MIN, INT64_MAX);
  }
  void operator()(const char* key, int& value) const {
    value = static_cast<int>(reader.Integer(key, INT32_MIN, INT32_MAX));
  }
  void operator()(const char* key, double& value) const {
    value = reader.Number(key, {-DBL_MAX, DBL_MAX});
  }
  void operator()(const char* key, bool& value) const { value = reader.Boolean(key); }
  void operator()(const char* key, std::string& value) const { value = reader.String(key); }
};

// Turns a mistake in a nested object into one of the record.
absl::Status Join(const absl::Status& first, const absl::Status& second) {
  return first.ok() ? second : first;
}

uint64_t ReadSeed(ConfigReader& reader, const Json& json) {
  reader.Ignore("seed");
  const auto it = json.is_object() ? json.find("seed") : json.end();
  if (!json.is_object() || it == json.end() || !it->is_number_unsigned()) {
    reader.Fail("seed", "must be a whole number from 0 to 2^64 - 1");
    return 0;
  }
  return it->get<uint64_t>();
}

// The facts of the variant's alternative for the track of this name.
template <typename... Facts>
absl::Status ReadFactsOf(const std::string& track, const Json& json,
                         std::variant<Facts...>& facts) {
  absl::Status status;
  const auto read = [&]<typename One>(One one) {
    if (track != One::kTrack) return;
    ConfigReader part(json, track);
    One::Visit(one, Reader{part});
    facts = one;
    status = part.Finish();
  };
  (read(Facts()), ...);
  return status;
}

absl::Status ReadTrack(ConfigReader& reader, const Json& json, EpisodeFacts& facts) {
  const std::string track = reader.Choice("track", TrackNames());
  // Check both the shape of `json` and the choice before reading a part.
  if (!json.is_object() || !json.contains(track)) {
    reader.Fail(track, "is missing");
    return absl::OkStatus();
  }
  return ReadFactsOf(track, reader.Object(track), facts.track);
}

template <typename Info, typename Visitor>
void VisitLog(Info& info, Visitor&& visit) {
  visit("sha256", info.sha256);
  visit("bytes", info.bytes);
  visit("packed_bytes", info.packed_bytes);
  visit("steps", info.steps);
}

// Facts that older records lack.
absl::Status ReadOptional(ConfigReader& reader, const Json& json, EpisodeFacts& facts) {
  if (!json.is_object()) return absl::OkStatus();
  if (reader.Has("actions_digest")) facts.actions_digest = reader.String("actions_digest");
  absl::Status nested;
  if (reader.Has("details")) {
    const absl::StatusOr<TrackDetails> details =
        DetailsFromJson(facts.track, reader.Object("details"));
    if (details.ok()) facts.details = *details;
    nested = details.status();
  }
  if (!reader.Has("log")) return nested;
  ConfigReader log(reader.Object("log"), "log");
  VisitLog(facts.log, Reader{log});
  return Join(nested, log.Finish());
}

}  // namespace

nlohmann::json FaultEvidenceToJson(const FaultEvidence& evidence) {
  Json json = {{"outcome", OutcomeName(evidence.outcome)},
               {"whose", FaultName(FaultOf(evidence.outcome))},
               {"stderr_tail", evidence.stderr_tail}};
  VisitEvidence(evidence, Writer{json});
  return json;
}

absl::StatusOr<FaultEvidence> FaultEvidenceFromJson(const nlohmann::json& json) {
  FaultEvidence evidence;
  ConfigReader reader(json, "fault evidence");
  reader.Ignore("type");  // evidence travels as the body of typed messages
  const auto outcome = ParseOutcome(reader.String("outcome"));
  if (!outcome.has_value()) reader.Fail("outcome", "is not the name of an outcome");
  VisitEvidence(evidence, Reader{reader});
  reader.Ignore("whose");  // follows from the outcome
  // Absent in older records.
  if (reader.Has("stderr_tail")) evidence.stderr_tail = reader.String("stderr_tail");
  RETURN_IF_ERROR(reader.Finish());
  evidence.outcome = *outcome;
  return evidence;
}

nlohmann::json EpisodeFactsToJson(const EpisodeFacts& facts) {
  Json json = {{"seed", facts.seed}, {"end", facts.end.name()}};
  VisitCommon(facts, Writer{json});
  if (facts.end == EpisodeEnd::kFault) json["fault"] = FaultEvidenceToJson(facts.fault);
  if (!facts.actions_digest.empty()) json["actions_digest"] = facts.actions_digest;
  if (!facts.log.sha256.empty()) VisitLog(facts.log, Writer{json["log"]});
  std::visit(
      [&](const auto& measured) {
        Json part = Json::object();
        measured.Visit(measured, Writer{part});
        json["track"] = measured.kTrack;
        json[std::string(measured.kTrack)] = std::move(part);
      },
      facts.track);
  return json;
}

nlohmann::json EpisodeRecordToJson(const EpisodeFacts& facts) {
  Json json = EpisodeFactsToJson(facts);
  json["type"] = "episode";
  if (facts.details.has_value()) json["details"] = DetailsToJson(*facts.details);
  return json;
}

absl::StatusOr<EpisodeFacts> EpisodeFactsFromJson(const nlohmann::json& json) {
  EpisodeFacts facts;
  ConfigReader reader(json, "episode facts");
  reader.Ignore("type");  // facts travel as the body of episode records
  facts.seed = ReadSeed(reader, json);
  const auto end = ParseEpisodeEnd(reader.String("end"));
  if (!end.has_value()) reader.Fail("end", "is not the name of an episode's end");
  VisitCommon(facts, Reader{reader});
  absl::Status nested;
  if (end == EpisodeEnd::kFault) {
    const auto fault = FaultEvidenceFromJson(reader.Object("fault"));
    nested = fault.status();
    if (fault.ok()) facts.fault = *fault;
  }
  nested = Join(nested, ReadTrack(reader, json, facts));
  nested = Join(nested, ReadOptional(reader, json, facts));
  RETURN_IF_ERROR(Join(reader.Finish(), nested));
  facts.end = *end;
  return facts;
}

}  // namespace myograde
