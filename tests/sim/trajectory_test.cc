// Trajectories and model files of each track.
#include "sim/trajectory/recorder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/lease/track_config.h"
#include "sim/model/model.h"
#include "sim/tracks.h"
#include "sim/trajectory/mesh.h"
#include "sim/trajectory/model_file.h"
#include "tests/sim/golden.h"
#include "tests/sim/trajectory_reader.h"

namespace myograde::sim {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using Json = nlohmann::json;

constexpr int64_t kStepsPlayed = 61;  // no multiple of a frame's
constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();

// A body at a moment.
struct Pose {
  std::array<double, 3> position;
  std::array<double, 4> rotation;
};

class Trajectories : public testing::TestWithParam<const SimulatedTrack*> {
 protected:
  // Most tests look at one recording and at the environment as it was left: each track plays once.
  void SetUp() override {
    Played& played = played_[&track()];
    if (played.environment == nullptr) {
      played.environment = Make();
      environment_ = played.environment.get();
      ASSERT_NE(environment_, nullptr);
      played.file = PlayEpisode();
    }
    environment_ = played.environment.get();
    file_ = played.file;
  }

  std::unique_ptr<Environment> Make() {
    const auto config = OfficialConfig(track());
    EXPECT_TRUE(config.ok()) << config.status();
    if (!config.ok()) return nullptr;
    auto environment = MakeEnvironment(*config, CacheDir());
    EXPECT_TRUE(environment.ok()) << environment.status();
    return environment.ok() ? *std::move(environment) : nullptr;
  }

  const SimulatedTrack& track() const { return *GetParam(); }
  const mjModel& model() const { return environment_->model(); }
  const mjData& data() const { return environment_->data(); }

  std::unique_ptr<TrajectoryRecorder> Recorder(int64_t steps = kStepsPlayed) {
    auto recorder = TrajectoryRecorder::Make(
        *environment_, track().telemetry(*environment_),
        {.track = std::string(track().kind->name), .model = "0123456789abcdef", .episode = 3,
         .steps = steps, .control_period_s = track().kind->control_period_s, .end = "given-up"});
    EXPECT_TRUE(recorder.ok()) << recorder.status();
    return *std::move(recorder);
  }

  // Plays with actions that differ from step to step, and keeps what was seen after each.
  std::string PlayEpisode() {
    environment_->Reset(11);
    const std::unique_ptr<TrajectoryRecorder> recorder = Recorder();
    recorder->Begin();
    std::vector<double> action(static_cast<size_t>(environment_->action_size()));
    for (int64_t step = 0; step < kStepsPlayed; ++step) {
      for (size_t i = 0; i < action.size(); ++i) {
        action[i] = std::sin(0.1 * static_cast<double>(step) + static_cast<double>(i));
      }
      environment_->Step(action);
      recorder->AfterStep();
    }
    const absl::StatusOr<std::string> file = recorder->Finish();
    EXPECT_TRUE(file.ok()) << file.status();
    return file.ok() ? *file : "";
  }

  ReadTrajectory Read(const std::string& file) {
    const absl::StatusOr<ReadTrajectory> read = ParseTrajectory(file);
    EXPECT_TRUE(read.ok()) << read.status();
    return read.ok() ? *read : ReadTrajectory();
  }

  // The last pose of each body in a file.
  static std::map<std::string, Pose> LastPoses(const ReadTrajectory& read) {
    std::vector<Pose> poses;
    std::map<std::string, Pose> named;
    for (const Json& body : read.head["bodies"]) {
      Pose pose = {};
      for (size_t axis = 0; axis < 3; ++axis) {
        pose.position[axis] = read.Values("position", 3 * poses.size() + axis).back();
        if (body.contains("from")) {
          pose.position[axis] += poses.at(body["from"].get<size_t>()).position[axis];
        }
      }
      for (size_t i = 0; i < 4; ++i) {
        pose.rotation[i] = read.Values("rotation", 4 * poses.size() + i).back();
      }
      poses.push_back(pose);
      const std::string name = body["name"].get<std::string>();
      named[body.contains("target") ? absl::StrCat("target of ", name) : name] = pose;
    }
    return named;
  }

  Environment* environment_ = nullptr;
  std::string file_;

 private:
  struct Played {
    std::unique_ptr<Environment> environment;
    std::string file;
  };
  static inline std::map<const SimulatedTrack*, Played> played_;
};

TEST_P(Trajectories, HaveTheBodiesWhereTheyAre) {
  const ReadTrajectory read = Read(file_);
  const std::map<std::string, Pose> poses = LastPoses(read);
  ASSERT_FALSE(poses.empty());
  for (const auto& [name, pose] : poses) {
    if (absl::StartsWith(name, "target of ")) continue;
    const int body = mj_name2id(&model(), mjOBJ_BODY, name.c_str());
    ASSERT_GE(body, 0) << name;
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(pose.position[axis], data().xpos[3 * body + axis], 1e-4) << name;
    }
    double same = 0;
    for (int i = 0; i < 4; ++i) same += pose.rotation[i] * data().xquat[4 * body + i];
    EXPECT_NEAR(std::abs(same), 1, 1e-4) << name;
  }
  // Nothing that moves on its own is missing.
  for (int joint = 0; joint < model().njnt; ++joint) {
    const char* name = mj_id2name(&model(), mjOBJ_BODY, model().jnt_bodyid[joint]);
    EXPECT_TRUE(poses.contains(name)) << name;
  }
}

TEST_P(Trajectories, HaveFramesAndCurvesAtTheirRate) {
  const ReadTrajectory read = Read(file_);
  const double period = track().kind->control_period_s;
  EXPECT_DOUBLE_EQ(read.head["duration_s"], std::round(kStepsPlayed * period * 1e6) / 1e6);
  const double frame = period > 0.02 ? period : 0.02;
  EXPECT_DOUBLE_EQ(read.head["period_s"], frame);
  const auto frames = static_cast<size_t>(std::ceil(kStepsPlayed * period / frame - 1e-9)) + 1;
  EXPECT_EQ(read.head["frames"], frames);
  for (const char* array : {"position", "rotation", "activation", "series", "contact_count"}) {
    EXPECT_EQ(read.head["arrays"][array]["length"], frames) << array;
  }
  const size_t curves = read.head["series"].size();
  EXPECT_EQ(read.head["arrays"]["series"]["channels"], curves);
  EXPECT_GE(curves, 3u);
  for (size_t i = 0; i < curves; ++i) {
    const Json& series = read.head["series"][i];
    if (series.contains("graph")) {
      const auto has = [&](const Json& other) { return other["name"] == series["graph"]; };
      EXPECT_TRUE(std::any_of(read.head["series"].begin(), read.head["series"].end(), has)) << series;
    }
    if (series.contains("tolerance")) {
      EXPECT_GT(series["tolerance"], 0) << series;
    }
    if (!series.contains("labels")) continue;
    for (const int number : read.Numbers("series", i)) {
      EXPECT_LT(number, std::ssize(series["labels"])) << series;
    }
  }
  EXPECT_EQ(read.head.value("legend", ""), track().telemetry(*environment_)->Legend());
  EXPECT_EQ(read.head["events"].back()["kind"], "end");
  EXPECT_EQ(read.head["events"].back()["text"], "given-up");
  const size_t muscles = read.head["muscles"].size();
  for (size_t i = 0; i < muscles; ++i) {
    EXPECT_NEAR(read.Values("activation", i).back(), data().act[i], 0.003);
  }
}

// The points where muscles wrap are those of the physics, in the frame of their body.
TEST_P(Trajectories, HaveMusclesThatWrapWhereTheyDo) {
  const ReadTrajectory read = Read(file_);
  const auto figure = BuildFigure(model());
  ASSERT_TRUE(figure.ok());
  EXPECT_EQ(read.head["wraps"], figure->wraps.size());
  int wrapped = 0;
  for (const MusclePath& muscle : figure->muscles) {
    const int begin = data().ten_wrapadr[muscle.tendon];
    const int end = begin + data().ten_wrapnum[muscle.tendon];
    for (const PathPoint& point : muscle.points) {
      if (point.wrap < 0) continue;
      const int geom = figure->wraps[point.wrap].geom;
      const auto first = 7 * static_cast<size_t>(point.wrap);
      const bool on = read.Numbers("wrap", first).back() == 1;
      const int* found = std::find(data().wrap_obj + begin, data().wrap_obj + end, geom);
      EXPECT_EQ(on, found != data().wrap_obj + end) << muscle.name;
      if (!on) continue;
      ++wrapped;
      mjtNum local[3], place[3] = {};
      for (size_t i = 0; i < 3; ++i) local[i] = read.Values("wrap", first + 1 + i).back();
      const int body = point.part < 0 ? 0 : figure->parts[point.part];
      mju_rotVecMat(place, local, data().xmat + 9 * body);
      mju_addTo3(place, data().xpos + 3 * body);
      EXPECT_LT(mju_dist3(place, data().wrap_xpos + 3 * (found - data().wrap_obj)), 0.003)
          << muscle.name;
    }
  }
  EXPECT_GT(wrapped, 0);
}

// A body is as far from its target as the track's own measure says.
TEST_P(Trajectories, HaveTargetsBesideTheBodies) {
  const ReadTrajectory read = Read(file_);
  const std::vector<TargetPose> targets = track().telemetry(*environment_)->Targets();
  const size_t first = read.head["bodies"].size() - targets.size();
  for (size_t i = 0; i < read.head["bodies"].size(); ++i) {
    EXPECT_EQ(read.head["bodies"][i].contains("target"), i >= first) << i;
  }
  ASSERT_EQ(targets.size(), track().kind->name == "elbow" ? 1u : 0u);
  const std::map<std::string, Pose> poses = LastPoses(read);
  for (const TargetPose& target : targets) {
    const std::string name = mj_id2name(&model(), mjOBJ_BODY, target.body);
    const Pose& is = poses.at(name);
    const Pose& wanted = poses.at(absl::StrCat("target of ", name));
    double same = 0, as_told = 0;
    for (size_t k = 0; k < 4; ++k) {
      same += is.rotation[k] * wanted.rotation[k];
      as_told += target.rotation[k] * wanted.rotation[k];
    }
    EXPECT_NEAR(std::abs(as_told), 1, 1e-4);
    const double error = read.Values("series", 2).back();  // deg
    EXPECT_NEAR(2 * std::acos(std::min(std::abs(same), 1.0)) * 180 / M_PI, error, 0.1);
  }
}

TEST_P(Trajectories, HaveContactsThatCarryTheWeight) {
  const ReadTrajectory read = Read(file_);
  size_t contacts = 0;
  for (const int count : read.Numbers("contact_count", 0)) {
    EXPECT_LE(count, kMostContacts);
    contacts += static_cast<size_t>(count);
  }
  EXPECT_EQ(read.head["arrays"]["contact"]["length"], contacts);
}

TEST_P(Trajectories, NameTheBodiesThatTouch) {
  const ReadTrajectory read = Read(file_);
  const auto figure = BuildFigure(model());
  ASSERT_TRUE(figure.ok());
  std::set<std::pair<int, int>> touching;
  for (int i = 0; i < data().ncon; ++i) {
    const mjContact& contact = data().contact[i];
    touching.insert(std::minmax({figure->part_of[model().geom_bodyid[contact.geom1]] + 1,
                                 figure->part_of[model().geom_bodyid[contact.geom2]] + 1}));
  }
  const std::vector<int> on = read.Numbers("contact_body", 0);
  const std::vector<int> by = read.Numbers("contact_body", 1);
  ASSERT_EQ(read.head["arrays"]["contact"]["length"], on.size());
  const auto last = static_cast<size_t>(read.Numbers("contact_count", 0).back());
  for (size_t i = on.size() - last; i < on.size(); ++i) {
    EXPECT_GE(on[i], 1) << i;
    EXPECT_TRUE(touching.contains(std::minmax({on[i], by[i]}))) << on[i] << ", " << by[i];
  }
}

TEST_P(Trajectories, AreTheSameEachTime) { EXPECT_EQ(PlayEpisode(), file_); }

TEST_P(Trajectories, OfVeryLongEpisodesHaveFewerFrames) {
  const std::unique_ptr<Environment> own = Make();
  ASSERT_NE(own, nullptr);
  environment_ = own.get();
  environment_->Reset(11);
  const std::unique_ptr<TrajectoryRecorder> recorder = Recorder(10'000'000);
  recorder->Begin();
  const absl::StatusOr<std::string> file = recorder->Finish();
  ASSERT_TRUE(file.ok());
  const double frames = 1e7 * track().kind->control_period_s /
                        Read(*file).head["period_s"].get<double>();
  EXPECT_LE(frames, kMostFrames);
  EXPECT_GT(frames, kMostFrames / 2);
}

// What a viewer needs of a model file is there, and is what trajectories name.
TEST_P(Trajectories, FitTheirModelFile) {
  const ReadTrajectory read = Read(file_);
  const auto model = LoadModel(*track().model, CacheDir());
  ASSERT_TRUE(model.ok());
  const std::string file =
      *MakeModelFile(**model, track().kind->name, "0123456789abcdef", track().view);
  EXPECT_LE(file.size(), kMostModelFileBytes);
  EXPECT_GT(file.size(), kMostModelFileBytes * 3 / 4) << "no more is lost than has to be";
  EXPECT_EQ(file, *MakeModelFile(**model, track().kind->name, "0123456789abcdef", track().view));
  ASSERT_EQ(file.substr(0, 4), "glTF");
  const auto number = [&](size_t at, size_t bytes = 4) {
    uint32_t out = 0;
    for (size_t i = 0; i < bytes; ++i) out |= static_cast<uint32_t>(static_cast<uint8_t>(file[at + i])) << (8 * i);
    return out;
  };
  EXPECT_EQ(number(8), file.size());
  const Json document = Json::parse(file.substr(20, number(12)));
  const Json& extras = document["scenes"][0]["extras"];
  std::set<std::string> nodes;
  for (const Json& node : document["nodes"]) nodes.insert(node.value("name", ""));
  for (const Json& body : read.head["bodies"]) {
    EXPECT_TRUE(nodes.contains(body["name"].get<std::string>())) << body;
  }
  ASSERT_EQ(extras["muscles"].size(), read.head["muscles"].size());
  std::set<int> wraps;
  for (size_t i = 0; i < extras["muscles"].size(); ++i) {
    EXPECT_EQ(extras["muscles"][i]["name"], read.head["muscles"][i]);
    EXPECT_GE(extras["muscles"][i]["path"].size(), 2u);
    for (const Json& point : extras["muscles"][i]["path"]) {
      if (point.contains("wrap")) wraps.insert(point["wrap"].get<int>());
      const bool in_world = point["body"].is_null();
      EXPECT_TRUE(in_world || nodes.contains(point["body"].get<std::string>())) << point;
    }
  }
  EXPECT_EQ(wraps.size(), read.head["wraps"].get<size_t>());
  const Json& views = document["bufferViews"];
  EXPECT_EQ(number(20 + number(12)), document["buffers"][0]["byteLength"].get<size_t>());
  for (const Json& mesh : document["meshes"]) {
    const Json& primitive = mesh["primitives"][0];
    const Json& points = document["accessors"][primitive["attributes"]["POSITION"].get<size_t>()];
    const Json& indices = document["accessors"][primitive["indices"].get<size_t>()];
    const Json& view = views[indices["bufferView"].get<size_t>()];
    const size_t width = indices["componentType"] == 5125 ? 4 : 2;
    ASSERT_EQ(view["byteLength"], indices["count"].get<size_t>() * width);
    const size_t begin = 28 + number(12) + view["byteOffset"].get<size_t>();
    for (size_t at = begin; at < begin + view["byteLength"].get<size_t>(); at += width) {
      ASSERT_LT(number(at, width), points["count"].get<uint32_t>());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(OfEachTrack, Trajectories,
                         testing::ValuesIn([] {
                           std::vector<const SimulatedTrack*> tracks;
                           for (const SimulatedTrack& track : SimulatedTracks()) {
                             tracks.push_back(&track);
                           }
                           return tracks;
                         }()),
                         [](const auto& track) { return std::string(track.param->kind->name); });

// The numbers of one array with one channel.
std::vector<int> Stored(NumberType type, const std::vector<float>& values, ChannelRange range) {
  ArrayBlock block;
  const ChannelRange ranges[] = {range};
  block.Add("a", type, values, 1, ranges);
  return ReadTrajectory{{{"arrays", block.head()}}, block.bytes()}.Numbers("a", 0);
}

TEST(TrajectoryArrays, KeepNumbersWithinTheirRange) {
  EXPECT_THAT(Stored(NumberType::kU8, {0, 1, 0.5, 2, -1}, {0, 1}),
              ElementsAre(0, 255, 128, 255, 0));
  EXPECT_THAT(Stored(NumberType::kU16, {0, 65535, 1, 32768, 0}, {0, 65535}),
              ElementsAre(0, 65535, 1, 32768, 0));
  EXPECT_THAT(Stored(NumberType::kU16, {7, 7}, {7, 7}), Each(0));
}

TEST(TrajectoryArrays, TakeTheLastNumberForOneThatIsNone) {
  EXPECT_THAT(Stored(NumberType::kU8, {kNoNumber, 1, kNoNumber, INFINITY, 0}, {0, 1}),
              ElementsAre(0, 255, 255, 255, 0));
  EXPECT_EQ(RangeOf(std::vector<float>{kNoNumber, 3, -2, INFINITY}).low, -2);
  EXPECT_EQ(RangeOf(std::vector<float>{kNoNumber}).high, 0);
}

TEST(Meshes, AreSmoothedAndSimplified) {
  const auto model = LoadModel(*SimulatedTracks().back().model, CacheDir());
  ASSERT_TRUE(model.ok());
  int largest = -1;
  for (int geom = 0; geom < (*model)->ngeom; ++geom) {
    if ((*model)->geom_type[geom] != mjGEOM_MESH) continue;
    const auto faces = [&](int of) { return (*model)->mesh_facenum[(*model)->geom_dataid[of]]; };
    if (largest < 0 || faces(geom) > faces(largest)) largest = geom;
  }
  const Mesh whole = BuildMesh(**model, largest);
  const double side = SizeOf(whole) / 50;
  const Mesh smaller = Simplified(whole, side);
  EXPECT_LT(smaller.faces.size(), whole.faces.size() / 2);
  EXPECT_GT(smaller.faces.size(), 1000u);
  EXPECT_NEAR(SizeOf(smaller), SizeOf(whole), 2 * side);
  EXPECT_GT(Simplified(whole, 1e-7).faces.size(), whole.faces.size() * 99 / 100);
  EXPECT_LE(Simplified(whole, 10).points.size(), 8u) << "the cubes around the origin";
  const Mesh smooth = WithNormals(smaller);
  EXPECT_EQ(smooth.faces.size(), smaller.faces.size());
  ASSERT_EQ(smooth.normals.size(), smooth.points.size());
  for (size_t i = 0; i < smooth.faces.size(); ++i) {
    for (size_t corner = 0; corner < 3; ++corner) {
      EXPECT_EQ(smooth.points.at(smooth.faces[i][corner]), smaller.points.at(smaller.faces[i][corner]));
    }
  }
}

}  // namespace
}  // namespace myograde::sim
