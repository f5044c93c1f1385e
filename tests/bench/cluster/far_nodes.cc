#include "far_nodes.h"

#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

namespace myograde::server {
namespace {

// As a policy that always puts the object down in time.
EpisodeFacts FactsOf(const EpisodeOrder& episode) {
  EpisodeFacts facts;
  facts.index = episode.index;
  facts.seed = episode.seed;
  facts.end = ManipulationEnd::kPlaced;
  facts.steps = 1000;
  facts.sim_time = 10;
  facts.digest = std::string(64, 'a');
  ManipulationFacts played;
  played.frames_arm = played.frames_prosthesis = 100;
  played.placed = played.solved = played.goal_only_at_end = true;
  facts.track = played;
  ManipulationDetails details;
  details.first_contact_time = 0.5;
  details.handover_time = 0.75;
  facts.details = details;
  return facts;
}

struct Script {
  absl::Duration begins;
  absl::Duration ends;
  absl::Duration speaks;                          // between two records
  absl::Duration quiet = absl::InfiniteDuration();  // nothing comes from then on
  std::string lost;                               // said from `quiet` on
  bool faulty = false;
};

class FarRunner : public Runner {
 public:
  FarRunner(const Clock& clock, std::vector<EpisodeOrder> episodes, Script script, std::string node,
            std::string job)
      : clock_(clock),
        episodes_(std::move(episodes)),
        script_(std::move(script)),
        node_(std::move(node)),
        job_(std::move(job)),
        next_(script_.begins) {}

  int stdout_fd() const override { return -1; }
  int stderr_fd() const override { return -1; }

  absl::StatusOr<std::vector<LeaseRecord>> Read() override {
    std::vector<LeaseRecord> records;
    const absl::Duration now = clock_.Monotonic();
    if (ended_ || now < next_ || now >= script_.quiet) return records;
    if (now < script_.ends) {
      next_ = now + script_.speaks;
      records.push_back(ProgressRecord{episodes_.front().index, 1});
      return records;
    }
    ended_ = true;
    LeaseEndRecord end;
    end.ok = !script_.faulty;
    if (script_.faulty) {
      end.detail = "the simulator vanished";
    } else {
      for (const EpisodeOrder& episode : episodes_) records.push_back(FactsOf(episode));
    }
    records.push_back(end);
    return records;
  }

  bool finished() override { return ended_; }
  bool dead() override { return ended_ || asked_; }
  void AskToEnd() override { asked_ = true; }
  void KillNow() override { asked_ = true; }
  bool begun() const override { return clock_.Monotonic() >= script_.begins; }
  std::string lost() const override {
    return clock_.Monotonic() >= script_.quiet ? script_.lost : "";
  }
  RunnerSite site() const override { return {node_, job_, 12.5, 800.0}; }
  pid_t pid() const override { return 0; }
  int wait_status() const override { return 0; }
  std::string stderr_tail() const override { return ""; }

 private:
  const Clock& clock_;
  const std::vector<EpisodeOrder> episodes_;
  const Script script_;
  const std::string node_;
  const std::string job_;
  absl::Duration next_;
  bool ended_ = false;
  bool asked_ = false;
};

}  // namespace

absl::StatusOr<std::unique_ptr<Runner>> FarNodes::Start(const LeaseOrder& order,
                                                        const LeaseSubject& subject) {
  (void)subject;
  ++counts_.starts;
  Script script;
  const absl::Duration now = clock_.Monotonic();
  script.begins = now + Between(absl::ZeroDuration(), options_.longest_queue);
  script.ends = script.begins + Between(options_.lease * 0.8, options_.lease * 1.2);
  script.speaks = options_.speaks;
  script.faulty = Happens(options_.faulty);
  counts_.faulty += script.faulty;
  if (Happens(options_.preempted)) {
    ++counts_.preempted;
    script.quiet = Between(now, script.begins);
    script.lost = "its job was preempted";
  } else if (Happens(options_.dies)) {
    ++counts_.dies;
    script.quiet = Between(script.begins, script.ends);
    script.lost = "its node was lost";
  } else if (Happens(options_.silent)) {
    ++counts_.silent;
    script.quiet = Between(script.begins, script.ends);
  }
  const int64_t node = static_cast<int64_t>(random_() % static_cast<uint64_t>(options_.nodes));
  return std::make_unique<FarRunner>(clock_, order.episodes, std::move(script),
                                     absl::StrCat("node", node),
                                     absl::StrCat(counts_.starts / 100, "_", counts_.starts % 100));
}

}  // namespace myograde::server
