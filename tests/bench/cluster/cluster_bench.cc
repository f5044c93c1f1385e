// What one daemon bears as a cluster grows: one JSON object on standard output.
//
//   cluster_bench CONFIGS FOLDER [--nodes N] [--leases N] [--teams N] [--lease-episodes N]
//                 [--lease-s S] [--turn-s S] [--seed N]
//
// The engine's core with its scheduler and a store on FOLDER's disk play leases of the track
// demo-manipulation on nodes that are not there (far_nodes.h); a lease that ends costs the daemon what
// a real one does, but for its executor. All submissions are there at the beginning. Each turn of the
// loop moves the clock by `--turn-s`: what a turn takes in truth, over that, is how busy the daemon
// would be with so many nodes and leases of that length.
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "far_nodes.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "server/engine/engine_core.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Wall = std::chrono::steady_clock;

constexpr int64_t kEpisodes = 100;  // of a submission
constexpr int64_t kEnough = int64_t{1} << 40;
constexpr AdmissionRules kRules = {.quota = {.ranked = {kEnough, kEnough},
                                             .practice = {kEnough, kEnough},
                                             .failed = {kEnough, kEnough},
                                             .waiting = kEnough}};

[[noreturn]] void Fail(const std::string& sentence) {
  std::fprintf(stderr, "error: %s\n", sentence.c_str());
  std::exit(2);
}

double SecondsSince(Wall::time_point start) {
  return std::chrono::duration<double>(Wall::now() - start).count();
}

double CpuSeconds() {
  rusage use = {};
  getrusage(RUSAGE_SELF, &use);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) * 1e-6;
  };
  return seconds(use.ru_utime) + seconds(use.ru_stime);
}

int64_t ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  int64_t size = 0;
  int64_t resident = 0;
  file >> size >> resident;
  return resident * sysconf(_SC_PAGESIZE);
}

struct Options {
  std::string configs;
  std::string folder;
  int64_t nodes = 10'000;
  int64_t leases = 1'000'000;
  int64_t teams = 100;
  int64_t lease_episodes = 1;
  int64_t lease_s = 60;
  int64_t turn_s = 1;
  int64_t seed = 1;
};

// The store, and how long the loop waits for it.
class TimedDisk : public StoreWriter {
 public:
  explicit TimedDisk(Store& store) : disk_(store) {}
  absl::Status Write(const StoreChange& change) override {
    const auto start = Wall::now();
    const absl::Status status = disk_.Write(change);
    seconds_ += SecondsSince(start);
    ++writes_;
    return status;
  }
  double seconds() const { return seconds_; }
  int64_t writes() const { return writes_; }

 private:
  SqliteStoreWriter disk_;
  double seconds_ = 0;
  int64_t writes_ = 0;
};

Json Spread(std::vector<double> values) {
  if (values.empty()) return nullptr;
  std::sort(values.begin(), values.end());
  const auto at = [&](double q) {
    return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1))];
  };
  return {{"median", at(0.5)}, {"min", at(0)}, {"p99", at(0.99)}, {"max", at(1)}};
}

class Daemon {
 public:
  explicit Daemon(const Options& options)
      : options_(options), path_(options.folder + "/store.db"), nodes_(FarOptions(options), clock_) {
    absl::StatusOr<TrackConfig> config =
        LoadTrackConfig(options.configs + "/tracks", "demo-manipulation", "");
    if (!config.ok()) Fail(std::string(config.status().message()));
    track_ = *MakeTrack(*std::move(config));
    auto store = Store::Open(path_, clock_);
    if (!store.ok()) Fail(std::string(store.status().message()));
    store_ = *std::move(store);
    readers_ = std::make_unique<ReaderPool>(path_);
    disk_ = std::make_unique<TimedDisk>(*store_);
    EngineOptions engine;
    engine.data_dir = options.folder;
    engine.config.on_cluster = true;
    engine.config.scheduler = {.slots = static_cast<int>(options.nodes),
                               .team_running = static_cast<int>(options.nodes),
                               .begins_later = true,
                               .queue_wait = absl::Hours(1000)};
    engine.config.lease_grace = absl::Seconds(60);
    core_ = std::make_unique<EngineCore>(engine, *disk_, *readers_, nodes_, clock_);
    if (absl::Status status = core_->Recover(); !status.ok()) Fail(std::string(status.message()));
  }

  // All submissions, by all teams in turn.
  void Fill() {
    const int64_t of_one = kEpisodes / options_.lease_episodes;
    const int64_t submissions = std::max<int64_t>(options_.leases / of_one, 1);
    std::vector<int64_t> ids;
    for (int64_t i = 0; i < submissions; ++i) Submit(i, ids);
    leases_ = submissions * of_one;
    for (const int64_t id : ids) {
      if (absl::Status status = core_->Enqueue(id); !status.ok()) Fail(std::string(status.message()));
    }
  }

  Json Play() {
    const double disk_before = disk_->seconds();
    const int64_t writes_before = disk_->writes();
    const auto start = Wall::now();
    const double cpu = CpuSeconds();
    std::vector<double> turns;
    double full_s = 0;  // of turns while all nodes are busy
    int64_t full_turns = 0;
    int64_t peak = 0;
    Json views;
    LiveHealth health = core_->Health();
    do {
      const auto begin = Wall::now();
      if (const auto wait = core_->RunOnce(); !wait.ok()) Fail(std::string(wait.status().message()));
      turns.push_back(SecondsSince(begin));
      clock_.Advance(absl::Seconds(options_.turn_s));
      health = core_->Health();
      if (health.pending > options_.nodes) {
        full_s += turns.back();
        ++full_turns;
      }
      if (turns.size() % 64 == 0) peak = std::max(peak, ResidentBytes());
      if (turns.size() == 100) views = Views();
      if (turns.size() > 50'000'000) Fail("the leases do not come to an end");
    } while (health.running > 0 || health.pending > 0 || health.ending > 0);
    const double wall = SecondsSince(start);
    const double store = disk_->seconds() - disk_before;
    const FarCounts& counts = nodes_.counts();
    return {{"simulated_s", absl::ToDoubleSeconds(clock_.Monotonic())},
            {"wall_s", wall},
            {"cpu_s", CpuSeconds() - cpu},
            {"store_wall_s", store},
            {"store_writes", disk_->writes() - writes_before},
            {"turn_s", Spread(turns)},
            {"turns", turns.size()},
            {"busy_share", full_turns == 0 ? Json() : Json(full_s / static_cast<double>(full_turns * options_.turn_s))},
            {"leases_per_s", static_cast<double>(leases_) / wall},
            {"decisions_per_s", 2.0 * static_cast<double>(counts.starts) / wall},
            {"starts", counts.starts},
            {"lost", counts.dies + counts.preempted},
            {"silent", counts.silent},
            {"faulty", counts.faulty},
            {"views_s", views},
            {"peak_bytes", std::max(peak, ResidentBytes())}};
  }

  int64_t leases() const { return leases_; }
  int64_t StoreBytes() const {
    int64_t bytes = 0;
    for (const char* end : {"", "-wal"}) {
      std::error_code error;
      const auto size = fs::file_size(path_ + end, error);
      if (!error) bytes += static_cast<int64_t>(size);
    }
    return bytes;
  }
  Json States() {
    Json states;
    const absl::Status status = readers_->Read([&](const Transaction& reader) {
      for (const auto& [state, count] : reader.submissions.CountByState()) states[state] = count;
      return absl::OkStatus();
    });
    if (!status.ok()) Fail(std::string(status.message()));
    return states;
  }

 private:
  static FarNodesOptions FarOptions(const Options& options) {
    FarNodesOptions far;
    far.nodes = options.nodes;
    far.seed = static_cast<uint64_t>(options.seed);
    far.lease = absl::Seconds(options.lease_s);
    return far;
  }

  void Submit(int64_t index, std::vector<int64_t>& ids) {
    NewSubmission submission;
    submission.team = absl::StrCat("team ", index % options_.teams);
    submission.artefact = Sha256Hex(absl::StrCat("artefact ", index));
    submission.track = track_->config.id;
    submission.profile = track_->config.profile;
    submission.config = track_->config.hash;
    submission.config_json = CanonicalJson(track_->config.effective);
    std::vector<int64_t> seeds;
    for (int64_t i = 0; i < kEpisodes; ++i) seeds.push_back(i);
    submission.seeds_json = CanonicalJson(Json(seeds));
    submission.seeds = Sha256Hex(submission.seeds_json);
    submission.ranked = true;
    submission.grader_json = "{}";
    for (int64_t first = 0; first < kEpisodes; first += options_.lease_episodes) {
      submission.blocks.emplace_back(first, std::min(first + options_.lease_episodes, kEpisodes) - 1);
    }
    const absl::Status status = store_->Write([&](Transaction& writer) -> absl::Status {
      const auto added =
          writer.content.AddArtefact({{"bench", {"./policy"}}, submission.artefact, 1, 1});
      if (!added.ok()) return added.status();
      const absl::StatusOr<Accepted> accepted =
          writer.submissions.Accept(submission, kRules, "bench");
      if (accepted.ok()) ids.push_back(accepted->evaluation);
      return accepted.status();
    });
    if (!status.ok()) Fail(std::string(status.message()));
  }

  // What people and programs ask of the engine while all nodes are busy, in s of one call.
  Json Views() {
    const auto timed = [](const auto& call) {
      std::vector<double> seconds;
      for (int i = 0; i < 20; ++i) {
        const auto start = Wall::now();
        call();
        seconds.push_back(SecondsSince(start));
      }
      return Spread(seconds);
    };
    return {{"running", timed([&] { return core_->Running().size(); })},
            {"health", timed([&] { return core_->Health().running; })},
            {"queue_of", timed([&] { return core_->QueueOf(nullptr).size(); })},
            {"outlook_of", timed([&] { return core_->EstimateOutlook(1).waiting.size(); })}};
  }

  const Options options_;
  const std::string path_;
  ManualClock clock_{absl::FromUnixSeconds(1'700'000'000)};
  FarNodes nodes_;
  TrackPtr track_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<ReaderPool> readers_;
  std::unique_ptr<TimedDisk> disk_;
  std::unique_ptr<EngineCore> core_;
  int64_t leases_ = 0;
};

Options Parse(int argc, char** argv) {
  if (argc < 3) Fail("usage: cluster_bench CONFIGS FOLDER [--nodes N] [--leases N] ...");
  Options options;
  options.configs = argv[1];
  options.folder = argv[2];
  const std::pair<const char*, int64_t*> known[] = {
      {"--nodes", &options.nodes},     {"--leases", &options.leases},
      {"--teams", &options.teams},     {"--lease-episodes", &options.lease_episodes},
      {"--lease-s", &options.lease_s}, {"--turn-s", &options.turn_s},
      {"--seed", &options.seed}};
  for (int i = 3; i < argc; i += 2) {
    const auto* it = std::find_if(std::begin(known), std::end(known),
                                  [&](const auto& entry) { return entry.first == std::string(argv[i]); });
    if (it == std::end(known) || i + 1 >= argc || !absl::SimpleAtoi(argv[i + 1], it->second) ||
        *it->second < 1) {
      Fail(absl::StrCat(argv[i], " is not an option, or lacks a number from 1 on"));
    }
  }
  if (options.lease_episodes > kEpisodes || options.nodes > 1'000'000) Fail("a number is too large");
  return options;
}

int Main(int argc, char** argv) {
  const Options options = Parse(argc, argv);
  spdlog::set_level(spdlog::level::off);
  const int64_t empty = ResidentBytes();
  Daemon daemon(options);
  const auto start = Wall::now();
  daemon.Fill();
  const double filled_s = SecondsSince(start);
  const int64_t filled = ResidentBytes();
  const int64_t store_filled = daemon.StoreBytes();
  Json result = daemon.Play();
  result.update({{"nodes", options.nodes},
                 {"leases", daemon.leases()},
                 {"teams", options.teams},
                 {"lease_episodes", options.lease_episodes},
                 {"lease_s", options.lease_s},
                 {"turn_simulated_s", options.turn_s},
                 {"seed", options.seed},
                 {"fill_s", filled_s},
                 {"empty_bytes", empty},
                 {"filled_bytes", filled},
                 {"store_filled_bytes", store_filled},
                 {"store_bytes", daemon.StoreBytes()},
                 {"states", daemon.States()}});
  std::printf("%s\n", result.dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return myograde::server::Main(argc, argv); }
