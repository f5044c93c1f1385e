// A data folder with a store and an engine that plays nothing.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "server/admission/admission.h"
#include "server/engine/engine.h"
#include "server/challenge/offered_tracks.h"
#include "server/store/store.h"
#include "tests/server/artefact/raw_tar.h"

namespace myograde::server {

inline constexpr char kTrack[] = "demo-manipulation";  // three episodes, each a lease
inline constexpr char kCyrillicAlpha[] = "\xd0\xb0lpha";  // its first letter

class NothingIsPlayed : public Executor {
 public:
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder&, const LeaseSubject&) override {
    return absl::UnavailableError("nothing is played here");
  }
  void CleanUp(const std::string&) override {}
};

// The real store, on a disk that can be made full.
class FillableDisk : public StoreWriter {
 public:
  explicit FillableDisk(Store& store) : store_(store) {}
  absl::Status Write(const StoreChange& change) override {
    return full ? absl::ResourceExhaustedError("the disk is full") : store_.Write(change);
  }

  std::atomic<bool> full = false;

 private:
  Store& store_;
};

class MemoryArchive : public IncomingArchive {
 public:
  explicit MemoryArchive(std::string bytes) : bytes_(std::move(bytes)) {}

  int64_t size() const override { return std::ssize(bytes_); }
  ssize_t ReadAt(char* to, size_t size, int64_t offset) const override {
    return static_cast<ssize_t>(bytes_.copy(to, size, static_cast<size_t>(offset)));
  }
  absl::Status MoveTo(const std::string& path) override {
    moved = true;
    std::ofstream(path, std::ios::binary) << bytes_;
    return absl::OkStatus();
  }

  bool moved = false;  // for unpacking

 private:
  const std::string bytes_;
};

// A tar with `manifest` as its policy.json and a script as its policy.
inline std::string TarWith(const std::string& manifest) {
  return TarEntry('0', "policy.json", manifest) +
         TarEntry('0', "policy", "#!/bin/sh\n", {}, 0755) + std::string(2 * kTarBlock, '\0');
}

inline std::string GoodTar(const std::string& name = "walker") {
  return TarWith(absl::StrCat(R"({"name": ")", name, R"(", "command": ["./policy"]})"));
}

class AdmissionWorld : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "admission-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    for (const char* part : {"artefacts", "spool"}) {
      std::filesystem::create_directory(dir_ + "/" + part);
    }
    absl::StatusOr<Tracks> tracks = Tracks::Load(MYOGRADE_SOURCE_DIR "/configs/tracks");
    ASSERT_TRUE(tracks.ok()) << tracks.status();
    tracks_ = std::make_unique<Tracks>(*std::move(tracks));
    store_ = *Store::Open(dir_ + "/store.db", clock_);
    readers_ = std::make_unique<ReaderPool>(dir_ + "/store.db");
    disk_ = std::make_unique<FillableDisk>(*store_);
    options_.data_dir = dir_;
    options_.cache_dir = dir_ + "/cache";
    ServerConfig& config = options_.config;
    config.scheduler.slots = 0;
    config.artefacts.bytes = 1 << 20;
    config.artefacts.files = 100;
    config.artefacts.unpack_memory_bytes = 256 << 20;
    config.artefacts.disk_reserve = 0;
    config.http.request = absl::Minutes(1);
    config.http.upload = absl::Minutes(1);
    config.quota.defaults.quota = {
        .ranked = {9, 9}, .practice = {9, 9}, .failed = {9, 9}, .waiting = 9};
  }

  void TearDown() override {
    admission_ = nullptr;
    if (engine_ != nullptr) engine_->Stop();
    if (loop_.joinable()) loop_.join();
    engine_ = nullptr;
    std::filesystem::remove_all(dir_);
  }

  // Created by the first call, with `options_` as they are then.
  Admission& admission() {
    if (admission_ == nullptr) {
      engine_ = std::make_unique<Engine>(EngineOptions{options_.config, dir_, options_.cache_dir},
                                         *disk_, *readers_, processes_, clock_);
      loop_ = std::thread([this] { (void)engine_->Run(); });
      admission_ = std::make_unique<Admission>(options_, *tracks_, phases_, *engine_,
                                               *readers_, clock_);
    }
    return *admission_;
  }

  // From `uid 7`, who is not an organiser. `team` "": names neither team nor track.
  absl::StatusOr<ReceivedArtefact> Receive(IncomingArchive& archive, const std::string& team = "") {
    return admission().Receive(
        {.from = {"uid 7", team, /*organiser=*/false}, .track = team.empty() ? "" : kTrack},
        archive);
  }
  absl::StatusOr<ReceivedArtefact> Receive(const std::string& bytes, const std::string& team = "") {
    MemoryArchive archive(bytes);
    return Receive(archive, team);
  }

  // An artefact with files, as if received; its hash is `letter` repeated.
  void AddArtefact(char letter, int64_t bytes = 10, std::vector<std::string> runtimes = {}) {
    AddArtefact(letter, {{"walker", {"./policy"}, std::move(runtimes)}, std::string(64, letter),
                         bytes, 2});
  }
  void AddArtefact(char letter, const ArtefactRow& row) {
    admission();
    ASSERT_TRUE(
        engine_->AddArtefact(row, {"uid 7", "", true}, {}, absl::Minutes(1)).ok());
    std::filesystem::create_directory(ArtefactPath(std::string(64, letter)));
  }

  // The track's seeds, or the first `episodes` of them.
  absl::StatusOr<Accepted> Submit(const std::string& team, char artefact,
                                  std::optional<int64_t> episodes = std::nullopt) {
    return admission().Submit({.artefact = std::string(64, artefact),
                               .team = team,
                               .track = kTrack,
                               .profile = "",
                               .seeds = std::nullopt,
                               .episodes = episodes},
                              "uid 7");
  }

  std::string ArtefactPath(const std::string& hash) const { return dir_ + "/artefacts/" + hash; }
  bool IsEmpty(const char* part) const { return std::filesystem::is_empty(dir_ + "/" + part); }

  int64_t Count(const std::string& table) const {
    SQLite::Database db(dir_ + "/store.db");
    return db.execAndGet("SELECT count(*) FROM " + table).getInt64();
  }
  // Makes its row unreadable, as a disk error would.
  void DamageArtefact(char letter) const {
    SQLite::Database db(dir_ + "/store.db", SQLite::OPEN_READWRITE, /*busy_ms=*/10'000);
    db.exec("DROP TRIGGER artefact_fixed");
    db.exec(absl::StrCat("UPDATE artefact SET manifest_json = 'x' WHERE hash = '",
                         std::string(64, letter), "'"));
  }
  SubmissionRow FindSubmission(const Accepted& accepted) {
    SubmissionRow row;
    const absl::Status status = readers_->Read([&](const Transaction& reader) {
      absl::StatusOr<SubmissionRow> read = reader.submissions.Find(accepted.submission);
      if (read.ok()) row = *std::move(read);
      return read.status();
    });
    EXPECT_TRUE(status.ok()) << status;
    return row;
  }
  std::vector<LedgerRow> LedgerOf(const std::string& team) {
    std::vector<LedgerRow> rows;
    const absl::Status status = readers_->Read([&](const Transaction& reader) {
      rows = reader.quotas.Ledger(team, "", INT64_MAX, 100).rows;
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
    return rows;
  }

  ManualClock clock_{absl::FromUnixSeconds(1'700'000'000)};
  std::string dir_;
  AdmissionOptions options_;
  std::unique_ptr<Tracks> tracks_;
  Phases phases_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<ReaderPool> readers_;
  std::unique_ptr<FillableDisk> disk_;
  NothingIsPlayed processes_;
  std::unique_ptr<Engine> engine_;
  std::thread loop_;
  std::unique_ptr<Admission> admission_;
};

}  // namespace myograde::server
