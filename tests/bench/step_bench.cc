// Speed of a control step against the physics engine alone: one JSON object on standard output.
//
//   step_bench TRACKS_DIR TRACK [--threads N] [--leases N] [--episodes N] [--steps N]
//              [--repetitions N] [--environment-only 1]
//
// Three ways of playing the same episodes (same seeds, same controls, so the same contacts):
//   env     Environment::Step and Observe
//   engine  the engine calls that a control step is defined by: five integrations and the one
//           evaluation of forces that the observation needs, positions and velocities computed once
//   mjstep  five plain mj_step
// Each repetition times all three, one after the other, so that a ratio compares neighbours in
// time. Each thread plays its own environment, and all start each part together. As in an
// evaluation the episodes come in leases, and a thread that is done takes the next; a rate is that
// of all steps until the last thread ends, resets left out.
// The seeds are spread evenly over those of the track, as some of its episodes cost more than
// others; leases times episodes equal to their number plays each once. A step costs more later in
// an episode (more contacts), so compare only episodes of the same length.
// With --environment-only the other two ways are left out.
// Afterwards one episode is played with MuJoCo's own timers, which cost a little, and are off
// before.
#include <algorithm>
#include <atomic>
#include <barrier>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <absl/strings/numbers.h>
#include <mujoco/mujoco.h>
#include <nlohmann/json.hpp>

#include "protocol/base/pinned_maths.h"
#include "protocol/lease/track_config.h"
#include "sim/tracks.h"
#include "sim/locomotion/environment.h"
#include "sim/manipulation/environment.h"

namespace myograde::sim {
namespace {

constexpr int kSubsteps = 5;
using Seconds = std::chrono::duration<double>;
using Clock = std::chrono::steady_clock;

struct Options {
  std::string tracks_dir, track;
  int threads = 1;
  int leases = 0;    // 0: one for each thread
  int episodes = 3;  // of a lease
  int steps = 500;
  int repetitions = 5;
  int environment_only = 0;
};

[[noreturn]] void Fail(const std::string& sentence) {
  std::fprintf(stderr, "error: %s\n", sentence.c_str());
  std::exit(2);
}

Options Parse(int argc, char** argv) {
  if (argc < 3) Fail("usage: step_bench TRACKS_DIR TRACK [--threads N] [--episodes N] ...");
  Options options;
  options.tracks_dir = argv[1];
  options.track = argv[2];
  const std::pair<const char*, int*> flags[] = {{"--threads", &options.threads},
                                                {"--leases", &options.leases},
                                                {"--episodes", &options.episodes},
                                                {"--steps", &options.steps},
                                                {"--repetitions", &options.repetitions},
                                                {"--environment-only", &options.environment_only}};
  for (int i = 3; i < argc; i += 2) {
    const auto flag = std::find_if(std::begin(flags), std::end(flags), [&](const auto& known) {
      return argv[i] == std::string(known.first);
    });
    if (flag == std::end(flags) || i + 1 == argc ||
        !absl::SimpleAtoi(argv[i + 1], flag->second) || *flag->second < 1) {
      Fail(std::string("wrong option ") + argv[i] + ": each takes a number from 1 on");
    }
  }
  if (options.leases == 0) options.leases = options.threads;
  return options;
}

// An environment with its engine.
struct Player {
  std::unique_ptr<Environment> environment;
  const mjModel* model = nullptr;
  mjData* data = nullptr;
  std::vector<double> latency;  // s, of each step of the environment
};

Player MakePlayer(const TrackConfig& config, const std::string& cache) {
  auto environment = MakeEnvironment(config, cache);
  if (!environment.ok()) Fail(std::string(environment.status().message()));
  Player player;
  player.environment = *std::move(environment);
  if (auto* arm = dynamic_cast<ManipulationEnvironment*>(player.environment.get())) {
    player.model = &arm->model();
    player.data = &arm->data();
  } else if (auto* leg = dynamic_cast<LocomotionEnvironment*>(player.environment.get())) {
    player.model = &leg->model();
    player.data = &leg->data();
  }
  return player;
}

struct Episode {
  uint64_t seed;
  std::vector<double> controls;  // steps x nu, as the environment set them
};

// Each plays one episode and returns its seconds, the reset left out.

double PlayEnvironment(Player& player, Episode& episode, int steps) {
  Environment& environment = *player.environment;
  const std::vector<double> action(environment.action_size(), 0.0);
  std::vector<double> observation(environment.observation_size());
  environment.Reset(episode.seed);
  std::vector<double>& controls = episode.controls;
  controls.clear();
  controls.reserve(static_cast<size_t>(steps) * player.model->nu);
  const auto start = Clock::now();
  auto before = start;
  for (int t = 0; t < steps; ++t) {
    if (environment.Step(action).ended && t + 1 < steps) Fail("an episode ended early");
    environment.Observe(observation);
    controls.insert(controls.end(), player.data->ctrl, player.data->ctrl + player.model->nu);
    const auto now = Clock::now();
    player.latency.push_back(Seconds(now - before).count());
    before = now;
  }
  return Seconds(Clock::now() - start).count();
}

double Replay(Player& player, const Episode& episode, int steps,
              const std::function<void(const mjModel*, mjData*)>& step) {
  player.environment->Reset(episode.seed);
  const double* control = episode.controls.data();
  const auto start = Clock::now();
  for (int t = 0; t < steps; ++t, control += player.model->nu) {
    std::copy_n(control, player.model->nu, player.data->ctrl);
    step(player.model, player.data);
  }
  return Seconds(Clock::now() - start).count();
}

void EngineStep(const mjModel* model, mjData* data) {
  mj_step2(model, data);
  for (int i = 1; i < kSubsteps; ++i) mj_step(model, data);
  mj_forward(model, data);
}

void PlainStep(const mjModel* model, mjData* data) {
  for (int i = 0; i < kSubsteps; ++i) mj_step(model, data);
}

double Quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1))];
}

nlohmann::json Summary(const std::vector<double>& values) {
  return {{"median", Quantile(values, 0.5)},
          {"min", Quantile(values, 0)},
          {"max", Quantile(values, 1)},
          {"values", values}};
}

// Rates in control steps per second of all threads together, one for each repetition.
struct Rates {
  std::vector<double> env, engine, mjstep;
};

// Seconds of one episode of a player.
using Play = std::function<double(Player&, Episode&)>;

using Leases = std::vector<std::vector<Episode>>;

Leases MakeLeases(int leases, int episodes, const std::vector<uint64_t>& seeds) {
  Leases made(leases);
  const size_t all = static_cast<size_t>(leases) * episodes;
  for (size_t place = 0; place < all; ++place) {
    made[place / episodes].push_back({seeds[place * seeds.size() / all], {}});
  }
  return made;
}

// The players play all leases, each on a thread of its own. Returns the rate of all together.
double Together(std::vector<Player>& players, Leases& leases, int steps, const Play& play) {
  std::vector<double> seconds(players.size(), 0.0);
  std::barrier together(static_cast<std::ptrdiff_t>(players.size()));
  std::atomic<size_t> next = 0;
  std::vector<std::jthread> threads;
  for (size_t i = 0; i < players.size(); ++i) {
    threads.emplace_back([&, i] {
      together.arrive_and_wait();
      for (size_t lease; (lease = next++) < leases.size();) {
        for (Episode& episode : leases[lease]) seconds[i] += play(players[i], episode);
      }
    });
  }
  threads.clear();
  const double all = static_cast<double>(leases.size() * leases.front().size()) * steps;
  return all / *std::max_element(seconds.begin(), seconds.end());
}

Rates Measure(std::vector<Player>& players, const Options& options, const TrackConfig& config) {
  Rates rates;
  Leases warm = MakeLeases(options.threads, 1, config.seeds);
  Leases timed = MakeLeases(options.leases, options.episodes, config.seeds);
  for (int repetition = -1; repetition < options.repetitions; ++repetition) {
    Leases& leases = repetition < 0 ? warm : timed;
    const auto replay = [&](auto step) {
      return Together(players, leases, options.steps, [&, step](Player& player, Episode& episode) {
        return Replay(player, episode, options.steps, step);
      });
    };
    // First, as it leaves the controls for the other two.
    const double env =
        Together(players, leases, options.steps, [&](Player& player, Episode& episode) {
          return PlayEnvironment(player, episode, options.steps);
        });
    const bool engine_too = options.environment_only == 0;
    const double engine = engine_too ? replay(EngineStep) : 0;
    const double mjstep = engine_too ? replay(PlainStep) : 0;
    if (repetition < 0) {
      for (Player& player : players) player.latency.clear();
      continue;
    }
    rates.env.push_back(env);
    if (!engine_too) continue;
    rates.engine.push_back(engine);
    rates.mjstep.push_back(mjstep);
  }
  return rates;
}

std::vector<double> Ratios(const std::vector<double>& over, const std::vector<double>& under) {
  std::vector<double> ratios;
  for (size_t i = 0; i < over.size(); ++i) ratios.push_back(over[i] / under[i]);
  return ratios;
}

mjtNum Seconds64() {
  return Seconds(Clock::now().time_since_epoch()).count();
}

// Seconds of a control step that MuJoCo's own timers tell, by part: sums of the parts' calls.
nlohmann::json Timers(Player& player, uint64_t seed, int steps) {
  Episode episode = {seed, {}};
  mjcb_time = Seconds64;
  const double all = PlayEnvironment(player, episode, steps);
  mjcb_time = nullptr;
  nlohmann::json parts = {{"control_step", all / steps}};
  for (int i = 0; i < mjNTIMER; ++i) {
    parts[mjTIMERSTRING[i]] = player.data->timer[i].duration / steps;
  }
  return parts;
}

int Main(int argc, char** argv) {
  const Options options = Parse(argc, argv);
  const char* cache = std::getenv("MYOGRADE_CACHE");
  if (cache == nullptr) Fail("MYOGRADE_CACHE must name the cache folder; run ./dev setup");
  const auto config = LoadTrackConfig(options.tracks_dir, options.track, "");
  if (!config.ok()) Fail(std::string(config.status().message()));
  std::vector<Player> players;
  for (int i = 0; i < options.threads; ++i) {
    players.push_back(MakePlayer(*config, cache));
  }
  const Rates rates = Measure(players, options, *config);
  std::vector<double> latency;
  for (const Player& player : players) {
    latency.insert(latency.end(), player.latency.begin(), player.latency.end());
  }
  nlohmann::json result = {{"track", config->kind->name},
                           {"threads", options.threads},
                           {"leases", options.leases},
                           {"episodes", options.episodes},
                           {"steps", options.steps},
                           {"env", Summary(rates.env)},
                           {"env_step_s",
                            {{"p50", Quantile(latency, 0.5)},
                             {"p99", Quantile(latency, 0.99)},
                             {"max", Quantile(latency, 1)}}}};
  if (options.environment_only == 0) {
    result["engine"] = Summary(rates.engine);
    result["mjstep"] = Summary(rates.mjstep);
    result["env_over_engine"] = Summary(Ratios(rates.env, rates.engine));
    result["env_over_mjstep"] = Summary(Ratios(rates.env, rates.mjstep));
    result["timers_s"] = Timers(players[0], config->seeds[0], options.steps);
  }
  std::printf("%s\n", result.dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace myograde::sim

int main(int argc, char** argv) {
  // The same computation as in an evaluation, bit for bit.
  if (const absl::Status status = myograde::PinMaths(argv); !status.ok()) {
    std::fprintf(stderr, "error: %s\n", std::string(status.message()).c_str());
    return 2;
  }
  return myograde::sim::Main(argc, argv);
}
