#include "sim/locomotion/rules.h"

#include <algorithm>
#include <array>
#include <tuple>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

constexpr std::array<const char*, 5> kKindNames = {"flat", "hilly", "rough", "stairs", "mixed"};

// Names of kinds, all different; a mixed course is made of obstacles only.
std::vector<CourseKind> ReadKinds(ConfigReader& reader, const char* key, bool obstacles_only) {
  std::vector<CourseKind> kinds;
  for (const std::string& name : reader.Strings(key)) {
    const auto found = std::find(kKindNames.begin(), kKindNames.end(), name);
    const auto kind = static_cast<CourseKind>(found - kKindNames.begin());
    const bool known = found != kKindNames.end();
    if (!known ||
        (obstacles_only && (kind == CourseKind::kFlat || kind == CourseKind::kMixed))) {
      reader.Fail(key, absl::StrCat("has \"", name.substr(0, 40), "\", must have only ",
                                    obstacles_only ? "" : "\"flat\", \"mixed\", ",
                                    "\"hilly\", \"rough\" and \"stairs\""));
      return {CourseKind::kRough};
    }
    if (std::find(kinds.begin(), kinds.end(), kind) != kinds.end()) {
      reader.Fail(key, absl::StrCat("has \"", name, "\" twice"));
    }
    kinds.push_back(kind);
  }
  if (kinds.empty()) reader.Fail(key, "must name at least one kind of course");
  return kinds;
}

// A [low, high] pair.
std::pair<double, double> ReadInterval(ConfigReader& reader, const char* key, NumberRange range) {
  const std::vector<double> ends = reader.Numbers(key, 2, range);
  if (ends.size() != 2) return {range.min, range.min};
  if (ends[0] > ends[1]) reader.Fail(key, "must be [low, high] with low <= high");
  return {ends[0], ends[1]};
}

absl::StatusOr<FieldRules> ReadField(const nlohmann::json& json, const std::string& where) {
  ConfigReader reader(json, where);
  FieldRules field;
  field.rows = static_cast<int>(reader.Integer("rows", 2, 600));
  field.columns = static_cast<int>(reader.Integer("columns", 2, 30));
  field.half_width_m = reader.Number("half_width_m", {0.5, 100});
  field.half_length_m = reader.Number("half_length_m", {10, 1000});
  field.ceiling_m = reader.Number("ceiling_m", {0.01, 100});
  field.offset_m = reader.Number("offset_m", {0, 1});
  RETURN_IF_ERROR(reader.Finish());
  return field;
}

void ReadPlacement(ConfigReader& reader, CourseRules& course) {
  if (reader.Choice("placement", {"by_row", "by_distance"}) == "by_distance") {
    course.placement = PatchPlacement::kByDistance;
    course.patch_m = reader.Number("patch_m", {1, 100});
  } else {
    course.placement = PatchPlacement::kByRow;
    course.patch_rows = static_cast<int>(reader.Integer("patch_rows", 6, 600));
  }
}

void ReadShapes(ConfigReader& reader, CourseRules& course) {
  course.roughness_m = reader.Number("roughness_m", {0, 10});
  course.hill_m = reader.Number("hill_m", {0, 10});
  course.step_m = reader.Number("step_m", {0, 10});
  if (reader.Choice("hill_shape", {"samples", "middle"}) == "middle") {
    course.hill_shape = HillShape::kMiddle;
    course.hill_length_m = reader.Number("hill_length_m", {0.1, 100});
    if (course.placement != PatchPlacement::kByDistance) {
      reader.Fail("hill_shape", "can be \"middle\" only with \"placement\": \"by_distance\"");
    } else if (course.hill_length_m > course.patch_m) {
      reader.Fail("hill_length_m", "must not be larger than patch_m");
    }
  }
  course.rough_random_scale = reader.Boolean("rough_random_scale");
  course.rough_stream = reader.Choice("rough_stream", {"episode", "legacy"}) == "legacy"
                            ? RoughStream::kLegacy
                            : RoughStream::kEpisode;
}

// Whether a hand that holds every kind of a mixed course often enough can be dealt.
void CheckHand(ConfigReader& reader, const CourseRules& course) {
  if (course.mixed_at_least == 0) return;
  const auto obstacles = std::ssize(course.difficulty) -
                         std::count(course.difficulty.begin(), course.difficulty.end(), 0);
  const auto held = course.mixed_at_least * std::ssize(course.mixed_kinds);
  if (held > obstacles) {
    reader.Fail("mixed_at_least", absl::StrCat("makes a hand of ", held, ", the course has only ",
                                               obstacles, " obstacles"));
  }
  if (course.draw_level_patches) {
    reader.Fail("mixed_at_least", "must be 0 where level patches are drawn, too");
  }
}

// The highest point that the course can have: stairs rise by three steps.
double HighestPoint(const CourseRules& course) {
  double hardest = 0;
  for (const double difficulty : course.difficulty) hardest = std::max(hardest, difficulty);
  return hardest * std::max({course.roughness_m, course.hill_m, 3 * course.step_m});
}

absl::StatusOr<CourseRules> ReadCourse(const nlohmann::json& json, const std::string& where,
                                       const FieldRules& field) {
  ConfigReader reader(json, where);
  CourseRules course;
  course.kinds = ReadKinds(reader, "kinds", false);
  course.mixed_kinds = ReadKinds(reader, "mixed_kinds", true);
  course.mixed_at_least = static_cast<int>(reader.Integer("mixed_at_least", 0, 600));
  ReadPlacement(reader, course);
  course.difficulty = reader.Numbers("difficulty", -1, {0, 10});
  course.draw_level_patches = reader.Boolean("draw_level_patches");
  ReadShapes(reader, course);
  if (course.difficulty.empty()) reader.Fail("difficulty", "must have an entry for each patch");
  if (course.difficulty.size() > 600) reader.Fail("difficulty", "has more than 600 entries");
  CheckHand(reader, course);
  if (course.placement == PatchPlacement::kByRow &&
      std::ssize(course.difficulty) * course.patch_rows > field.rows) {
    reader.Fail("difficulty", absl::StrCat("names ", course.difficulty.size(), " patches of ",
                                           course.patch_rows, " rows, the field has only ",
                                           field.rows, " rows"));
  }
  if (HighestPoint(course) > field.ceiling_m) {
    reader.Fail("difficulty", absl::StrCat("makes obstacles up to ", HighestPoint(course),
                                           " m high, field.ceiling_m is only ", field.ceiling_m));
  }
  RETURN_IF_ERROR(reader.Finish());
  return course;
}

absl::StatusOr<StartRules> ReadStart(const nlohmann::json& json, const std::string& where,
                                     const FieldRules& field) {
  ConfigReader reader(json, where);
  StartRules start;
  start.y_m = reader.Number("y_m", {-field.half_length_m, field.half_length_m});
  std::tie(start.x_low_m, start.x_high_m) =
      ReadInterval(reader, "x_m", {-field.half_width_m, field.half_width_m});
  std::tie(start.heading_low_deg, start.heading_high_deg) =
      ReadInterval(reader, "heading_deg", {-360, 360});
  start.clearance_m = reader.Number("clearance_m", {0, 1});
  RETURN_IF_ERROR(reader.Finish());
  return start;
}

absl::StatusOr<EndRules> ReadEnd(const nlohmann::json& json, const std::string& where,
                                 const FieldRules& field, const StartRules& start) {
  ConfigReader reader(json, where);
  EndRules end;
  const NumberRange along{-field.half_length_m, field.half_length_m};
  end.time_limit_s = reader.Number("time_limit_s", {0.005, 3600});
  end.finish_y_m = reader.Number("finish_y_m", along);
  end.distance_from_y_m = reader.Number("distance_from_y_m", along);
  end.half_width_m = reader.Number("half_width_m", {0.1, 100});
  end.behind_m = reader.Number("behind_m", {0.1, 1000});
  end.head_height_m = reader.Number("head_height_m", {0.1, 1.8});
  end.head_reference = reader.Choice("head_reference", {"ground", "world"}) == "ground"
                           ? HeadReference::kGround
                           : HeadReference::kWorld;
  end.head_above_feet_m = reader.Number("head_above_feet_m", {0.01, 1.8});
  end.fall_ends = reader.Boolean("fall_ends");
  end.lost_reports_time_limit = reader.Boolean("lost_reports_time_limit");
  if (end.finish_y_m >= start.y_m) {
    reader.Fail("finish_y_m", "must be below start.y_m: the person walks towards smaller y");
  }
  if (end.finish_y_m >= end.distance_from_y_m) {
    reader.Fail("distance_from_y_m", "must be above finish_y_m");
  }
  RETURN_IF_ERROR(reader.Finish());
  return end;
}

absl::StatusOr<LocomotionObservationRules> ReadObservation(const nlohmann::json& json,
                                                           const std::string& where) {
  ConfigReader reader(json, where);
  LocomotionObservationRules observation;
  observation.velocities_times_step = reader.Boolean("velocities_times_step");
  if (reader.Choice("height_map", {"heading", "official"}) == "official") {
    observation.height_map = HeightMapKind::kOfficial;
  } else {
    observation.height_map = HeightMapKind::kHeading;
    observation.height_map_pitch_m = reader.Number("height_map_pitch_m", {0.01, 10});
  }
  RETURN_IF_ERROR(reader.Finish());
  return observation;
}

// Keeps `value` in `out`, or its error in `status` if that has none yet.
template <typename T>
void Take(absl::StatusOr<T> value, T& out, absl::Status& status) {
  if (value.ok()) {
    out = *std::move(value);
  } else if (status.ok()) {
    status = value.status();
  }
}

}  // namespace

absl::StatusOr<LocomotionRules> ParseLocomotionRules(const nlohmann::json& rules,
                                                     const std::string& where) {
  ConfigReader reader(rules, where);
  LocomotionRules out;
  const auto part = [&](const char* key) { return absl::StrCat(where, ".", key); };
  const nlohmann::json& field = reader.Object("field");
  const nlohmann::json& course = reader.Object("course");
  const nlohmann::json& start = reader.Object("start");
  const nlohmann::json& end = reader.Object("end");
  const nlohmann::json& leg = reader.Object("leg");
  const nlohmann::json& observation = reader.Object("observation");
  out.clip_actions = reader.Boolean("clip_actions");
  out.warnings_reset_simulation = reader.Boolean("warnings_reset_simulation");
  out.pain_clip_nm = reader.Number("pain_clip_nm", {1, 1e6});
  // Finish() first: a missing part is told as such, not as its missing keys.
  absl::Status status = reader.Finish();
  if (!status.ok()) return status;
  Take(ReadField(field, part("field")), out.field, status);
  if (!status.ok()) return status;
  Take(ReadCourse(course, part("course"), out.field), out.course, status);
  Take(ReadStart(start, part("start"), out.field), out.start, status);
  if (!status.ok()) return status;
  Take(ReadEnd(end, part("end"), out.field, out.start), out.end, status);
  Take(ParseLegRules(leg, part("leg")), out.leg, status);
  Take(ReadObservation(observation, part("observation")), out.observation, status);
  if (!status.ok()) return status;
  return out;
}

}  // namespace myograde
