// The models as loaded: sizes, patches, the cache and its errors.
#include "sim/model/model.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "protocol/tracks/locomotion/track.h"
#include "protocol/tracks/manipulation/track.h"
#include "sim/locomotion/track.h"
#include "sim/manipulation/track.h"
#include "sim/tracks.h"
#include "tests/sim/golden.h"

namespace myograde::sim {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr char kPackage[] = "myosuite-2.8.4/myosuite";

// A cache folder of its own, with copies that a test may spoil.
class CacheCopy : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "myograde-model-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
  }
  void TearDown() override { fs::remove_all(dir_); }

  void CopyPackage() {
    fs::create_directories(dir_ / kPackage / "envs/myo");
    fs::copy(fs::path(CacheDir()) / kPackage / "simhive", dir_ / kPackage / "simhive",
             fs::copy_options::recursive);
    fs::copy(fs::path(CacheDir()) / kPackage / "envs/myo/assets",
             dir_ / kPackage / "envs/myo/assets", fs::copy_options::recursive);
  }

  void Append(const fs::path& path) {
    fs::permissions(path, fs::perms::owner_write, fs::perm_options::add);
    std::ofstream(path, std::ios::app) << " ";
  }

  absl::StatusOr<ModelPtr> Load(const ModelSource& source) { return LoadModel(source, dir_.string()); }

  fs::path dir_;
};

TEST(Model, ManipulationHasTheDocumentedSizes) {
  const auto loaded = LoadModel(ManipulationModel(), CacheDir());
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  const mjModel& m = **loaded;
  EXPECT_EQ(m.nq, 71);
  EXPECT_EQ(m.nv, 70);
  EXPECT_EQ(m.nu, 80);
  EXPECT_EQ(m.na, 63);
  EXPECT_EQ(m.nbody, 73);
  EXPECT_EQ(m.ngeom, 196);
  EXPECT_EQ(m.nsite, 532);
  EXPECT_EQ(m.ntendon, 75);
  EXPECT_EQ(m.nwrap, 480);
  EXPECT_EQ(m.neq, 20);
  EXPECT_EQ(m.nM, 809);
  EXPECT_EQ(m.nkey, 4);
  EXPECT_EQ(m.opt.timestep, 0.002);
  EXPECT_EQ(m.opt.enableflags, mjENBL_MULTICCD);
  EXPECT_EQ(m.ntexdata, 0) << "textures only cost memory here";
  EXPECT_STREQ(mj_id2name(&m, mjOBJ_ACTUATOR, 0), "prosthesis/Lshoulder_fe");
  EXPECT_STREQ(mj_id2name(&m, mjOBJ_ACTUATOR, 17), "DELT1");
  EXPECT_EQ(m.body_mass[70], 0.27006089218076124);
}

TEST(Model, LocomotionHasTheDocumentedSizes) {
  const auto loaded = LoadModel(LocomotionModel(), CacheDir());
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  const mjModel& m = **loaded;
  EXPECT_EQ(m.nq, 30);
  EXPECT_EQ(m.nv, 29);
  EXPECT_EQ(m.nu, 56);
  EXPECT_EQ(m.na, 54);
  EXPECT_EQ(m.nbody, 19);
  EXPECT_EQ(m.ngeom, 82);
  EXPECT_EQ(m.nsite, 290);
  EXPECT_EQ(m.nhfielddata, 18000);  // room for the widest course
  EXPECT_EQ(m.opt.timestep, 0.001);
  EXPECT_STREQ(mj_id2name(&m, mjOBJ_ACTUATOR, 0), "osl_knee_torque_actuator");
  EXPECT_STREQ(mj_id2name(&m, mjOBJ_ACTUATOR, 2), "addbrev_r");
  double mass = 0;
  for (int i = 0; i < m.nbody; ++i) mass += m.body_mass[i];
  EXPECT_NEAR(mass, 78.66887849930261, 1e-12);
}

TEST(Model, AMuscleBelowItsShortestLengthDoesNotPush) {
  const auto loaded = LoadModel(ManipulationModel(), CacheDir());
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  mjModel* m = loaded->get();
  DataPtr d(mj_makeData(m));
  mj_resetDataKeyframe(m, d.get(), 2);
  for (int i = 0; i < m->na; ++i) d->act[i] = 1;
  mj_forward(m, d.get());
  const int lat1 = mj_name2id(m, mjOBJ_ACTUATOR, "LAT1");
  ASSERT_GE(lat1, 0);
  // Active force apart from the passive bias: none below the curve's end.
  EXPECT_EQ(d->actuator_force[lat1],
            mju_muscleBias(d->actuator_length[lat1], m->actuator_lengthrange + 2 * lat1,
                           m->actuator_acc0[lat1], m->actuator_biasprm + mjNBIAS * lat1));
  const int biceps = mj_name2id(m, mjOBJ_ACTUATOR, "BIClong");
  EXPECT_LT(d->actuator_force[biceps], -10) << "other muscles pull";
}

// "hg" among the flags of the mapping that holds `address`.
bool InHugePages(const void* address) {
  std::ifstream maps("/proc/self/smaps");
  bool here = false;
  for (std::string line; std::getline(maps, line);) {
    unsigned long first = 0, last = 0;
    if (std::sscanf(line.c_str(), "%lx-%lx ", &first, &last) == 2) {
      const auto at = reinterpret_cast<unsigned long>(address);
      here = first <= at && at < last;
    }
    if (here && line.starts_with("VmFlags:")) return (line + " ").find(" hg ") != std::string::npos;
  }
  return false;
}

TEST(Model, LargeBlocksAreAskedForInHugePages) {
  if (!fs::exists("/sys/kernel/mm/transparent_hugepage")) GTEST_SKIP() << "no such kernel";
  const auto loaded = LoadModel(ManipulationModel(), CacheDir());
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  const DataPtr d(mj_makeData(loaded->get()));
  EXPECT_TRUE(InHugePages((*loaded)->buffer));
  EXPECT_TRUE(InHugePages(d->buffer));
}

TEST_F(CacheCopy, CompilesOnceAndLoadsTheSameModel) {
  CopyPackage();
  const auto compiled = Load(LocomotionModel());
  ASSERT_TRUE(compiled.ok()) << compiled.status();
  const auto models = fs::directory_iterator(dir_ / "models");
  const fs::path file = models->path();
  const auto written = fs::last_write_time(file);
  const auto loaded = Load(LocomotionModel());
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  EXPECT_EQ(fs::last_write_time(file), written);
  std::string one(static_cast<size_t>(mj_sizeModel(compiled->get())), '\0');
  std::string two(static_cast<size_t>(mj_sizeModel(loaded->get())), '\0');
  mj_saveModel(compiled->get(), nullptr, one.data(), static_cast<int>(one.size()));
  mj_saveModel(loaded->get(), nullptr, two.data(), static_cast<int>(two.size()));
  EXPECT_TRUE(one == two);
}

TEST_F(CacheCopy, NamesAMissingFile) {
  const auto loaded = Load(ManipulationModel());
  EXPECT_EQ(loaded.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(loaded.status().message()), HasSubstr("is missing"));
  EXPECT_THAT(std::string(loaded.status().message()), HasSubstr("./dev setup"));
}

TEST_F(CacheCopy, ACompiledModelNeedsItsSourcesNoMore) {
  CopyPackage();
  ASSERT_TRUE(Load(LocomotionModel()).ok());
  fs::remove_all(dir_ / kPackage);
  EXPECT_TRUE(Load(LocomotionModel()).ok());
}

TEST_F(CacheCopy, NamesAnAlteredFileAndCompilesNothing) {
  CopyPackage();
  const fs::path mesh = dir_ / kPackage / "simhive/myo_sim/meshes/l_bofoot.stl";
  ASSERT_TRUE(fs::exists(mesh));
  Append(mesh);
  const auto loaded = Load(LocomotionModel());
  EXPECT_FALSE(fs::exists(dir_ / "models"));
  EXPECT_EQ(loaded.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(loaded.status().message()), HasSubstr(mesh.filename().string()));
  EXPECT_THAT(std::string(loaded.status().message()), HasSubstr("was altered"));
}

TEST_F(CacheCopy, NamesADamagedCompiledModel) {
  CopyPackage();
  ASSERT_TRUE(Load(LocomotionModel()).ok());
  const fs::path file = fs::directory_iterator(dir_ / "models")->path();
  Append(file);
  const auto loaded = Load(LocomotionModel());
  EXPECT_EQ(loaded.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(loaded.status().message()), HasSubstr(file.filename().string()));
  fs::resize_file(file, 10);
  EXPECT_EQ(Load(LocomotionModel()).status().code(), absl::StatusCode::kDataLoss);
}

// The part of an entry's name that names an actuator or a joint of the model.
std::string ModelName(std::string_view entry, std::string_view prefix) {
  const size_t dot = entry.rfind('.');
  return std::string(prefix) + std::string(dot == entry.npos ? entry : entry.substr(dot + 1));
}

TEST(Layout, DirectBoundsOfActionsAreTheModelsControlRanges) {
  for (const SimulatedTrack& track : SimulatedTracks()) {
    const TrackKind& kind = *track.kind;
    const auto model = LoadModel(*track.model, CacheDir());
    ASSERT_TRUE(model.ok()) << model.status();
    const std::span<const Bounds> bounds = kind.layout().action_bounds(ActionConvention::kDirect);
    int found = 0;
    for (int i = 0; i < ActionOf(kind).size(); ++i) {
      int actuator = -1;
      for (const char* prefix : {"", "prosthesis/"}) {
        const std::string name = ModelName(ActionOf(kind).names()[i], prefix);
        if (actuator < 0) actuator = mj_name2id(model->get(), mjOBJ_ACTUATOR, name.c_str());
      }
      if (actuator < 0) continue;
      ++found;
      // A model may begin a little above what is allowed: less counts as its least.
      EXPECT_NEAR(bounds[i].low, (*model)->actuator_ctrlrange[2 * actuator], 0.001)
          << ActionOf(kind).names()[i];
      EXPECT_EQ(bounds[i].high, (*model)->actuator_ctrlrange[2 * actuator + 1])
          << ActionOf(kind).names()[i];
    }
    // All but the choice of the leg's set; the leg's two motors are the controller's.
    EXPECT_EQ(found, ActionOf(kind).size() - (&kind == &LocomotionTrack() ? 1 : 0));
  }
}

TEST(Layout, BoundsOfJointPositionsAreTheModelsRanges) {
  const struct {
    const TrackKind& kind;
    const ModelSource& source;
    std::string_view part;
    std::string_view prefix;
  } parts[] = {{ManipulationTrack(), ManipulationModel(), "myohand_qpos", ""},
               {ManipulationTrack(), ManipulationModel(), "pros_hand_qpos", "prosthesis/"},
               {LocomotionTrack(), LocomotionModel(), "internal_qpos", ""}};
  for (const auto& [kind, source, part_name, prefix] : parts) {
    const auto model = LoadModel(source, CacheDir());
    ASSERT_TRUE(model.ok()) << model.status();
    const auto layout = ObservationOf(kind).parts();
    const auto part = std::find_if(layout.begin(), layout.end(),
                                   [&name = part_name](const Part& p) { return p.name == name; });
    ASSERT_NE(part, layout.end()) << part_name;
    for (int i = part->offset; i < part->offset + part->size; ++i) {
      const std::string name = ModelName(ObservationOf(kind).names()[i], prefix);
      const int joint = mj_name2id(model->get(), mjOBJ_JOINT, name.c_str());
      ASSERT_GE(joint, 0) << name;
      EXPECT_EQ(ObservationOf(kind).bounds()[i].low, (*model)->jnt_range[2 * joint]) << name;
      EXPECT_EQ(ObservationOf(kind).bounds()[i].high, (*model)->jnt_range[2 * joint + 1]) << name;
    }
  }
}

}  // namespace
}  // namespace myograde::sim
