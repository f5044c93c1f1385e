// Writes the trajectory file of an episode that is played again (README.md).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <mujoco/mujoco.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/sim_channel.h"
#include "sim/environment.h"
#include "sim/episode/episode_recorder.h"
#include "sim/trajectory/arrays.h"
#include "sim/trajectory/figure.h"
#include "sim/trajectory/telemetry.h"

namespace myograde::sim {

inline constexpr double kFramePeriod = 0.02;         // s
inline constexpr int64_t kMostFrames = 20'000;       // of a file; longer episodes have fewer a second
inline constexpr int kMostContacts = 12;             // of a frame
inline constexpr size_t kMostEvents = 1'000;         // of a file, besides the last ones
inline constexpr size_t kMostTrajectoryBytes = kMostTrajectoryFileBytes;
inline constexpr char kTrajectoryMagic[] = "MYOTRAJ1";

// The episode that is recorded.
struct RecordedEpisode {
  std::string track;             // as in the trajectory's head
  std::string model;             // ModelFileKey
  int64_t episode = 0;
  int64_t steps = 0;             // that will be played
  double control_period_s = 0;
  std::string end;               // how it ended
};

class TrajectoryRecorder final : public EpisodeRecorder {
 public:
  // `environment` must outlive the recorder. Errors: as BuildFigure.
  static absl::StatusOr<std::unique_ptr<TrajectoryRecorder>> Make(
      const Environment& environment, std::unique_ptr<Telemetry> telemetry,
      const RecordedEpisode& episode);

  void Begin() override;
  void AfterStep() override;
  absl::StatusOr<std::string> Finish() override;

 private:
  TrajectoryRecorder(const Environment& environment, std::unique_ptr<Telemetry> telemetry,
                     const RecordedEpisode& episode, Figure figure);

  void Capture(const mjData& data);
  void CaptureParts(const mjData& data);
  void CapturePose(const mjtNum position[3], const mjtNum rotation[4]);
  void CaptureMuscles(const mjData& data);
  void CaptureContacts(const mjData& data);
  double Now() const;
  nlohmann::json Head(const ArrayBlock& arrays) const;
  nlohmann::json PartsToJson() const;
  nlohmann::json EventsToJson() const;
  nlohmann::json SeriesToJson() const;
  void AddPoses(ArrayBlock& arrays) const;
  void AddContacts(ArrayBlock& arrays) const;
  void AddSeries(ArrayBlock& arrays) const;
  nlohmann::json AddTerrain(ArrayBlock& arrays) const;

  const Environment& environment_;
  const std::unique_ptr<Telemetry> telemetry_;
  const RecordedEpisode episode_;
  const Figure figure_;
  const int64_t steps_per_frame_;

  int64_t steps_ = 0;   // played
  int64_t frames_ = 0;  // captured
  int64_t captured_at_ = -1;  // the step of the last frame
  // Frame after frame; of contacts, contact after contact.
  std::vector<float> positions_;
  std::vector<float> rotations_;
  std::vector<float> activations_;
  std::vector<float> wraps_;
  std::vector<float> contact_counts_;
  std::vector<float> contacts_;
  std::vector<float> contact_bodies_;
  std::vector<float> series_;
  std::vector<double> sample_;
  std::vector<TrajectoryEvent> events_;
  std::vector<TargetPose> targets_;  // of the last frame
};

}  // namespace myograde::sim
