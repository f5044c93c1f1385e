// The rules of the locomotion track as numbers and named switches: what a
// track config's "rules" object says. One implementation in sim/ reads them;
// the profiles `paper` and `myosuite` are two sets of values. Every key of the
// JSON object is a member here, in the same nesting and with the same name.
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "sim/locomotion/rules_leg.h"

namespace myograde {

// The kinds of course; the values are the codes that the observation shows.
enum class CourseKind { kFlat = 0, kHilly = 1, kRough = 2, kStairs = 3, kMixed = 4 };

// The grid of heights that the course is laid on, centred at the origin: rows
// along y, columns along x.
struct FieldRules {
  int rows = 0;               // 2 to 600
  int columns = 0;            // 2 to 30
  double half_width_m = 0;    // x reaches from -half_width_m to half_width_m
  double half_length_m = 0;   // the same for y
  double ceiling_m = 0;       // nothing on the field is higher; contacts are looked for below it
  double offset_m = 0;        // of the field's zero above the ground plane
};

// How a patch finds its rows. By row: patch i has rows [i, i + 1) * patch_rows,
// counted from the far end (smallest y). By distance: patch i has the rows
// whose distance from the start line is in (i * patch_m, (i + 1) * patch_m].
enum class PatchPlacement { kByRow, kByDistance };

// What a hill is. Samples: half a sine over all samples of the patch in
// row-major order, from the far end (the official code). Middle: half a sine
// of hill_length_m over the true distance, in the middle of the patch.
enum class HillShape { kSamples, kMiddle };

// Where the random heights of rough patches come from: the episode's generator
// or NumPy's legacy global one, which is seeded with the episode's seed here.
enum class RoughStream { kEpisode, kLegacy };

struct CourseRules {
  std::vector<CourseKind> kinds;        // one is drawn uniformly; a single one costs no draw
  std::vector<CourseKind> mixed_kinds;  // what the patches of a mixed course are
  // A mixed course's obstacles are dealt from a shuffled hand that holds each of mixed_kinds at
  // least so many times; 0: each patch is drawn by itself, uniformly.
  int mixed_at_least = 0;
  PatchPlacement placement = PatchPlacement::kByRow;
  int patch_rows = 0;                   // with kByRow
  double patch_m = 0;                   // with kByDistance
  std::vector<double> difficulty;       // of each patch, in placement's order; 0: level
  bool draw_level_patches = false;      // level patches use up random draws as others do
  double roughness_m = 0;               // height range of a rough patch of difficulty 1
  double hill_m = 0;                    // height of a hill of difficulty 1
  double step_m = 0;                    // height of a step of difficulty 1
  HillShape hill_shape = HillShape::kSamples;
  double hill_length_m = 0;             // with HillShape::kMiddle
  bool rough_random_scale = false;      // the range is drawn from 0 to the patch's roughness
  RoughStream rough_stream = RoughStream::kEpisode;
};

struct StartRules {
  double y_m = 0;            // where the person starts
  double x_low_m = 0;        // place across the course, drawn uniformly
  double x_high_m = 0;
  double heading_low_deg = 0;   // drawn uniformly; -90 looks down the course (towards -y)
  double heading_high_deg = 0;
  double clearance_m = 0;    // of the lowest foot marker above the ground plane
};

enum class HeadReference { kWorld, kGround };

struct EndRules {
  double time_limit_s = 0;
  double finish_y_m = 0;         // the episode is solved below it
  double distance_from_y_m = 0;  // where distance 0 is; distance 100 is at finish_y_m
  double half_width_m = 0;       // farther than this from the middle line: off track
  double behind_m = 0;           // farther than this behind the start: off track
  double head_height_m = 0;      // the head marker below it: fallen
  HeadReference head_reference = HeadReference::kWorld;
  double head_above_feet_m = 0;  // the head marker less than this above the feet: fallen
  bool fall_ends = true;         // off (for measuring speed): the fallen person stays in play
  bool lost_reports_time_limit = false;  // time of a lost episode is given as time_limit_s
};

// Official: 0.5 m pitch, ahead and left of centre, the official code's scale of
// columns, raw heights of the field. Heading: cell centres `height_map_pitch_m`
// apart around the pelvis, relative to the ground under it.
enum class HeightMapKind { kOfficial, kHeading };

struct LocomotionObservationRules {
  bool velocities_times_step = false;  // joint velocities are multiplied by 0.005 s
  HeightMapKind height_map = HeightMapKind::kHeading;
  double height_map_pitch_m = 0;       // with HeightMapKind::kHeading
};

struct LocomotionRules {
  FieldRules field;
  CourseRules course;
  StartRules start;
  EndRules end;
  LegRules leg;
  LocomotionObservationRules observation;
  bool clip_actions = false;   // entries outside their bounds are clipped and counted
  // A warning of MuJoCo puts the body back to the model's default pose and the
  // episode goes on; off: the episode ends as unstable.
  bool warnings_reset_simulation = false;
  double pain_clip_nm = 0;     // limit torque of a joint counts up to this much
};

// Parses and checks the "rules" object of a locomotion track config. The first
// mistake is told with its place; unknown keys are mistakes.
absl::StatusOr<LocomotionRules> ParseLocomotionRules(const nlohmann::json& rules,
                                                     const std::string& where);

}  // namespace myograde
