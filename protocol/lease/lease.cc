#include "protocol/lease/lease.h"

#include <algorithm>
#include <cfloat>
#include <utility>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

using Json = nlohmann::json;

constexpr size_t kMostJobDigits = 64;

// ConfigReader's integers are signed; seeds use all 64 bits.
uint64_t ReadUnsigned(ConfigReader& reader, const Json& json, const char* key) {
  reader.Ignore(key);
  if (json.is_object() && json.contains(key) && json[key].is_number_unsigned()) {
    return json[key].get<uint64_t>();
  }
  reader.Fail(key, "must be a whole number from 0 to 2^64 - 1");
  return 0;
}

absl::StatusOr<std::vector<EpisodeOrder>> ReadEpisodes(const Json& array,
                                                       const std::string& where) {
  std::vector<EpisodeOrder> episodes;
  for (const Json& entry : array) {
    ConfigReader reader(entry, absl::StrCat(where, ": episodes[", episodes.size(), "]"));
    EpisodeOrder episode;
    episode.index = reader.Integer("index", 0, INT64_MAX);
    episode.seed = ReadUnsigned(reader, entry, "seed");
    episode.policy_seed = ReadUnsigned(reader, entry, "policy_seed");
    if (!episodes.empty() && episode.index != episodes.back().index + 1) {
      reader.Fail("index", "must follow the index of the episode before it");
    }
    RETURN_IF_ERROR(reader.Finish());
    episodes.push_back(episode);
  }
  if (episodes.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": \"episodes\" is empty; a lease needs at least one"));
  }
  return episodes;
}

LeaseEndRecord ReadLeaseEnd(ConfigReader& reader) {
  LeaseEndRecord record;
  record.ok = reader.Boolean("ok");
  record.detail = reader.String("detail");
  record.stdout_tail = reader.String("stdout_tail");
  record.stderr_tail = reader.String("stderr_tail");
  record.stdout_truncated = reader.Boolean("stdout_truncated");
  record.stderr_truncated = reader.Boolean("stderr_truncated");
  record.policy_cpu_s = reader.Number("policy_cpu_s", {0, DBL_MAX});
  record.simulator_cpu_s = reader.Number("simulator_cpu_s", {0, DBL_MAX});
  record.wall_s = reader.Number("wall_s", {0, DBL_MAX});
  record.peak_memory_bytes = reader.Integer("peak_memory_bytes", 0, INT64_MAX);
  return record;
}

Json RecordToJson(const ProgressRecord& record) {
  return {{"type", "progress"}, {"episode", record.episode}, {"step", record.step}};
}

Json RecordToJson(const EpisodeFacts& facts) { return EpisodeRecordToJson(facts); }

ReplayRecord ReadReplay(ConfigReader& reader) {
  ReplayRecord record;
  record.episode = reader.Integer("episode", 0, INT64_MAX);
  record.equal = reader.Boolean("equal");
  record.steps = reader.Integer("steps", 0, INT64_MAX);
  record.step = reader.Integer("step", -1, INT64_MAX);
  record.differs = reader.Strings("differs");
  record.detail = reader.String("detail");
  return record;
}

Json RecordToJson(const ReplayRecord& record) {
  return {{"type", "replay"},     {"episode", record.episode}, {"equal", record.equal},
          {"steps", record.steps}, {"step", record.step},       {"differs", record.differs},
          {"detail", record.detail}};
}

Json RecordToJson(const LeaseEndRecord& record) {
  return {{"type", "lease_end"},
          {"ok", record.ok},
          {"detail", record.detail},
          {"stdout_tail", record.stdout_tail},
          {"stderr_tail", record.stderr_tail},
          {"stdout_truncated", record.stdout_truncated},
          {"stderr_truncated", record.stderr_truncated},
          {"policy_cpu_s", record.policy_cpu_s},
          {"simulator_cpu_s", record.simulator_cpu_s},
          {"wall_s", record.wall_s},
          {"peak_memory_bytes", record.peak_memory_bytes}};
}

Json RecordToJson(const NodeRecord& record) {
  Json json = {{"type", "node"}, {"node", record.node}, {"job", record.job}, {"cpu_s", record.cpu_s}};
  for (const auto& [key, text] : {std::pair("processor", &record.processor),
                                  std::pair("trouble", &record.trouble),
                                  std::pair("unfit", &record.unfit), std::pair("lost", &record.lost)}) {
    if (!text->empty()) json[key] = *text;
  }
  if (record.blamed) json["blamed"] = true;
  if (record.energy_j.has_value()) json["energy_j"] = *record.energy_j;
  return json;
}

NodeRecord ReadNode(ConfigReader& reader) {
  NodeRecord record;
  record.node = reader.String("node");
  record.job = reader.String("job");
  record.cpu_s = reader.Number("cpu_s", {0, DBL_MAX});
  for (const auto& [key, text] : {std::pair("processor", &record.processor),
                                  std::pair("trouble", &record.trouble),
                                  std::pair("unfit", &record.unfit), std::pair("lost", &record.lost)}) {
    if (reader.Has(key)) *text = reader.String(key);
  }
  if (reader.Has("blamed")) record.blamed = reader.Boolean("blamed");
  if (reader.Has("energy_j")) record.energy_j = reader.Number("energy_j", {0, DBL_MAX});
  if (!record.node.empty() && !IsNodeName(record.node)) reader.Fail("node", "is not a name of a node");
  if (record.job.size() > kMostJobDigits ||
      record.job.find_first_not_of("0123456789_") != std::string::npos) {
    reader.Fail("job", "is not a number of a job");
  }
  return record;
}

}  // namespace

bool IsNodeName(std::string_view name) {
  return !name.empty() && name.size() <= 255 && name != "." && name != ".." &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_';
         });
}

nlohmann::json LeaseOrderToJson(const LeaseOrder& order) {
  Json episodes = Json::array();
  for (const EpisodeOrder& episode : order.episodes) {
    episodes.push_back({{"index", episode.index},
                        {"seed", episode.seed},
                        {"policy_seed", episode.policy_seed}});
  }
  Json json = {{"lease", order.lease},
          {"artefact_dir", order.artefact_dir},
          {"command", order.command},
          {"environment", order.environment},
          {"runtimes", order.runtimes},
          {"extra_observations", order.extra_observations},
          {"track", order.track.effective},
          {"episodes", std::move(episodes)},
          {"uid", order.uid},
          {"slot", order.slot},
          {"slot_mark", order.slot_mark},
          {"pinned", order.pinned},
          {"work_dir", order.work_dir},
          {"cache_dir", order.cache_dir},
          {"log_dir", order.log_dir},
          {"log_bytes", order.log_bytes},
          {"replay", order.replay},
          {"adapter", order.adapter},
          {"trajectory", order.trajectory},
          {"background", order.background}};
  if (order.image.has_value()) json["image"] = PolicyImageToJson(*order.image);
  return json;
}

absl::StatusOr<LeaseOrder> LeaseOrderFromJson(const nlohmann::json& json,
                                              const std::string& where) {
  ConfigReader reader(json, where);
  LeaseOrder order;
  order.lease = reader.String("lease");
  order.artefact_dir = reader.String("artefact_dir");
  order.command = reader.Strings("command");
  order.environment = reader.StringsByName("environment");
  order.runtimes = reader.Strings("runtimes");
  order.adapter = reader.String("adapter");
  order.extra_observations = reader.Boolean("extra_observations");
  if (reader.Has("image")) {
    ASSIGN_OR_RETURN(order.image,
                     PolicyImageFromJson(reader.Object("image"), absl::StrCat(where, ": image")));
  }
  const Json& track = reader.Object("track");
  const Json& episodes = reader.Array("episodes");
  order.uid = reader.Integer("uid", -1, INT32_MAX);
  order.slot = reader.Integer("slot", 0, INT32_MAX);
  order.slot_mark = reader.String("slot_mark");
  order.pinned = reader.Boolean("pinned");
  order.work_dir = reader.String("work_dir");
  order.cache_dir = reader.String("cache_dir");
  order.log_dir = reader.String("log_dir");
  order.log_bytes = reader.Integer("log_bytes", 0, INT64_MAX);
  order.replay = reader.Strings("replay");
  order.trajectory = reader.String("trajectory");
  order.background = reader.Boolean("background");
  if (!order.replay.empty() && order.replay.size() != episodes.size()) {
    reader.Fail("replay", "must name one log for each episode");
  }
  if (!order.trajectory.empty() && order.replay.empty()) {
    reader.Fail("trajectory", "is made of a log, and \"replay\" names none");
  }
  if (order.command.empty() && order.replay.empty()) {
    reader.Fail("command", "is empty; it must name the policy's program");
  }
  RETURN_IF_ERROR(reader.Finish());
  ASSIGN_OR_RETURN(order.track, ParseTrackConfig(track, absl::StrCat(where, ": track")));
  ASSIGN_OR_RETURN(order.episodes, ReadEpisodes(episodes, where));
  return order;
}

std::string LeaseRecordToLine(const LeaseRecord& record) {
  return CanonicalJson(std::visit([](const auto& body) { return RecordToJson(body); }, record));
}

absl::StatusOr<LeaseRecord> LeaseRecordFromLine(std::string_view line) {
  ASSIGN_OR_RETURN(const Json json, ParseJson(line, "lease record"));
  return LeaseRecordFromJson(json);
}

absl::StatusOr<LeaseRecord> LeaseRecordFromJson(const Json& json) {
  ConfigReader reader(json, "lease record");
  const std::string type = reader.Choice("type", {"progress", "episode", "replay", "lease_end", "node"});
  if (!json.is_object()) return reader.Finish();
  if (type == "episode") {
    ASSIGN_OR_RETURN(EpisodeFacts facts, EpisodeFactsFromJson(json));
    return LeaseRecord(std::move(facts));
  }
  LeaseRecord record;
  if (type == "progress") {
    ProgressRecord progress;
    progress.episode = reader.Integer("episode", 0, INT64_MAX);
    progress.step = reader.Integer("step", 0, INT64_MAX);
    record = progress;
  } else if (type == "replay") {
    record = ReadReplay(reader);
  } else if (type == "node") {
    record = ReadNode(reader);
  } else {
    record = ReadLeaseEnd(reader);
  }
  RETURN_IF_ERROR(reader.Finish());
  return record;
}

}  // namespace myograde
