// The hand that several models share: its joints and muscles from the forearm on, in the order of
// the models' positions and of the official actuators.
#pragma once

#include <array>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/policy/layout.h"

namespace myograde {

// With their ranges in rad.
inline constexpr LayoutEntry kHandJoints[] = {
    {"pro_sup", {-1.5708, 1.5708}},       {"deviation", {-0.174533, 0.436332}},
    {"flexion", {-0.785398, 0.785398}},   {"cmc_abduction", {-0.5, 0.78}},
    {"cmc_flexion", {-0.78, 0.7}},        {"mp_flexion", {-0.785398, 0.698132}},
    {"ip_flexion", {-1.309, 0.436332}},   {"mcp2_flexion", {0, 1.5708}},
    {"mcp2_abduction", {-0.261799, 0.261799}}, {"pm2_flexion", {0, 1.5708}},
    {"md2_flexion", {0, 1.5708}},         {"mcp3_flexion", {0, 1.5708}},
    {"mcp3_abduction", {-0.261799, 0.261799}}, {"pm3_flexion", {0, 1.5708}},
    {"md3_flexion", {0, 1.5708}},         {"mcp4_flexion", {0, 1.5708}},
    {"mcp4_abduction", {-0.261799, 0.261799}}, {"pm4_flexion", {0, 1.5708}},
    {"md4_flexion", {0, 1.5708}},         {"mcp5_flexion", {0, 1.5708}},
    {"mcp5_abduction", {-0.261799, 0.261799}}, {"pm5_flexion", {0, 1.5708}},
    {"md5_flexion", {0, 1.5708}},
};

template <size_t n>
constexpr std::array<std::string_view, n> NamesOf(const std::array<LayoutEntry, n>& entries) {
  std::array<std::string_view, n> names;
  for (size_t i = 0; i < n; ++i) names[i] = entries[i].name;
  return names;
}
inline constexpr auto kHandJointNames = NamesOf(std::to_array(kHandJoints));

inline constexpr std::string_view kHandMuscles[] = {
    "ECRL", "ECRB", "ECU",    "FCR",    "FCU", "PL",     "PT",     "PQ",  "FDS5",   "FDS4",
    "FDS3", "FDS2", "FDP5",   "FDP4",   "FDP3", "FDP2",  "EDC5",   "EDC4", "EDC3",  "EDC2",
    "EDM",  "EIP",  "EPL",    "EPB",    "FPL", "APL",    "OP",     "RI2", "LU_RB2", "UI_UB2",
    "RI3",  "LU_RB3", "UI_UB3", "RI4",  "LU_RB4", "UI_UB4", "RI5", "LU_RB5", "UI_UB5",
};

// The one and then the other.
template <typename T, size_t n, size_t m>
constexpr std::array<T, n + m> Joined(const T (&first)[n], const T (&second)[m]) {
  std::array<T, n + m> joined = {};
  for (size_t i = 0; i < n + m; ++i) joined[i] = i < n ? first[i] : second[i - n];
  return joined;
}

inline std::vector<LayoutEntry> AllOf(std::span<const LayoutEntry> entries) {
  return {entries.begin(), entries.end()};
}

// The same entries with other bounds: a position part's joints in the velocity part.
inline std::vector<LayoutEntry> EntriesWith(std::span<const LayoutEntry> entries, Bounds bounds) {
  std::vector<LayoutEntry> result = AllOf(entries);
  for (LayoutEntry& entry : result) entry.bounds = bounds;
  return result;
}

// The part of an action that excites muscles.
inline VectorLayout MuscleActions(std::span<const std::string_view> muscles) {
  VectorLayout v;
  v.Add("muscles", "1",
        "Excitation of each muscle. Normalized: a in [-1, 1] excites by 1/(1 + exp(-5(a - 0.5))); "
        "direct: the excitation itself, in [0, 1].",
        LayoutEntries(muscles, {-1, 1}));
  return v;
}

// The layout of a track whose actions are those muscles.
inline TrackLayout MuscleLayout(std::span<const std::string_view> muscles,
                                VectorLayout observation, VectorLayout extra) {
  return {.observation = std::move(observation),
          .extra = std::move(extra),
          .action = MuscleActions(muscles),
          .direct_bounds = std::vector<Bounds>(muscles.size(), {0, 1})};
}

}  // namespace myograde
