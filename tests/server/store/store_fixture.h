// A store in its own folder, and helpers that fill it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include "server/store/store.h"

namespace myograde::server {

inline constexpr char kFacts[] =
    R"({"clipped":0,"digest":"aa","sim_time":10.0,"steps":1000,"wall_s":1.5,"policy_cpu_s":1})";

inline constexpr AdmissionRules kRules = {
    .quota = {
        .ranked = {100, 100}, .practice = {100, 100}, .failed = {100, 100}, .waiting = 100}};

class StoreTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "store-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    path_ = dir_ + "/store.db";
    Open();
  }
  void TearDown() override {
    store_.reset();
    std::filesystem::remove_all(dir_);
  }

  void Open() {
    store_.reset();
    auto store = Store::Open(path_, clock_);
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
  }

  // A submission of 4 episodes in blocks of 2; `artefact` is the letter of its hash.
  absl::StatusOr<Accepted> TrySubmit(const std::string& team, char artefact, bool ranked,
                                     const AdmissionRules& rules = kRules) {
    const std::string hash(64, artefact);
    Accepted accepted;
    const absl::Status status = store_->Write([&](Transaction& writer) -> absl::Status {
      auto added = writer.content.AddArtefact({{"walker", {"./policy"}, {"python"}}, hash, 10, 2});
      if (!added.ok()) return added.status();
      NewSubmission submission;
      submission.team = team;
      submission.artefact = hash;
      submission.track = "manipulation";
      submission.profile = "paper";
      submission.config = std::string(64, 'c');
      submission.config_json = submission.grader_json = "{}";
      submission.seeds = std::string(64, 'd');
      submission.seeds_json = "[1,2,3,4]";
      submission.ranked = ranked;
      submission.blocks = {{0, 1}, {2, 3}};
      auto result = writer.submissions.Accept(submission, rules, "uid 0");
      if (result.ok()) accepted = *result;
      return result.status();
    });
    if (!status.ok()) return status;
    return accepted;
  }
  Accepted Submit(const std::string& team = "alpha", char artefact = 'a') {
    const absl::StatusOr<Accepted> accepted = TrySubmit(team, artefact, /*ranked=*/true);
    EXPECT_TRUE(accepted.ok()) << accepted.status();
    return accepted.value_or(Accepted());
  }

  absl::Status Start(int64_t block, int64_t attempt) {
    return store_->Write(
        [&](Transaction& writer) { return writer.blocks.Start(block, attempt, 0, 99, "daemon"); });
  }

  // In what it differs from the row that is there.
  absl::StatusOr<std::vector<std::string>> Record(const Accepted& accepted, int64_t index,
                                                  int64_t attempt,
                                                  const std::string& facts = kFacts,
                                                  const std::string& details = "") {
    std::vector<std::string> differs;
    const int64_t block = accepted.blocks[static_cast<size_t>(index / 2)];
    const absl::Status status = store_->Write([&](Transaction& writer) -> absl::Status {
      auto result = writer.episodes.Record({accepted.evaluation, index, block, attempt,
                                          static_cast<uint64_t>(index + 1), Outcome::kFailure,
                                          FailureReason::kTime, facts, R"({"time_s":10.0})", details});
      if (result.ok()) differs = *result;
      return result.status();
    });
    if (!status.ok()) return status;
    return differs;
  }

  std::string SqlError(const std::string& sql) {
    SQLite::Database db(path_, SQLite::OPEN_READWRITE);
    try {
      db.exec(sql);
      return "";
    } catch (const SQLite::Exception& error) {
      return error.what();
    }
  }

  template <typename Body>
  void Read(Body body) {
    ReaderPool pool(path_);
    const absl::Status status = pool.Read([&](const Transaction& reader) {
      body(reader);
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
  }

  ManualClock clock_{absl::FromUnixSeconds(1700000000)};
  std::string dir_;
  std::string path_;
  std::unique_ptr<Store> store_;
};

}  // namespace myograde::server
