#include "rejudge_world.h"

#include <algorithm>
#include <filesystem>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "history_world.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr absl::Duration kPatience = absl::Seconds(30);
constexpr int64_t kPlenty = 1'000'000;
constexpr AdmissionRules kOpenRules = {.quota = {.ranked = {kPlenty, kPlenty},
                                                 .practice = {kPlenty, kPlenty},
                                                 .failed = {kPlenty, kPlenty},
                                                 .waiting = kPlenty}};

// Plays the whole lease at the first look, unless it is held.
class QuickRunner : public Runner {
 public:
  QuickRunner(Playing& playing, const LeaseOrder& order)
      : playing_(playing), order_(order), play_(++playing.starts) {}
  int stdout_fd() const override { return -1; }
  int stderr_fd() const override { return -1; }

  absl::StatusOr<std::vector<LeaseRecord>> Read() override {
    std::vector<LeaseRecord> records;
    const bool held = playing_.hold && absl::EndsWith(order_.artefact_dir, playing_.held);
    if (over_ || held) return records;
    const bool unsteady = !playing_.unsteady.empty() &&
                          absl::EndsWith(order_.artefact_dir, playing_.unsteady);
    for (const EpisodeOrder& episode : order_.episodes) {
      records.push_back(ProgressRecord{episode.index, 1});
      EpisodeFacts facts = FactsOf(episode);
      if (unsteady) facts.digest = Sha256Hex(absl::StrCat(facts.digest, play_));
      records.push_back(facts);
    }
    LeaseEndRecord end;
    end.ok = true;
    records.push_back(end);
    over_ = true;
    return records;
  }
  bool finished() override { return over_; }
  bool dead() override { return over_; }
  void AskToEnd() override {
    if (!over_) ++playing_.ended_early;
    over_ = true;
  }
  void KillNow() override { over_ = true; }
  pid_t pid() const override { return 1; }
  int wait_status() const override { return 0; }
  std::string stderr_tail() const override { return ""; }

 private:
  Playing& playing_;
  const LeaseOrder order_;
  const int play_;
  bool over_ = false;
};

class QuickProcesses : public Executor {
 public:
  explicit QuickProcesses(Playing& playing) : playing_(playing) {}
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order, const LeaseSubject&) override {
    return std::make_unique<QuickRunner>(playing_, order);
  }
  void CleanUp(const std::string&) override {}

 private:
  Playing& playing_;
};

absl::StatusOr<std::string> SignAnything(const std::string&) { return std::string(128, 'f'); }

}  // namespace

absl::Status CutDisk::Write(const StoreChange& change) {
  const int64_t number = commits++;
  if (!off && number == cut) {
    if (after) (void)store_.Write(change);
    off = true;
  }
  if (off) return absl::UnavailableError("the power is off");
  return store_.Write(change);
}

void RejudgeWorld::SetUp() {
  spdlog::set_level(spdlog::level::off);
  std::string name = (fs::temp_directory_path() / "rejudge-test-XXXXXX").string();
  ASSERT_NE(mkdtemp(name.data()), nullptr);
  dir_ = name;
  fs::create_directory(dir_ + "/artefacts");
  absl::StatusOr<TrackConfig> config =
      LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "demo-manipulation", "");
  ASSERT_TRUE(config.ok()) << config.status();
  base_ = *MakeTrack(*std::move(config));
  processes_ = std::make_unique<QuickProcesses>(playing_);
  Open();
}

void RejudgeWorld::TearDown() {
  playing_.hold = false;
  Close();
  fs::remove_all(dir_);
}

void RejudgeWorld::Close() {
  Halt();
  readers_ = nullptr;
  disk_ = nullptr;
  store_ = nullptr;
}

void RejudgeWorld::Open() {
  Close();
  absl::StatusOr<std::unique_ptr<Store>> store = Store::Open(dir_ + "/store.db", SystemClock());
  ASSERT_TRUE(store.ok()) << store.status();
  store_ = *std::move(store);
  readers_ = std::make_unique<ReaderPool>(dir_ + "/store.db");
  disk_ = std::make_unique<CutDisk>(*store_);
}

void RejudgeWorld::Run() {
  EngineOptions options;
  options.data_dir = dir_;
  options.config.scheduler = {.slots = slots_};
  engine_ = std::make_unique<Engine>(options, *disk_, *readers_, *processes_, SystemClock());
  const absl::Status status = engine_->Recover();
  EXPECT_TRUE(status.ok() || disk_->off) << status;
  loop_ = std::thread([this] { (void)engine_->Run(); });
  rejudger_ = std::make_unique<Rejudger>(
      RejudgerOptions{.data_dir = dir_,
                      .grader = [this] { return today_; },
                      .every = absl::Milliseconds(2)},
      *engine_, *readers_);
}

void RejudgeWorld::Halt() {
  rejudger_ = nullptr;
  if (engine_ != nullptr) engine_->Stop();
  if (loop_.joinable()) loop_.join();
  engine_ = nullptr;
}

TrackPtr RejudgeWorld::Changed(const std::function<void(Json&)>& change) const {
  Json effective = base_->config.effective;
  change(effective);
  absl::StatusOr<TrackConfig> config = ParseTrackConfig(effective, "the test's config");
  EXPECT_TRUE(config.ok()) << config.status();
  return *MakeTrack(*std::move(config));
}

namespace {

NewSubmission SubmissionOf(const TrackConfig& config, const std::string& team,
                           const std::string& artefact, const Json& grader) {
  NewSubmission submission;
  submission.team = team;
  submission.artefact = artefact;
  submission.track = config.id;
  submission.profile = config.profile;
  submission.config = config.hash;
  submission.config_json = CanonicalJson(config.effective);
  submission.seeds_json = CanonicalJson(Json(config.seeds));
  submission.seeds = Sha256Hex(submission.seeds_json);
  submission.ranked = true;
  submission.grader_json = CanonicalJson(grader);
  submission.blocks = SplitIntoBlocks(std::ssize(config.seeds), config.episodes_per_lease);
  return submission;
}

}  // namespace

int64_t RejudgeWorld::Played(const std::string& team, const Json& grader, bool crashes) {
  const TrackConfig& config = base_->config;
  const std::string artefact = Sha256Hex(absl::StrCat(team, "/", ++artefacts_));
  fs::create_directory(ArtefactFolder(dir_, artefact));
  Accepted accepted;
  const absl::Status status = store_->Write([&](Transaction& writer) -> absl::Status {
    if (auto added = writer.content.AddArtefact({{team, {"./policy"}}, artefact, 1, 1});
        !added.ok()) {
      return added.status();
    }
    absl::StatusOr<Accepted> added = writer.submissions.Accept(
        SubmissionOf(config, team, artefact, grader), kOpenRules, "uid 1");
    if (!added.ok()) return added.status();
    accepted = *added;
    std::vector<EpisodeRow> rows;
    absl::Status written;
    const auto blocks = SplitIntoBlocks(std::ssize(config.seeds), config.episodes_per_lease);
    for (size_t i = 0; i < blocks.size(); ++i) {
      written.Update(writer.blocks.Start(accepted.blocks[i], 1, 0, 1, "test"));
      for (int64_t index = blocks[i].first; index <= blocks[i].second; ++index) {
        EpisodeOrder order;
        order.index = index;
        order.seed = config.seeds[static_cast<size_t>(index)];
        EpisodeFacts facts = FactsOf(order);
        if (crashes) {
          facts.end = EpisodeEnd::kFault;
          facts.fault.outcome = Outcome::kCrash;
          facts.fault.value = 7 << 8;
        }
        EpisodeRow row = *JudgedRow(*base_, facts);
        row.evaluation = accepted.evaluation;
        row.block = accepted.blocks[i];
        row.attempt = 1;
        written.Update(writer.episodes.Record(row).status());
        rows.push_back(std::move(row));
      }
      written.Update(writer.blocks.Finish(accepted.blocks[i], 1, "{}", "test"));
    }
    const EvaluationResult result = *ComputeResult(*base_, rows);
    written.Update(writer.evaluations.End(accepted.evaluation, result.state, result.reason,
                                        result.results_hash, "test"));
    if (!crashes) written.Update(writer.episodes.SetStanding(accepted.evaluation, result.aggregate));
    return written;
  });
  EXPECT_TRUE(status.ok()) << status;
  return accepted.submission;
}

Accepted RejudgeWorld::Submit(const std::string& team) {
  const std::string artefact = Sha256Hex(absl::StrCat(team, "/", ++artefacts_));
  fs::create_directory(ArtefactFolder(dir_, artefact));
  const auto known = engine_->AddArtefact({{team, {"./policy"}}, artefact, 1, 1}, {"uid 1", team},
                                          {}, kPatience);
  EXPECT_TRUE(known.ok()) << known.status();
  const auto accepted = engine_->Submit(SubmissionOf(base_->config, team, artefact, today_),
                                        kOpenRules, "uid 1", kPatience);
  EXPECT_TRUE(accepted.ok()) << accepted.status();
  return accepted.value_or(Accepted());
}

NewRejudge RejudgeWorld::To(const TrackPtr& track) const {
  const NewSubmission from = SubmissionOf(base_->config, "", "", today_);
  const NewSubmission to = SubmissionOf(track->config, "", "", today_);
  NewRejudge rejudge;
  rejudge.board = {"", from.track, from.profile};
  rejudge.from_config = from.config;
  rejudge.from_config_json = from.config_json;
  rejudge.to_config = to.config;
  rejudge.to_config_json = to.config_json;
  rejudge.seeds = to.seeds;
  rejudge.seeds_json = to.seeds_json;
  rejudge.grader_json = CanonicalJson(today_);
  rejudge.why = "the rules change";
  return rejudge;
}

absl::StatusOr<RejudgePlan> RejudgeWorld::Create(const NewRejudge& rejudge) {
  return engine_->CreateRejudge(rejudge, SignAnything, "uid 0", kPatience);
}

absl::StatusOr<RejudgeDone> RejudgeWorld::Apply(int64_t rejudge, std::set<int64_t> without) {
  return engine_->EndRejudge(/*apply=*/true, {rejudge, "as announced", std::move(without)},
                             SignAnything, "uid 0", kPatience);
}

absl::StatusOr<RejudgeDone> RejudgeWorld::Drop(int64_t rejudge) {
  return engine_->EndRejudge(/*apply=*/false, {rejudge, "a mistake"}, SignAnything, "uid 0", kPatience);
}

RejudgeProgress RejudgeWorld::Progress(int64_t rejudge) {
  RejudgeProgress progress;
  Read([&](const Transaction& reader) {
    const auto row = reader.rejudges.Find(rejudge);
    ASSERT_TRUE(row.ok()) << row.status();
    const auto read = reader.rejudges.CountProgress(*row);
    ASSERT_TRUE(read.ok()) << read.status();
    progress = *read;
  });
  return progress;
}

bool RejudgeWorld::Plays(int64_t rejudge) {
  const std::vector<EvaluationRow> items = Items(rejudge);
  return std::any_of(items.begin(), items.end(), [](const EvaluationRow& item) {
    return item.state == EvaluationState::kRunning;
  });
}

std::vector<EvaluationRow> RejudgeWorld::Items(int64_t rejudge) {
  std::vector<EvaluationRow> items;
  Read([&](const Transaction& reader) {
    const auto read = reader.evaluations.OfRejudge(rejudge);
    ASSERT_TRUE(read.ok()) << read.status();
    items = *read;
  });
  return items;
}

std::string RejudgeWorld::StateOf(int64_t evaluation) {
  std::string state;
  Read([&](const Transaction& reader) {
    state = std::string(EnumName(reader.evaluations.Find(evaluation)->state));
  });
  return state;
}

void RejudgeWorld::Await(const std::function<bool()>& holds, const std::string& what) {
  const Deadline deadline(kPatience);
  while (!holds()) {
    ASSERT_FALSE(deadline.over()) << "waited in vain until " << what;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

void RejudgeWorld::AwaitComplete(int64_t rejudge) {
  Await([&] { return Progress(rejudge).complete; }, "the rejudge is complete");
}

}  // namespace myograde::server
