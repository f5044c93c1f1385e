// Boards of earlier moments and of other configs: whatever happens, the board of a moment is the one
// that was shown then.
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/api/board_source.h"
#include "server/api/rejudge_plan.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

// The main board under the config that it had at that moment.
absl::StatusOr<Leaderboard> BoardAt(const Transaction& reader, const TrackPtr& live,
                                    const BoardMoment& moment) {
  ASSIGN_OR_RETURN(const TrackPtr track, TrackAt(reader, live, moment.results_before_ms()));
  return BoardUnder(reader, *track, scoring::kMainBoard, moment);
}

constexpr char kTrack[] = "locomotion";
constexpr char kProfile[] = "paper";
constexpr AdmissionRules kAny = {
    .quota = {
        .ranked = {999, 999}, .practice = {999, 999}, .failed = {999, 999}, .waiting = 999}};

// One episode under each; they differ in a limit of the environment.
std::vector<TrackPtr> MakeConfigs() {
  const TrackConfig shipped =
      *LoadTrackConfig(MYOGRADE_SOURCE_DIR "/configs/tracks", kTrack, kProfile);
  std::vector<TrackPtr> tracks;
  for (const int64_t files : {100, 101, 102}) {
    nlohmann::json effective = WithSeeds(shipped, {7})->effective;
    effective["budgets"]["submission_files"] = files;
    tracks.push_back(*MakeTrack(*ParseTrackConfig(effective, "test")));
  }
  return tracks;
}

const std::vector<TrackPtr>& Configs() {
  static const std::vector<TrackPtr> configs = MakeConfigs();
  return configs;
}

absl::StatusOr<std::string> Sign(const std::string&) { return std::string(128, 'a'); }

// A board with everything that can happen to it.
class Board {
 public:
  Board() {
    std::string name = (std::filesystem::temp_directory_path() / "boards-XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
    store_ = *Store::Open(dir_ + "/store.db", clock_);
    readers_ = std::make_unique<ReaderPool>(dir_ + "/store.db");
  }
  ~Board() { std::filesystem::remove_all(dir_); }
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;

  void Wait(int64_t ms) { clock_.Advance(absl::Milliseconds(ms)); }
  int64_t Now() const { return absl::ToUnixMillis(clock_.Now()); }
  const TrackPtr& live() const { return live_; }

  void Submit(const std::string& team) {
    const std::string artefact = Sha256Hex(absl::StrCat("artefact", ++artefacts_));
    const TrackConfig& config = live_->config;
    Write([&](Transaction& writer) {
      EXPECT_TRUE(writer.content.AddArtefact({{"walker", {"./policy"}}, artefact, 10, 2}).ok());
      NewSubmission submission;
      submission.team = team;
      submission.artefact = artefact;
      submission.track = config.id;
      submission.profile = config.profile;
      submission.config = config.hash;
      submission.config_json = CanonicalJson(config.effective);
      submission.seeds = Sha256Hex("[7]");
      submission.seeds_json = "[7]";
      submission.ranked = true;
      submission.grader_json = "{}";
      submission.blocks = {{0, 0}};
      const absl::StatusOr<Accepted> accepted =
          writer.submissions.Accept(submission, kAny, "uid 0");
      if (accepted.ok()) open_.push_back(*accepted);
      return accepted.status();
    });
  }
  // Ends the open evaluation `which`.
  void End(size_t which, bool done, double number) {
    if (open_.empty()) return;
    const auto ended = open_.begin() + static_cast<ptrdiff_t>(which % open_.size());
    const Accepted accepted = *ended;
    open_.erase(ended);
    const int64_t block = accepted.blocks.front();
    Write([&](Transaction& writer) {
      absl::Status status = writer.blocks.Start(block, 1, 0, 99, "daemon");
      if (!done) {
        status.Update(writer.blocks.End(block, BlockState::kFailed, false, "daemon", "broke"));
        status.Update(writer.evaluations.End(accepted.evaluation, EvaluationState::kFailed, "broke",
                                           "", "daemon"));
        return status;
      }
      status.Update(writer.episodes.Record({accepted.evaluation, 0, block, 1, 7, Outcome::kSuccess,
                                          FailureReason::kNone, "{}", "{}"}).status());
      status.Update(writer.blocks.Finish(block, 1, "{}", "daemon"));
      status.Update(writer.evaluations.End(accepted.evaluation, EvaluationState::kDone, "", "x",
                                         "daemon"));
      status.Update(writer.episodes.SetStanding(accepted.evaluation, AggregateWith(number)));
      return status;
    });
  }
  void Mark(int64_t submission, const std::string& mark, bool set) {
    Write([&](Transaction& writer) {
      const absl::Status status =
          writer.journal.Mark(submission, mark, set, "uid 0", "why").status();
      return absl::IsNotFound(status) ? absl::OkStatus() : status;
    });
  }
  void CreateRejudge(const TrackPtr& to) {
    NewRejudge rejudge = RejudgeBetween(live_->config, to->config);
    rejudge.seeds = Sha256Hex("[7]");
    rejudge.seeds_json = "[7]";
    rejudge.why = "the rules change";
    Write([&](Transaction& writer) {
      return writer.rejudges.Add(rejudge, Sign, "uid 0").status();
    });
    ++rejudges_;
  }
  // Adds the items that a rejudge lacks, as computed or to be played.
  void Follow(size_t which, bool play, double number) {
    if (rejudges_ == 0) return;
    const int64_t id = static_cast<int64_t>(which % rejudges_) + 1;
    std::vector<EvaluationRow> missing;
    Read([&](const Transaction& reader) {
      const absl::StatusOr<RejudgeRow> row = reader.rejudges.Find(id);
      if (row.ok()) missing = reader.rejudges.MissingItems(*row);
      return row.status();
    });
    EpisodeRow judged;
    judged.outcome = Outcome::kSuccess;
    judged.metrics_json = "{}";
    for (const EvaluationRow& item : missing) {
      // It may have been dropped, or hold an evaluation without episodes.
      (void)store_->Write([&](Transaction& writer) -> absl::Status {
        if (play) {
          NewRejudgeItem played{item};
          played.grader_json = "{}";
          played.blocks = {{0, 0}};
          const absl::StatusOr<Accepted> added = writer.rejudges.AddItem(played, "daemon");
          if (added.ok()) open_.push_back(*added);
          return added.status();
        }
        NewRejudgeItem computed{item};
        computed.method = RejudgeMethod::kFacts;
        computed.result = {.results_hash = "y", .aggregate = AggregateWith(number)};
        computed.episodes = {judged};
        return writer.rejudges.AddItem(computed, "daemon").status();
      });
    }
  }
  // A rejudge from its beginning to its end. The board was looked at in the moment of its beginning.
  void RejudgeAll(const TrackPtr& to, double number) {
    Wait(1);
    while (!open_.empty()) End(0, true, number);
    CreateRejudge(to);
    Follow(rejudges_ - 1, /*play=*/false, 100 - number);
    Wait(1);
    Act(rejudges_ - 1, /*apply=*/true);
  }
  // What organisers do to a rejudge; refused where it can't be done.
  void Act(size_t which, bool apply) {
    if (rejudges_ == 0) return;
    const RejudgeAct act = {.rejudge = static_cast<int64_t>(which % rejudges_) + 1,
                            .why = "a vote"};
    std::string config;
    std::vector<int64_t> cancelled;
    const absl::Status status = store_->Write([&](Transaction& writer) {
      const absl::StatusOr<RejudgeDone> done = writer.rejudges.End(apply, act, Sign, "uid 0");
      if (done.ok()) config = done->config_after;
      if (done.ok()) cancelled = done->cancelled;
      return done.status();
    });
    if (!status.ok()) return;
    std::erase_if(open_, [&](const Accepted& open) {
      return std::find(cancelled.begin(), cancelled.end(), open.evaluation) != cancelled.end();
    });
    Take(config);
  }
  // The organiser changes the file and starts the daemon again.
  void ChangeFile(const TrackPtr& to) {
    std::string before;
    Read([&](const Transaction& reader) {
      before = reader.Board().ConfigAt({"", kTrack, kProfile});
      return absl::OkStatus();
    });
    if (!before.empty() && before != to->config.hash) {
      Write([&](Transaction& writer) {
        return writer
            .journal.SetBoardConfig({{"", kTrack, kProfile}, to->config.hash,
                             CanonicalJson(to->config.effective)}, "daemon")
            .status();
      });
    }
    live_ = to;
  }

  // The rows as of a moment, under the config that the board had then.
  std::string ShownAt(int64_t before_ms) {
    std::string text;
    Read([&](const Transaction& reader) {
      const absl::StatusOr<Leaderboard> board =
          BoardAt(reader, live_, {.before_ms = before_ms});
      if (!board.ok()) return board.status();
      for (const LeaderboardRow& row : board->rows) {
        absl::StrAppend(&text, row.ranked.rank, " ", row.source.team, " ", row.source.submission,
                        " by evaluation ", row.source.evaluation, " of rejudge ",
                        row.source.rejudge, "\n");
      }
      for (const DisqualifiedRow& row : board->disqualified) {
        absl::StrAppend(&text, "out: ", row.source.submission, "\n");
      }
      const absl::StatusOr<TrackPtr> track = TrackAt(reader, live_, before_ms);
      if (!track.ok()) return track.status();
      const auto source = SourceOf(reader, **track, {.before_ms = before_ms});
      EXPECT_TRUE(source.ok() && source->damaged.empty());
      return absl::OkStatus();
    });
    return text;
  }
  void Read(const std::function<absl::Status(const Transaction&)>& body) {
    const absl::Status status = readers_->Read(body);
    EXPECT_TRUE(status.ok()) << status;
  }

 private:
  void Write(const std::function<absl::Status(Transaction&)>& change) {
    const absl::Status status = store_->Write(change);
    EXPECT_TRUE(status.ok()) << status;
  }
  void Take(const std::string& config) {
    for (const TrackPtr& track : Configs()) {
      if (track->config.hash == config) live_ = track;
    }
  }
  static nlohmann::json AggregateWith(double number) {
    nlohmann::json aggregate = {{"episodes", 1}, {"successes", 1}};
    for (const scoring::Metric& metric : Configs().front()->scoring.track->metrics) {
      aggregate[metric.name] = number;
    }
    return aggregate;
  }

  ManualClock clock_{absl::FromUnixSeconds(1700000000)};
  std::string dir_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<ReaderPool> readers_;
  TrackPtr live_ = Configs().front();
  std::vector<Accepted> open_;
  size_t rejudges_ = 0;
  int artefacts_ = 0;
};

void ActAtRandom(Board& board) {
  const auto which = *rc::gen::inRange<size_t>(0, 8);
  const double number = *rc::gen::inRange(1, 100);
  const bool yes = *rc::gen::arbitrary<bool>();
  const TrackPtr& config = Configs()[which % Configs().size()];
  switch (*rc::gen::inRange(0, 12)) {
    case 0:
    case 1: return board.Submit(absl::StrCat("team ", which % 3));
    case 2:
    case 3:
    case 4: return board.End(which, which != 0, number);
    case 5: return board.Mark(static_cast<int64_t>(which) + 1, yes ? kHidden : kBaseline,
                              number > 50);
    case 6: return board.CreateRejudge(config);
    case 7:
    case 8: return board.Follow(which, yes && number > 50, number);
    case 9: return which == 0 ? board.ChangeFile(config) : board.Act(which, yes);
    default: return yes ? board.RejudgeAll(config, number) : board.Act(which, which % 2 == 0);
  }
}

RC_GTEST_PROP(BoardMoments, TheBoardOfAMomentIsTheOneThatWasShownThen, ()) {
  Board board;
  std::map<int64_t, std::string> shown;  // at the end of each millisecond
  const auto acts = *rc::gen::inRange(0, 30);
  for (int i = 0; i < acts; ++i) {
    board.Wait(*rc::gen::inRange(0, 3));
    ActAtRandom(board);
    shown[board.Now()] = board.ShownAt(INT64_MAX);
  }
  for (const auto& [moment, text] : shown) RC_ASSERT(board.ShownAt(moment + 1) == text);
  const bool by_rejudges = std::any_of(shown.begin(), shown.end(), [](const auto& one) {
    return std::regex_search(one.second, std::regex("of rejudge [1-9]"));
  });
  RC_CLASSIFY(by_rejudges);
}

class RejudgedBoard : public testing::Test {
 protected:
  // Two teams, of which the first one is ahead only after the rejudge, which makes them equal.
  RejudgedBoard() {
    for (const char* team : {"alpha", "beta"}) {
      board_.Submit(team);
      board_.Wait(1);
      board_.End(0, true, team == std::string("alpha") ? 1 : 2);
    }
    board_.CreateRejudge(Configs()[1]);
    board_.Wait(1);
  }
  static constexpr char kBefore[] =
      "1 beta 2 by evaluation 2 of rejudge 0\n2 alpha 1 by evaluation 1 of rejudge 0\n";
  static constexpr char kAfter[] =
      "1 alpha 1 by evaluation 3 of rejudge 1\n2 beta 2 by evaluation 4 of rejudge 1\n";

  Board board_;
};

TEST_F(RejudgedBoard, ChangesWhenItIsAppliedAndWhenThatIsDropped) {
  board_.Follow(0, /*play=*/false, 5);
  EXPECT_EQ(board_.ShownAt(INT64_MAX), kBefore) << "the board changes with the act, not before";
  board_.Wait(1);
  board_.Act(0, /*apply=*/true);
  EXPECT_EQ(board_.live()->config.hash, Configs()[1]->config.hash);
  EXPECT_EQ(board_.ShownAt(INT64_MAX), kAfter);
  const int64_t applied = board_.Now();
  board_.Wait(5);
  board_.Act(0, /*apply=*/false);
  EXPECT_EQ(board_.ShownAt(INT64_MAX), kBefore);
  board_.Wait(5);
  board_.Act(0, /*apply=*/true);
  EXPECT_EQ(board_.ShownAt(INT64_MAX), kAfter);
  EXPECT_EQ(board_.ShownAt(applied), kBefore);
  EXPECT_EQ(board_.ShownAt(applied + 1), kAfter);
  EXPECT_EQ(board_.ShownAt(applied + 6), kBefore);
}

TEST_F(RejudgedBoard, IsShownAsIfApplied) {
  board_.Follow(0, /*play=*/false, 5);
  board_.Read([&](const Transaction& reader) {
    const auto as_if = BoardUnder(reader, *Configs()[1], "main", {.assumed_rejudge = 1});
    EXPECT_EQ(as_if.value().rows.size(), 2u);
    EXPECT_EQ(as_if.value().rows.front().source.rejudge, 1);
    EXPECT_TRUE(BoardUnder(reader, *Configs()[1], "main", {}).value().rows.empty());
    EXPECT_EQ(BoardUnder(reader, *Configs()[1], "none", {}).status().code(),
              absl::StatusCode::kInvalidArgument);
    return absl::OkStatus();
  });
}

TEST_F(RejudgedBoard, AFreezeHidesAResultThatCameLater) {
  const int64_t freeze = board_.Now();
  board_.Wait(1);
  board_.Follow(0, /*play=*/false, 5);
  board_.Act(0, /*apply=*/true);
  board_.Read([&](const Transaction& reader) {
    const BoardMoment frozen = {.freeze_ms = freeze};
    EXPECT_TRUE(BoardUnder(reader, *Configs()[1], "main", frozen).value().rows.empty());
    EXPECT_EQ(BoardAt(reader, board_.live(), frozen).value().rows.size(), 2u);
    return absl::OkStatus();
  });
}

TEST_F(RejudgedBoard, TellsWhatStandsUnderOtherConfigs) {
  board_.Follow(0, /*play=*/false, 5);
  board_.Act(0, /*apply=*/true);
  board_.Submit("gamma");
  board_.End(0, true, 1);
  const BoardName name = {"", kTrack, kProfile};
  const std::string& old_hash = Configs()[0]->config.hash;
  const std::string& new_hash = Configs()[1]->config.hash;
  board_.Read([&](const Transaction& reader) {
    const std::vector<OtherConfig> others = reader.Board().OtherConfigs(name, new_hash, {});
    EXPECT_EQ(others.size(), 1u);
    EXPECT_EQ(others.at(0).config, old_hash);
    EXPECT_EQ(others.at(0).submissions, 2);
    EXPECT_EQ(others.at(0).left, 0) << "the rejudge brought them here";
    const std::vector<OtherConfig> newer = reader.Board().OtherConfigs(name, old_hash, {});
    EXPECT_EQ(newer.size(), 1u);
    EXPECT_EQ(newer.at(0).submissions, 3);
    EXPECT_EQ(newer.at(0).teams, 3);
    EXPECT_EQ(newer.at(0).left, 1);
    EXPECT_EQ(reader.Board().ConfigsLike(new_hash.substr(0, 8), false), std::set{new_hash});
    EXPECT_TRUE(reader.Board().ConfigsLike("00000000", true).empty());
    EXPECT_TRUE(reader.Board().WasApplied(reader.evaluations.Find(3)->rejudge));
    EXPECT_EQ(reader.evaluations.Find(1)->rejudge, 0);
    return absl::OkStatus();
  });
}

}  // namespace
}  // namespace myograde::server
