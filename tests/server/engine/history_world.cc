#include "history_world.h"

#include <filesystem>
#include <map>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/policy_seed.h"
#include "server/grading/results.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr absl::Duration kEpisode = absl::Seconds(5);
constexpr int64_t kEnough = 1'000'000;
constexpr AdmissionRules kRules = {.quota = {.ranked = {kEnough, kEnough},
                                             .practice = {kEnough, kEnough},
                                             .failed = {kEnough, kEnough},
                                             .waiting = kEnough}};

// Creating a store takes longer than many histories, so they start from copies of one. Its folder
// is removed at exit.
struct EmptyStoreFile {
  EmptyStoreFile() {
    folder = (fs::temp_directory_path() / "myograde-history-XXXXXX").string();
    if (mkdtemp(folder.data()) == nullptr) abort();
    path = folder + "/store.db";
    if (!Store::Open(path, SystemClock()).ok()) abort();
  }
  ~EmptyStoreFile() { fs::remove_all(folder); }

  std::string folder, path;
};

const std::string& EmptyStore() {
  static const EmptyStoreFile file;
  return file.path;
}

TrackPtr DemoTrack() {
  static const TrackPtr track = [] {
    absl::StatusOr<TrackConfig> config =
        LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", "demo-manipulation", "");
    if (!config.ok()) abort();
    return *MakeTrack(*std::move(config));
  }();
  return track;
}

}  // namespace

EpisodeFacts FactsOf(const EpisodeOrder& episode) {
  EpisodeFacts facts;
  facts.index = episode.index;
  facts.seed = episode.seed;
  const bool placed = episode.seed % 2 == 0;
  facts.end = placed ? ManipulationEnd::kPlaced : EpisodeEnd::kTime;
  facts.steps = 100;
  facts.sim_time = 1;
  facts.digest = Sha256Hex(absl::StrCat(episode.seed, "/", episode.policy_seed));
  ManipulationFacts played;
  played.frames_arm = played.frames_prosthesis = 100;
  played.placed = played.solved = played.goal_only_at_end = placed;
  facts.track = played;
  ManipulationDetails details;
  details.first_contact_time = 0.5;
  if (placed) details.handover_time = 0.75;
  facts.details = details;
  return facts;
}

FakeRunner::FakeRunner(World& world, const LeaseOrder& order)
    : world_(world), slot_(order.slot) {
  if (!world_.slots_in_use.insert(slot_).second) {
    world_.broken = absl::StrCat("two runners at once on slot ", slot_);
  }
  WriteScript(order);
}

FakeRunner::~FakeRunner() { world_.slots_in_use.erase(slot_); }

void FakeRunner::Say(absl::Duration at, const LeaseRecord& record) {
  script_.emplace_back(at, record);
}

void FakeRunner::WriteScript(const LeaseOrder& order) {
  Tape& tape = world_.tape;
  begins_at_ = world_.clock.Monotonic();
  if (world_.remote) {
    begins_at_ += std::exchange(world_.next_begins_late, absl::ZeroDuration());
    if (tape.Happens(32)) begins_at_ += absl::Minutes(tape.Below(8));
    lost_at_ = begins_at_ + std::exchange(world_.next_is_lost_after, absl::InfiniteDuration());
    if (tape.Happens(24)) lost_at_ = begins_at_ + absl::Seconds(tape.Below(20));
  }
  absl::Duration at = begins_at_ + std::exchange(world_.next_is_late, absl::ZeroDuration());
  const bool self_test = order.lease == "selftest-1";
  for (const EpisodeOrder& episode : order.episodes) {
    Say(at, ProgressRecord{episode.index, 1});
    at += kEpisode * (1 + tape.Below(2) * tape.Below(4));  // some are slow, which is not a fault
    EpisodeFacts facts = FactsOf(episode);
    if (self_test) {
      facts.end = EpisodeEnd::kFault;
      facts.fault.outcome = Outcome::kCrash;
      facts.fault.value = 7 << 8;
    }
    if (tape.Happens(4)) continue;                                   // the record is lost
    if (tape.Happens(4)) facts.seed += 1;                            // of a different episode
    Say(at, facts);
    if (tape.Happens(4)) Say(at, facts);             // a duplicate
    if (tape.Happens(4)) at += absl::Hours(1);                       // it stalls
    if (tape.Happens(4)) {                                           // it dies
      dies_at_ = at + absl::Seconds(tape.Below(10));
      break;
    }
  }
  LeaseEndRecord end;
  end.ok = !tape.Happens(4);
  if (!end.ok) end.detail = "the simulator vanished";
  Say(at, end);
  at += std::exchange(world_.next_lingers, absl::ZeroDuration());
  dies_at_ = std::min(dies_at_, at + absl::Seconds(tape.Happens(4) ? 10'000 : 0));
  garbage_ = tape.Happens(4);
  kill_takes_ = tape.Happens(8) ? absl::Minutes(2)
                                : std::exchange(world_.next_dies_late, absl::ZeroDuration());
  stubborn_ = tape.Happens(32) || kill_takes_ > absl::ZeroDuration();
}

absl::StatusOr<std::vector<LeaseRecord>> FakeRunner::Read() {
  std::vector<LeaseRecord> records;
  const absl::Duration now = std::min({world_.clock.Monotonic(), dies_at_, lost_at_});
  while (said_ < script_.size() && script_[said_].first <= now) {
    records.push_back(script_[said_++].second);
  }
  world_.clock.Advance(std::exchange(world_.next_look_takes, absl::ZeroDuration()));
  if (garbage_ && said_ > 1) return absl::DataLossError("a malformed record");
  return records;
}

bool FakeRunner::dead() {
  if (world_.clock.Monotonic() < dies_at_) return false;
  world_.slots_in_use.erase(slot_);
  return true;
}

bool FakeRunner::finished() {
  return dead() && (said_ == script_.size() || script_[said_].first > dies_at_ || garbage_);
}

bool FakeRunner::begun() const { return world_.clock.Monotonic() >= begins_at_; }

std::string FakeRunner::lost() const {
  return world_.clock.Monotonic() >= lost_at_ ? "the node was switched off" : "";
}

RunnerSite FakeRunner::site() const {
  if (!world_.remote) return {};
  RunnerSite site{absl::StrCat("node", slot_), absl::StrCat("7_", slot_), 1.5, std::nullopt};
  if (slot_ % 2 == 0) site.energy_j = 40;
  return site;
}

bool FakeProcesses::remote() const { return world_.remote; }

std::string FakeProcesses::CannotStart() const { return world_.cannot_start; }

void FakeProcesses::NoteEnd(const std::string& node, bool fault) {
  world_.ends.emplace_back(node, fault);
}

std::vector<DrainedNode> FakeProcesses::TakeDrained() { return std::exchange(world_.drained, {}); }

void FakeRunner::AskToEnd() {
  const int tenths = world_.tape.Below(6);
  if (!stubborn_) {
    dies_at_ = std::min(dies_at_, world_.clock.Monotonic() + absl::Milliseconds(100 * tenths));
  }
}

void FakeRunner::KillNow() {
  dies_at_ = std::min(dies_at_, world_.clock.Monotonic() + kill_takes_);
}

absl::StatusOr<std::unique_ptr<Runner>> FakeProcesses::Start(const LeaseOrder& order, const LeaseSubject&) {
  if (world_.tape.Happens(4)) return absl::UnavailableError("no process could be made");
  return std::make_unique<FakeRunner>(world_, order);
}

std::map<int, std::string> FakeProcesses::FindProcesses(int first, int count) {
  std::map<int, std::string> found;
  for (const auto& [slot, words] : world_.left) {
    if (slot >= first && slot < first + count) found[slot] = words;
  }
  return found;
}

absl::Status FakeDisk::Write(const StoreChange& change) {
  Tape& tape = world_.tape;
  if (tape.Happens(2)) throw PowerCut{};
  if (bad_for_ == 0 && tape.Happens(2)) bad_for_ = 1 + tape.Below(60);
  if (bad_for_ > 0) {
    --bad_for_;
    return absl::ResourceExhaustedError("the disk is full");
  }
  const absl::Status status = store_.Write(change);
  if (tape.Happens(2)) throw PowerCut{};
  return status;
}

World::World(std::string folder, std::vector<uint8_t> bytes, int slots,
             const std::string& store_file, bool is_remote)
    : tape(std::move(bytes)), remote(is_remote), track(DemoTrack()), folder_(std::move(folder)), slots_(slots) {
  spdlog::set_level(spdlog::level::off);
  fs::create_directory(folder_);
  fs::copy_file(store_file.empty() ? EmptyStore() : store_file, folder_ + "/store.db");
  Boot();
}

World::~World() {
  Cut();
  fs::remove_all(folder_);
}

void World::Cut() {
  core = nullptr;  // takes its runners with it
  slots_in_use.clear();
  cancels_open = 0;  // those who asked learn that the daemon is gone
  disk_ = nullptr;
  readers = nullptr;
  store = nullptr;
}

void World::Boot() {
  Cut();
  // After a reboot the monotonic clock starts elsewhere; the engine must not mind.
  clock.Advance(absl::Seconds(tape.Below(100)));
  const std::string path = folder_ + "/store.db";
  store = *Store::Open(path, clock);
  readers = std::make_unique<ReaderPool>(path);
  disk_ = std::make_unique<FakeDisk>(*this, *store);
  EngineOptions options;
  options.data_dir = folder_;
  options.config.scheduler = {.slots = slots_, .team_running = 1 + slots_ / 2,
                              .begins_later = remote, .queue_wait = absl::Minutes(5)};
  options.config.lease_grace = absl::Seconds(60);
  options.config.self_test_deadline = absl::Seconds(60);
  absl::Status status;
  for (int tries = 0; tries < 1000; ++tries) {
    core = std::make_unique<EngineCore>(options, *disk_, *readers, processes_, clock);
    try {
      status = core->Recover();
      if (status.ok()) return;
    } catch (const PowerCut&) {
      ++power_cuts;
    }
  }
  Promise(false, absl::StrCat("the engine does not start: ", status.message()));
}

void World::RunOnce() {
  try {
    const absl::StatusOr<absl::Duration> wait = core->RunOnce();
    Promise(wait.ok(), absl::StrCat("the engine gave up: ", wait.status().message()));
    if (!wait.ok()) return;
    Promise(static_cast<int>(slots_in_use.size()) <= slots_, "more runners than slots");
    clock.Advance(*wait + absl::Milliseconds(tape.Below(200)));
    // The host was suspended, or the daemon stopped.
    if (tape.Happens(2)) clock.Advance(absl::Minutes(tape.Below(60)));
  } catch (const PowerCut&) {
    ++power_cuts;
    CheckStore();
    Boot();
  }
}

void World::Promise(bool kept, const std::string& what) {
  if (!kept && broken.empty()) broken = what;
}

int64_t World::Submit(const std::string& team, int episodes) {
  NewSubmission submission;
  submission.team = team;
  submission.artefact = Sha256Hex(absl::StrCat(team, "/", ++submits));
  submission.track = track->config.id;
  submission.profile = track->config.profile;
  submission.config = track->config.hash;
  submission.config_json = CanonicalJson(track->config.effective);
  std::vector<uint64_t> seeds;
  for (int i = 0; i < episodes; ++i) seeds.push_back(10 * i + evaluations.size());
  submission.seeds_json = CanonicalJson(nlohmann::json(seeds));
  submission.seeds = Sha256Hex(submission.seeds_json);
  submission.ranked = episodes % 2 == 0;
  submission.grader_json = "{}";
  for (int first = 0; first < episodes; first += 2) {
    submission.blocks.emplace_back(first, std::min(first + 1, episodes - 1));
  }
  const ArtefactRow artefact{{team, {"./policy"}, needs_runtimes}, submission.artefact, 1, 1};
  int64_t id = 0;
  try {
    core->Ask({[&, submission, artefact](Transaction& writer) -> absl::Status {
                 if (auto added = writer.content.AddArtefact(artefact); !added.ok())
                   return added.status();
                 absl::StatusOr<Accepted> accepted =
                     writer.submissions.Accept(submission, kRules, "test");
                 if (accepted.ok()) id = accepted->evaluation;
                 return accepted.status();
               },
               [&] { return core->Enqueue(id); },
               [&](const absl::Status& status) {
                 if (status.ok()) evaluations.insert(id);
               }});
    const absl::StatusOr<absl::Duration> wait = core->RunOnce();
    Promise(wait.ok(), absl::StrCat("the engine gave up: ", wait.status().message()));
  } catch (const PowerCut&) {
    ++power_cuts;
    Boot();
  }
  return id;
}

void World::Cancel(int64_t submission) {
  const absl::Duration asked = clock.Monotonic();
  ++cancels_open;
  try {
    const CancelOrder order = {
        .submission = submission, .reruns = true, .charge = true, .why = "test", .who = "test"};
    core->Cancel(order, [this, asked](absl::StatusOr<CancelReport> report) {
      --cancels_open;
      if (!report.ok()) return;
      Promise(report->took <= clock.Monotonic() - asked, "a cancel took longer than it did");
    });
  } catch (const PowerCut&) {
    ++power_cuts;
    Boot();
  }
}

bool World::AllEnded() {
  bool all = true;
  (void)readers->Read([&](const Transaction& reader) {
    const Listed<EvaluationRow> open = reader.evaluations.Unfinished();
    all = open.rows.empty() && open.damaged.empty();
    return absl::OkStatus();
  });
  return all;
}

std::string World::WhatIsOpen() {
  const LiveHealth health = core->Health();
  std::string open = absl::StrCat(health.running, " running, ", health.pending, " pending, ",
                                  health.ending, " ending; ", health.store_trouble, " ",
                                  health.host_trouble);
  (void)readers->Read([&](const Transaction& reader) {
    for (const EvaluationRow& row : reader.evaluations.Unfinished().rows) {
      absl::StrAppend(&open, "; evaluation ", row.id, ": ", core->EstimateOutlook(row.id).waiting);
      const auto blocks = reader.blocks.Of(row.id);
      for (const BlockRow& block : blocks.value_or(std::vector<BlockRow>())) {
        absl::StrAppend(&open, ", block ", block.id, " ", std::string(EnumName(block.state)),
                        " attempt ", block.attempt, " faults ", block.faults);
      }
    }
    return absl::OkStatus();
  });
  return open;
}

void World::CheckStore() {
  const absl::Status status = readers->Read([&](const Transaction& reader) {
    for (const int64_t id : evaluations) CheckEvaluation(reader, id);
    return absl::OkStatus();
  });
  Promise(status.ok(), absl::StrCat("the store can't be read: ", status.message()));
}

void World::CheckEvaluation(const Transaction& reader, int64_t id) {
  const absl::StatusOr<EvaluationRow> evaluation = reader.evaluations.Find(id);
  Promise(evaluation.ok(), absl::StrCat("evaluation ", id, " was accepted and is lost"));
  if (!evaluation.ok()) return;
  const SubmissionRow submission = *reader.submissions.Find(evaluation->submission);
  const auto seeds = nlohmann::json::parse(*reader.content.Text(kSeedLists, submission.seeds))
                         .get<std::vector<uint64_t>>();
  const std::vector<EpisodeRow> rows = *reader.episodes.Of(id);
  const std::map<int64_t, std::string> details = *reader.episodes.Details(id);
  Promise(details.size() == rows.size(), absl::StrCat("details of ", id, " were lost or are extra"));
  for (const EpisodeRow& row : rows) {
    const EpisodeFacts expected = FactsOf(
        {row.index, seeds[static_cast<size_t>(row.index)],
         PolicySeed(track->config.policy_seed_secret, row.index)});
    const std::string facts = CanonicalJson(EpisodeFactsToJson(expected));
    Promise(row.facts_json == facts, absl::StrCat("episode ", row.index, " of ", id,
                                                  " has other facts than it was played with"));
    seen_[{id, row.index}] = facts;
    Promise(details.contains(row.index) &&
                details.at(row.index) == CanonicalJson(DetailsToJson(*expected.details)),
            absl::StrCat("episode ", row.index, " of ", id, " has other details"));
  }
  int64_t known = 0;
  for (const auto& [key, facts] : seen_) known += key.first == id;
  Promise(known == std::ssize(rows), absl::StrCat("an episode of ", id, " was lost"));
  Promise(reader.episodes.Repeats(id)->empty(),
          absl::StrCat("an episode of ", id, " came out otherwise"));
  if (evaluation->state == EvaluationState::kDone) {
    Promise(rows.size() == seeds.size(), absl::StrCat(id, " is done without all its episodes"));
    Promise(evaluation->results_hash == ResultsHash(rows, track->config.seed_salt),
            "another hash than its rows have");
  }
  CheckHistory(reader, "evaluation", id, std::string(EnumName(evaluation->state)));
  const std::vector<BlockRow> blocks = *reader.blocks.Of(id);
  for (const BlockRow& block : blocks) {
    Promise(block.faults <= 4, "a block was played again more than three times");
    Promise(!IsFinal(evaluation->state) || IsFinal(block.state), "an open block of an ended one");
    CheckHistory(reader, "block", block.id, std::string(EnumName(block.state)));
  }
}

// Each row starts where the previous one ended, and the last one is the state.
void World::CheckHistory(const Transaction& reader, const std::string& entity, int64_t id,
                         const std::string& state) {
  std::string now;
  const std::vector<TransitionRow> history = *reader.evaluations.Transitions(entity, id);
  for (const TransitionRow& row : history) {
    Promise(row.from == now, absl::StrCat(entity, " ", id, " has a gap in its history"));
    now = row.to;
  }
  Promise(now == state, absl::StrCat(entity, " ", id, " is ", state, ", its history says ", now));
}

}  // namespace myograde::server
