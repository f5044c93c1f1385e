// Facts and evidence as JSON. Each struct has one list of its fields that both
// directions walk, so writing and reading cannot drift apart.
#include <cfloat>
#include <string>
#include <string_view>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/config_reader.h"
#include "protocol/lease.h"
#include "protocol/sim_channel.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

template <typename Facts, typename Visitor>
void VisitManipulation(Facts& facts, Visitor&& visit) {
  visit("frames", facts.frames);
  visit("frames_arm", facts.frames_arm);
  visit("frames_prosthesis", facts.frames_prosthesis);
  visit("frames_start", facts.frames_start);
  visit("frames_goal", facts.frames_goal);
  visit("frames_other", facts.frames_other);
  visit("goal_only_at_end", facts.goal_only_at_end);
  visit("placed", facts.placed);
  visit("solved", facts.solved);
  visit("solved_steps", facts.solved_steps);
  visit("peak_force", facts.peak_force);
  visit("max_touch", facts.max_touch);
  visit("goal_distance_sum", facts.goal_distance_sum);
  visit("final_goal_distance", facts.final_goal_distance);
  visit("final_hand_distance", facts.final_hand_distance);
  visit("max_height", facts.max_height);
  visit("effort_sum", facts.effort_sum);
  visit("reported_time", facts.reported_time);
}

template <typename Facts, typename Visitor>
void VisitLocomotion(Facts& facts, Visitor&& visit) {
  visit("course", facts.course);
  visit("distance", facts.distance);
  visit("start_y", facts.start_y);
  visit("min_y", facts.min_y);
  visit("final_y", facts.final_y);
  visit("effort_sum", facts.effort_sum);
  visit("pain_sum", facts.pain_sum);
  visit("solved", facts.solved);
  visit("reported_time", facts.reported_time);
}

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

// A mistake in a nested object becomes a mistake of the record.
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

absl::Status ReadTrack(ConfigReader& reader, const Json& json, EpisodeFacts& facts) {
  const std::string track = reader.Choice("track", {"manipulation", "locomotion"});
  // Both the shape of `json` and the choice must hold before a part is read.
  if (!json.is_object() || !json.contains(track)) {
    reader.Fail(track, "is missing");
    return absl::OkStatus();
  }
  ConfigReader part(reader.Object(track), track);
  if (track == "manipulation") {
    VisitManipulation(facts.track.emplace<ManipulationFacts>(), Reader{part});
  } else {
    VisitLocomotion(facts.track.emplace<LocomotionFacts>(), Reader{part});
  }
  return part.Finish();
}

template <typename Info, typename Visitor>
void VisitLog(Info& info, Visitor&& visit) {
  visit("sha256", info.sha256);
  visit("bytes", info.bytes);
  visit("packed_bytes", info.packed_bytes);
  visit("steps", info.steps);
}

// Facts that older records have not.
absl::Status ReadOptional(ConfigReader& reader, const Json& json, EpisodeFacts& facts) {
  if (!json.is_object()) return absl::OkStatus();
  if (reader.Has("actions_digest")) facts.actions_digest = reader.String("actions_digest");
  if (!reader.Has("log")) return absl::OkStatus();
  ConfigReader log(reader.Object("log"), "log");
  VisitLog(facts.log, Reader{log});
  return log.Finish();
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
  // Older records have none.
  if (reader.Has("stderr_tail")) evidence.stderr_tail = reader.String("stderr_tail");
  if (absl::Status status = reader.Finish(); !status.ok()) return status;
  evidence.outcome = *outcome;
  return evidence;
}

nlohmann::json EpisodeFactsToJson(const EpisodeFacts& facts) {
  Json json = {{"seed", facts.seed}, {"end", EpisodeEndName(facts.end)}};
  VisitCommon(facts, Writer{json});
  if (facts.end == EpisodeEnd::kFault) json["fault"] = FaultEvidenceToJson(facts.fault);
  if (!facts.actions_digest.empty()) json["actions_digest"] = facts.actions_digest;
  if (!facts.log.sha256.empty()) VisitLog(facts.log, Writer{json["log"]});
  Json part = Json::object();
  if (const auto* manipulation = std::get_if<ManipulationFacts>(&facts.track)) {
    VisitManipulation(*manipulation, Writer{part});
    json["track"] = "manipulation";
    json["manipulation"] = std::move(part);
  } else {
    VisitLocomotion(std::get<LocomotionFacts>(facts.track), Writer{part});
    json["track"] = "locomotion";
    json["locomotion"] = std::move(part);
  }
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
  if (absl::Status status = Join(reader.Finish(), nested); !status.ok()) return status;
  facts.end = *end;
  return facts;
}

}  // namespace myograde
